"""Help, version, numbers and messages of the command line."""

from __future__ import annotations

import errno
import logging
import subprocess
import sys
from math import inf, nan
from pathlib import Path

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.main import get_command
from typer.testing import CliRunner

from emcas_fmu.bench.verdict import Judged, summary_table
from emcas_fmu.cli import app
from emcas_fmu.commands import common
from emcas_fmu.commands.group import PANELS, sentence
from emcas_fmu.errors import in_words, unreadable
from emcas_fmu.pages.numbers import number, rounded
from emcas_fmu.runtime import library
from emcas_fmu.runtime.compiler import PLATFORMS
from emcas_fmu.support.progress import LOG
from tests.commands import refusal

HEAVY = ("numpy", "scipy", "matplotlib", "pydantic", "pint", "jinja2", "fmpy", "emcas_fmu.actuators.declaration")
NAMES = [name for names in PANELS.values() for name in names]


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_import_no_heavy_library(option: str) -> None:
    program = ("import sys\nfrom emcas_fmu.cli import app\ntry:\n    app([sys.argv[1]])\nfinally:\n"
               "    print('loaded', *sorted(sys.modules), file=sys.stderr)\n")
    done = subprocess.run([sys.executable, "-c", program, option], capture_output=True, text=True)
    loaded = next(line for line in done.stderr.splitlines() if line.startswith("loaded ")).split()
    assert "emcas_fmu.cli" in loaded
    assert not set(HEAVY) & set(loaded)
    assert "emcas" in done.stdout


def test_every_command_is_listed_in_a_panel_by_its_summary() -> None:
    shown = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["--help"]).output
    files = [path.stem for path in Path(common.__file__).parent.glob("*.py")
             if path.read_text(encoding="utf-8").startswith(f'"""`emcas {path.stem}`: ')]
    assert sorted(NAMES) == sorted(files)
    for panel, names in PANELS.items():
        assert f" {panel} " in shown
        for name in names:
            assert len(sentence(name)) > 10
            assert sentence(name) in shown


def test_table_shows_units_and_numbers() -> None:
    """Brackets are printed, numbers have four digits, None is a dash, and names are complete."""
    with common.out.capture() as shown:
        common.out.print(common.table(["of", ">[deg]"], [["a_name[1]", 1.23456], ["[b]", None]], "Rates [1]"), width=18)
    rows = [[cell.strip() for cell in line.strip("\u2502\u2503").replace("\u2503", "\u2502").split("\u2502")]
            for line in shown.get().splitlines() if set(line) & set("\u2502\u2503")]
    assert "Rates [1]" in shown.get()
    assert rows[0] == ["of", "[deg]"]
    assert "".join(row[0] for row in rows[1:]) == "a_name[1][b]"
    assert [row[1] for row in rows[1:] if row[1]] == ["1.235", "\u2013"]


def words(command: object, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Return the words of every command, including groups and their commands."""
    members = getattr(command, "commands", {})
    return [path, *(inner for name, each in members.items() for inner in words(each, (*path, name)))]


@pytest.mark.parametrize("command", words(get_command(app)), ids=" ".join)
def test_help_of_every_command_shows_no_types(command: tuple[str, ...]) -> None:
    done = CliRunner(env={"COLUMNS": "200"}).invoke(app, [*command, "--help"])
    assert done.exit_code == 0, done.output
    assert "--help" in done.output
    assert "<" not in done.output


def test_help_breaks_no_line_within_a_paragraph() -> None:
    done = CliRunner(env={"COLUMNS": "400"}).invoke(app, ["validate", "--help"])
    (paragraph,) = (line for line in done.output.splitlines() if "Exit code 0" in line)
    assert "no requirement is judged." in paragraph


def test_unknown_command_is_refused() -> None:
    assert "No such command" in refusal("simulat")


@given(st.floats(-1e5, 1e5), st.sampled_from(["+.4f", ".3g", "#.3g", ".0f", "+.0f"]))
def test_zero_is_printed_without_sign(value: float, form: str) -> None:
    text = rounded(value, form)
    assert float(text) == float(format(value, form))
    assert float(text) != 0.0 or text[0] not in "+-"


def test_missing_numbers_are_shown_as_words_or_dashes() -> None:
    assert [rounded(x, ".3g") for x in (inf, -inf, nan)] == ["–"] * 3
    assert [number(x) for x in (-0.0, -1e-5, inf, nan, None)] == ["0", "-1e-05", "not reached", "–", "–"]
    assert [number(x) for x in (9999.4, 9999.5, -9999.6, 12345.6)] == ["9999", "10000", "-10000", "12346"]


def test_step_that_does_not_settle_names_the_waiting_time(tmp_path: Path) -> None:
    page = tmp_path / "step.html"
    done = CliRunner(env={"COLUMNS": "120"}).invoke(app, ["simulate", "--step", "10", "--stop", "0.08", "--model",
                                                          "second-order", "--kernel", "python", "--plot", str(page)])
    assert done.exit_code == 0, done.output
    rows = dict(line.strip("│ ").split(" │ ") for line in done.output.splitlines() if " │ " in line)
    shown = {name.strip(): value.strip() for name, value in rows.items()}
    # The command steps at 50 of 80 ms. The angle must stay in the band for the last third of the remaining 30 ms.
    assert (shown["settling_time_s"], shown["rise_time_s"]) == ("not within 0.02 s", "not within 0.03 s")
    assert shown["sustained_rate_deg_per_s"] == "not reached"
    text = page.read_text(encoding="utf-8")
    for figure, waited in (("settling time", 0.02), ("rise time", 0.03)):
        assert f'<td>{figure}</td><td class="n">not within {waited} s</td>' in text


@pytest.mark.parametrize(("code", "message"), [
    (errno.EACCES, "x.csv: cannot be written: permission denied; choose another path"),
    (errno.ENOSPC, "x.csv: cannot be written: the disk is full; free some space or choose another path"),
    (errno.EISDIR, "x.csv: cannot be written: it is a folder; choose a file"),
    (errno.ENOENT, "x.csv: cannot be read: there is no such file or folder; check its name"),
    (errno.EIO, "x.csv: cannot be written: Input/output error; choose another path")])
def test_system_errors_name_file_and_remedy(code: int, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit), common.failures():
        raise OSError(code, "Input/output error", "x.csv")
    assert " ".join(capsys.readouterr().err.split()) == f"error: {message}"


def test_error_without_a_file_is_shown_unchanged() -> None:
    assert in_words(OSError("no more")) == "no more"


@pytest.mark.parametrize("command", ["parameters -p {}", "simulate --input {}", "report --mission {}",
                                     "identify backlash {}", "ssp check {}", "tune {}"])
def test_unreadable_inputs_are_named_with_the_reason(command: str, tmp_path: Path) -> None:
    binary = tmp_path / "b.toml"
    binary.write_bytes(b"\xb1\x00" * 50)
    inputs = [(tmp_path, "it is a folder"), (tmp_path / "none.toml", "there is no such file")]
    if not command.startswith("ssp"):  # an archive is not a text
        inputs.append((binary, "it is not a text file in UTF-8 (byte 0)"))
    for path, reason in inputs:
        message = refusal(*command.format(path).split())
        assert f"{path}: cannot be read: {reason}" in message
        assert "Errno" not in message
        assert "codec" not in message


def test_decoding_error_names_the_byte() -> None:
    with pytest.raises(UnicodeDecodeError) as caught:
        b"ab\xff".decode("utf-8")
    assert "(byte 2)" in unreadable("x", caught.value)


def test_long_computations_are_announced_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    with common.failures():
        LOG.info("compiling the actuator x (once, up to a minute) ...")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "compiling the actuator x" in printed.err
    logging.getLogger("another").info("not shown")
    assert capsys.readouterr().err == ""


def test_progress_shows_the_time_left() -> None:
    with common.progress_bar() as bars:
        step = common.stepper(bars, "test")
        step("one", 1, 4)
        assert bars.tasks[0].total == 4
        assert any(type(column).__name__ == "TimeRemainingColumn" for column in bars.columns)


def test_compiling_is_announced_before_it_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    class Fake:
        version = "fake"

        def library(self, *_: object) -> bytes:
            assert "compiling the actuator elastic" in capsys.readouterr().err
            return b"library"

    monkeypatch.setattr(library, "cache_directory", lambda: tmp_path)
    with common.failures():
        target = library._compile(Fake(), PLATFORMS["linux64"], "x", "elastic", 1)  # type: ignore[arg-type]
    assert target.read_bytes() == b"library"


@pytest.mark.parametrize(("measured", "beyond", "shown"), [
    (60.0, True, "> 60"), (2.0, True, "< 2"), (14.325, False, "14.32"), (None, False, "–"), (-0.0, False, "0")])
def test_table_of_verdicts_shows_bounds(measured: float | None, beyond: bool, shown: str) -> None:
    """A figure beyond the measured range is shown as a bound."""
    table = summary_table("criterion", [Judged("", "x", "X", measured, ">=", 10.0, "Hz", beyond=beyond)])
    assert list(table.columns[1].cells) == [shown]

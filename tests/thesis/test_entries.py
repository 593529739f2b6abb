"""The registry has every entry of the thesis's two lists; the command, its files and its refusals."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner, Result

from docs.thesis.__main__ import EPILOG, app
from docs.thesis.entries import ENTRIES, FIGURES, TABLES, find
from docs.thesis.entry import DRAWING, HARDWARE, REASONS, TEST_DATA, Entry, Shown
from docs.thesis.runs import Runs
from docs.thesis.study import NOT_FINISHED, OWN, REPRODUCED, SIMULATED, Outcome, carry_out
from docs.thesis.study import Result as Whole
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters

ROOT = Path(__file__).resolve().parents[2]
# Both lists of the thesis as they are numbered: figures of each chapter, and tables throughout, without a gap.
LISTED = [*(f"Figure {chapter}.{k}" for chapter, count in {1: 12, 2: 8, 3: 40, 4: 4, 5: 30}.items()
            for k in range(1, count + 1)), *(f"Table {k}" for k in range(1, 21))]
# One of each kind of picture and table, and what the text of the thesis gives numbers for; all together take a minute.
SOME = ("1.4", "2.1", "3.6", "3.18", "3.23", "3.38", "4.2", "5.16", "5.19", "5.30", "Table 1", "Table 4", "Table 12",
        "Table 17", "Table 20")


def emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Mapping[str, Any], str, str]:
    """JSON by entry, page and output of a run of some entries."""
    folder = tmp_path_factory.mktemp("thesis")
    chosen = [word for name in SOME for word in ("--only", name)]
    done = emcas(*chosen, "--output", str(folder / "t.html"), "--json", str(folder / "t.json"))
    assert done.exit_code == 0, done.output
    document = json.loads((folder / "t.json").read_text(encoding="utf-8"))
    return ({entry["entry"]: entry for entry in document["entries"]}, (folder / "t.html").read_text(encoding="utf-8"),
            done.output)


def test_every_entry_of_both_lists_is_there_once_and_in_order() -> None:
    assert [entry.name for entry in ENTRIES] == LISTED
    assert [*FIGURES, *TABLES] == [*ENTRIES]


def test_an_entry_is_shown_or_has_one_of_the_reasons() -> None:
    for entry in ENTRIES:
        assert (entry.show is None) == (entry.reason in REASONS), entry.name
        assert entry.title
    # The thesis's own test results are not in its text.
    assert {e.number for e in FIGURES if e.reason == TEST_DATA} == {"5.19", "5.25"}
    # All kinds of actuation that it names have a model here.
    assert all(e.show for e in FIGURES if e.number in {f"1.{k}" for k in range(4, 13)})


def test_what_the_thesis_draws_as_a_structure_is_not_called_reproduced() -> None:
    assert [e.number for e in ENTRIES if e.structure] == [*(f"1.{k}" for k in range(4, 13)), "4.2", "5.15", "5.16"]
    result = Whole(Runs().subject.identification, tuple(
        Outcome(entry, Shown("") if entry.show else None) for entry in ENTRIES))
    assert result.counts[SIMULATED] == 12
    reasons = [entry.reason for entry in ENTRIES if entry.reason]
    assert f"12 shown by simulation, {len(reasons)} not shown: {reasons.count(DRAWING)} drawings, " in result.headline


def test_reproduced_is_what_meets_the_thesis_and_says_what() -> None:
    """Its text has these numbers and curves; of all else what is shown are the set's own values."""
    by_status: dict[str, list[str]] = {}
    for entry in ENTRIES:
        by_status.setdefault(Outcome(entry, Shown("") if entry.show else None).status, []).append(entry.name)
    assert by_status[REPRODUCED] == ["Figure 2.2", "Figure 3.4", "Table 1", "Table 2", "Table 4", "Table 5"]
    assert all(bool(entry.met) == (entry.name in by_status[REPRODUCED]) for entry in ENTRIES)
    for lost in ("Figure 3.24", "Figure 4.4", "Figure 5.18", *(f"Table {k}" for k in (3, 7, 12, 14, 18, 19, 20))):
        assert lost in by_status[OWN], lost
    assert {"Table 6", "Table 11"} == {*by_status[HARDWARE]}


def test_what_is_reproduced_meets_the_numbers_it_says() -> None:
    outcomes = {o.entry.name: o.shown for o in carry_out(Runs(), find(["2.2", "3.4", "Table 1", "Table 2", "Table 4",
                                                                       "Table 5"])).outcomes}
    rows = {name: shown.table.as_dicts() for name, shown in outcomes.items() if shown and shown.table}
    values = load_parameters().values
    for row in rows["Figure 2.2"]:  # (2.6): R = (d/l)/cos^2, to the seventh digit
        lever = np.radians(row["fin angle [deg]"]) + values["kinematics.initial_angle"]
        expected = values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(lever)**2
        assert row["reduction ratio"] == pytest.approx(expected, rel=1e-7)
    asked = rows["Figure 3.4"][0]
    assert (asked["slope [A/V]"], asked["offset [A]"]) == (pytest.approx(8.19), pytest.approx(-0.015))
    assert "42 to 139 times" in getattr(outcomes["Table 1"], "caption", "")
    # The range is met to the accuracy: 20 less 0.2 deg.
    assert {19.8, 0.2, 220.0, 200.0, 10.0} == {round(float(row["limit"]), 6) for row in rows["Table 2"]}
    assert [row["coefficient"] for row in rows["Table 4"]] == [0.208, 0.018]
    # Its five rows and no other.
    assert [(row[""], row["value"].split()[0]) for row in rows["Table 5"]] == [
        ("drive.current_gain", "8.19"), ("drive.current_offset", "-0.015"), ("drive.transport_delay", "3.7"),
        ("drive.kp", "5"), ("drive.ki", "0.1")]
    assert all(row["source"] == "thesis" for row in rows["Table 5"])


def test_what_the_thesis_has_not_is_said() -> None:
    outcomes = {o.entry.name: o.shown for o in carry_out(Runs(), find(["Table 3", "Table 18", "Table 19"])).outcomes}
    said = {name: getattr(shown, "unknown", "") for name, shown in outcomes.items()}
    assert "number of poles" in said["Table 3"]
    assert "setpoint weight" in said["Table 18"]
    assert "setpoint weight" in said["Table 19"]


def test_notes_name_what_is_there() -> None:
    for entry in ENTRIES:
        for path in re.findall(r"[\w/]+\.(?:py|md|toml)", entry.note):
            assert (ROOT / path).is_file(), f"{entry.name}: {path}"
        for name in re.findall(r"(?:Figure|Table) [\d.]*\d", entry.note):
            assert name in LISTED, f"{entry.name}: {name}"


def test_entries_are_found_by_number_and_by_name() -> None:
    assert [e.name for e in find(["Table 20", "5.18", "figure 1.4", "table4"])] == [
        "Figure 1.4", "Figure 5.18", "Table 4", "Table 20"]
    assert find([]) == ENTRIES


@pytest.mark.parametrize(("name", "near"), [
    ("4", "did you mean Table 4?"), ("5.81", "did you mean 5.8"), ("Figure 9.9", "did you mean Figure"),
    ("Table 21", "did you mean Table 2"), ("", "name a figure by number")])
def test_a_name_that_is_none_is_refused_with_one_that_is(name: str, near: str, tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=re.escape(near)):
        find(["5.18", name])
    done = emcas("--only", name, "-o", str(tmp_path / "t.html"))
    assert done.exit_code == 2
    assert not (tmp_path / "t.html").exists()


def test_the_page_has_each_entry_with_its_conditions_and_what_is_not_known(
        written: tuple[Mapping[str, Any], str, str]) -> None:
    entries, page, output = written
    assert {entry.name for entry in find(SOME)} == set(entries)
    for name, entry in entries.items():
        assert f"{name}</strong>" in page or f">{name}: " in page
        if entry["status"] in (REPRODUCED, OWN, SIMULATED):
            assert entry["conditions"] in unescape(page)
            assert entry["rows"] or entry["picture"]
    pictures = re.findall(r'<svg role="img" aria-label="([^"]*)"', page)
    assert len(pictures) == sum(entry.get("picture", False) for entry in entries.values())
    assert all(re.match(r"Figure [\d.]+, .{20}", words) for words in pictures)
    assert "test data, not published" in page
    assert {name for name, entry in entries.items() if entry["status"] == SIMULATED} == {
        "Figure 1.4", "Figure 4.2", "Figure 5.16"}
    assert "3 shown by simulation, 1 not shown: 1 test data, not published<" in page
    bare = re.sub(r'<script>.*?</script>|xmlns(:\w+)?="[^"]*"|"-//[^"]*" *"[^"]*"', "", page, flags=re.DOTALL)
    assert "http" not in bare  # nothing is fetched, and by a script neither
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|WebSocket|sendBeacon", page)
    assert "Figure 5.30" in output


def test_every_simulated_entry_says_what_is_an_estimate(written: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = written
    for name in ("Figure 3.18", "Figure 5.30", "Table 12"):
        assert "estimate" in entries[name]["unknown"]


def test_numbers_that_the_text_of_the_thesis_gives(written: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = written
    table1 = {row[""]: row["with Table 1's inertia and mass"] for row in entries["Table 1"]["rows"]}
    # 423 and 1396 rad/s by (2.53) and (2.55) with the rod and the inertia of Table 1, to three digits.
    assert table1["in tension [Hz]"] * 6.2832 == pytest.approx(423.0, rel=2e-3)
    assert table1["in torsion [Hz]"] * 6.2832 == pytest.approx(1396.0, rel=2e-3)
    assert [row["coefficient"] for row in entries["Table 4"]["rows"]] == [0.208, 0.018]
    limits = [row["limit"] for row in entries["Table 20"]["rows"]]
    assert {0.2, 220.0, 200.0, 10.0} <= set(limits)


def test_both_readings_of_the_drives_gains(written: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = written
    as_set, other = entries["Figure 3.6"]["rows"]
    values = load_parameters().values
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    # A proportional loop around a winding: kp/(kp + R) is reached at once, with the time constant L/(kp + R).
    for row, kp in ((as_set, values["drive.kp"]), (other, 0.208 * values["drive.kp"])):
        assert row["reached at once [%]"] == pytest.approx(100.0 * kp / (kp + resistance))
        assert row["time constant [ms]"] == pytest.approx(1e3 * inductance / (kp + resistance))


def test_what_is_switched_off_is_missed(written: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = written
    with_it, without = entries["Figure 4.2"]["rows"]
    assert without["overshoot [%]"] > with_it["overshoot [%]"] + 1.0
    warm_on, warm_off, cold_on, cold_off = (row["rms error [deg]"] for row in entries["Figure 5.16"]["rows"])
    assert warm_off > 1.2 * warm_on
    assert cold_off > max(cold_on, warm_off)


def test_the_lever_is_as_fast_both_ways_only_without_assembly_angle(
        written: tuple[Mapping[str, Any], str, str]) -> None:
    rows = {row["assembly angle [deg]"]: row for row in written[0]["Figure 2.1"]["rows"]}
    apart = {angle: row["negative [deg/s]"] - row["positive [deg/s]"] for angle, row in rows.items()}
    # Without an angle friction alone is left, by some hundredths of the viscous damping.
    assert abs(apart[0.0]) < 0.1 * apart[10.0]
    assert apart[10.0] > apart[5.0] > apart[2.5] > abs(apart[0.0])


def test_backlash_is_found_again(written: tuple[Mapping[str, Any], str, str]) -> None:
    values = {row[""]: row["value"] for row in written[0]["Figure 3.38"]["rows"]}
    gap = values["the gap itself, at fin angle 0 [deg]"]
    # 0.05 mm at an arm of 50 mm, mounted at 5 deg: 0.0573 cos^2 5 deg. Beside it the drive line gives a little.
    assert gap == pytest.approx(0.0573 * 0.9924, rel=2e-3)
    assert gap < values["identified [deg]"] < 1.1 * gap


def test_only_some_entries_write_no_page_unless_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = emcas("--only", "3.2", "--json", "t.json")
    assert done.exit_code == 0, done.output
    assert "Figure 3.2" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["t.json"]


@pytest.mark.drawn
def test_the_same_set_gives_the_same_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)  # the page has the command as it was given
        assert emcas("--only", "5.8", "--only", "3.4", "-o", "page.html").exit_code == 0
    assert (tmp_path / "a" / "page.html").read_bytes() == (tmp_path / "b" / "page.html").read_bytes()


def test_parameters_are_those_of_the_files(tmp_path: Path) -> None:
    (tmp_path / "stiff.toml").write_text('[friction]\nviscous.positive = "2e-3 N*m*s/rad"\n', encoding="utf-8")
    done = emcas("--only", "3.27", "-p", str(tmp_path / "stiff.toml"), "-o", str(tmp_path / "t.html"), "--json",
                 str(tmp_path / "t.json"))
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert document["differences"] == ["friction.viscous.positive"]
    positive = document["entries"][0]["rows"][0]
    assert positive["parameter [N.m.s/rad]"] == 2e-3
    assert positive["viscous coefficient, rig [N.m.s/rad]"] == pytest.approx(2e-3, rel=0.01)  # the fin's inertia: 0.4 %


def test_what_a_set_does_not_allow_is_told_and_the_rest_shown(tmp_path: Path) -> None:
    # No command beyond 0.2 deg: it takes 5 deg to find a backlash.
    (tmp_path / "narrow.toml").write_text('[command]\nlimit = "0.2 deg"\n', encoding="utf-8")
    done = emcas("--only", "3.38", "--only", "5.20", "-p", str(tmp_path / "narrow.toml"), "-o",
                 str(tmp_path / "t.html"), "--json", str(tmp_path / "t.json"))
    assert done.exit_code == 1
    assert "not finished: Figure 3.38" in done.output
    document = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert {entry["entry"]: entry["status"] for entry in document["entries"]} == {
        "Figure 5.20": OWN, "Figure 3.38": NOT_FINISHED}
    assert "sweep at least 5 deg" in (tmp_path / "t.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["3.27", pytest.param("3.31", marks=pytest.mark.slow)])
def test_friction_that_the_rig_cannot_overcome_is_said_in_a_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "stuck.toml").write_text('[friction]\nfin_coulomb = "1000 N*m"\n', encoding="utf-8")
    done = emcas("--only", name, "-p", str(tmp_path / "stuck.toml"))
    assert done.exit_code == 1
    assert isinstance(done.exception, SystemExit)
    said, = (line for line in done.output.splitlines() if line.startswith("not finished: "))
    assert said.startswith(f"not finished: Figure {name}: the friction rig's motor moves")
    assert "friction.fin_coulomb" in said


@pytest.mark.parametrize("text", [EPILOG, *((ROOT / name).read_text(encoding="utf-8") for name in (
    "README.md", "docs/tools/thesis.md"))], ids=["help", "README.md", "thesis.md"])
def test_commands_that_are_written_are_ones_it_takes(text: str) -> None:
    lines = re.findall(r"python -m docs\.thesis (-[^`\n]*)", text)
    assert lines
    for line in lines:
        given = get_command(app).make_context("thesis", shlex.split(line)).params
        find(given["only"] or ())


def test_help_has_examples_and_no_types() -> None:
    shown = emcas("--help")
    assert shown.exit_code == 0
    assert "python -m docs.thesis --only 5.18" in shown.output
    assert "<" not in shown.output


@pytest.mark.parametrize("arguments", [("--output", "x.pdf"), ("--json", "x.txt"), ("--output", "none/x.html"),
                                       ("--json", "none/x.json"), ("-p", "bad.toml"), ("--onyl", "3.2")])
def test_a_request_that_cannot_be_carried_out_writes_nothing(arguments: tuple[str, ...], tmp_path: Path,
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text("nonsense = 1\n", encoding="utf-8")
    assert emcas(*arguments).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.slow
def test_it_takes_a_set_by_name_and_its_page_says_the_command(tmp_path: Path) -> None:
    """As a program, from the checkout; nothing on standard error, where there is no terminal."""
    page = tmp_path / "t.html"
    done = subprocess.run([sys.executable, "-m", "docs.thesis", "--only", "3.2", "-p", "drive-pi", "-o", page],
                          cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"python -m docs.thesis --only 3.2 -p drive-pi -o {page}" in unescape(page.read_text(encoding="utf-8"))


def test_the_package_needs_no_page_of_the_documentation() -> None:
    for path in (ROOT / "emcas_fmu").rglob("*.py"):
        assert not re.search(r"^\s*(?:from|import) docs\b", path.read_text(encoding="utf-8"), re.MULTILINE), path


def test_what_was_not_found_names_no_temporary_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(files: list[Path], _: object) -> None:
        raise EmcasError(f"{files[0]}: too few rows")

    monkeypatch.setattr("docs.thesis.kinematics.identification.identify", nothing)
    outcome, = carry_out(Runs(), find(["3.38"])).outcomes
    assert outcome.stopped == "backlash.csv: too few rows"


def test_a_fault_of_the_program_is_no_outcome() -> None:
    def broken(_: Runs) -> Shown:
        raise AssertionError

    with pytest.raises(AssertionError):
        carry_out(Runs(), [Entry("Figure", "5.18", "broken", broken)])

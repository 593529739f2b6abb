"""The registry contains every figure and table of the thesis; the command, its files and errors."""

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
# The thesis numbers figures by chapter and tables throughout, without gaps.
LISTED = [*(f"Figure {chapter}.{k}" for chapter, count in {1: 12, 2: 8, 3: 40, 4: 4, 5: 30}.items()
            for k in range(1, count + 1)), *(f"Table {k}" for k in range(1, 21))]
# One of each kind of picture and table, and entries with numbers in the thesis's text; all entries take a minute.
SOME = ("1.4", "2.1", "3.6", "3.18", "3.23", "3.38", "4.2", "5.16", "5.19", "5.30", "Table 1", "Table 4", "Table 12",
        "Table 17", "Table 20")


def emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Mapping[str, Any], str, str]:
    """JSON by entry, page, and terminal output of a run of some entries."""
    folder = tmp_path_factory.mktemp("thesis")
    chosen = [word for name in SOME for word in ("--only", name)]
    result = emcas(*chosen, "--output", str(folder / "t.html"), "--json", str(folder / "t.json"))
    assert result.exit_code == 0, result.output
    document = json.loads((folder / "t.json").read_text(encoding="utf-8"))
    return ({entry["entry"]: entry for entry in document["entries"]}, (folder / "t.html").read_text(encoding="utf-8"),
            result.output)


def test_registry_lists_every_figure_and_table_in_order() -> None:
    assert [entry.name for entry in ENTRIES] == LISTED
    assert [*FIGURES, *TABLES] == [*ENTRIES]


def test_entry_is_shown_or_has_a_reason() -> None:
    for entry in ENTRIES:
        assert (entry.show is None) == (entry.reason in REASONS), entry.name
        assert entry.title
    # The thesis's text does not contain its test results.
    assert {e.number for e in FIGURES if e.reason == TEST_DATA} == {"5.19", "5.25"}
    # Every kind of actuation in the thesis has a model.
    assert all(e.show for e in FIGURES if e.number in {f"1.{k}" for k in range(4, 13)})


def test_drawn_structures_are_shown_by_simulation() -> None:
    assert [e.number for e in ENTRIES if e.structure] == [*(f"1.{k}" for k in range(4, 13)), "4.2", "5.15", "5.16"]
    study = Whole(Runs().subject.identification, tuple(
        Outcome(entry, Shown("") if entry.show else None) for entry in ENTRIES))
    assert study.counts[SIMULATED] == 12
    reasons = [entry.reason for entry in ENTRIES if entry.reason]
    assert f"12 shown by simulation, {len(reasons)} not shown: {reasons.count(DRAWING)} drawings, " in study.headline


def test_only_entries_with_numbers_in_the_thesis_are_reproduced() -> None:
    """Other entries show the values of the parameter set."""
    by_status: dict[str, list[str]] = {}
    for entry in ENTRIES:
        by_status.setdefault(Outcome(entry, Shown("") if entry.show else None).status, []).append(entry.name)
    assert by_status[REPRODUCED] == ["Figure 2.2", "Figure 3.4", "Table 1", "Table 2", "Table 4", "Table 5"]
    assert all(bool(entry.met) == (entry.name in by_status[REPRODUCED]) for entry in ENTRIES)
    assert {"Figure 3.24", "Figure 4.4", "Figure 5.18",
            *(f"Table {k}" for k in (3, 7, 12, 14, 18, 19, 20))} <= set(by_status[OWN])
    assert {"Table 6", "Table 11"} == {*by_status[HARDWARE]}


def test_reproduced_entries_have_the_numbers_of_the_thesis() -> None:
    outcomes = {o.entry.name: o.shown for o in carry_out(Runs(), find(["2.2", "3.4", "Table 1", "Table 2", "Table 4",
                                                                       "Table 5"])).outcomes}
    rows = {name: shown.table.as_dicts() for name, shown in outcomes.items() if shown and shown.table}
    values = load_parameters().values
    for row in rows["Figure 2.2"]:  # (2.6): R = (d/l)/cos^2, to the seventh digit
        lever = np.radians(row["fin angle [deg]"]) + values["kinematics.initial_angle"]
        expected = values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(lever)**2
        assert row["reduction ratio"] == pytest.approx(expected, rel=1e-7)
    line = rows["Figure 3.4"][0]
    assert (line["slope [A/V]"], line["offset [A]"]) == (pytest.approx(8.19), pytest.approx(-0.015))
    assert "42 to 139 times" in getattr(outcomes["Table 1"], "caption", "")
    # 19.8 is the range of 20 deg less the accuracy of 0.2 deg.
    assert {19.8, 0.2, 220.0, 200.0, 10.0} == {round(float(row["limit"]), 6) for row in rows["Table 2"]}
    assert [row["coefficient"] for row in rows["Table 4"]] == [0.208, 0.018]
    assert [(row[""], row["value"].split()[0]) for row in rows["Table 5"]] == [
        ("drive.current_gain", "8.19"), ("drive.current_offset", "-0.015"), ("drive.transport_delay", "3.7"),
        ("drive.kp", "5"), ("drive.ki", "0.1")]
    assert all(row["source"] == "thesis" for row in rows["Table 5"])


def test_tables_name_values_that_the_thesis_lacks() -> None:
    outcomes = {o.entry.name: o.shown for o in carry_out(Runs(), find(["Table 3", "Table 18", "Table 19"])).outcomes}
    for name, lacking in (("Table 3", "number of poles"), ("Table 18", "setpoint weight"),
                          ("Table 19", "setpoint weight")):
        assert lacking in getattr(outcomes[name], "unknown", ""), name


def test_notes_name_existing_files_and_entries() -> None:
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
def test_unknown_entry_is_refused_with_a_similar_name(name: str, near: str, tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=re.escape(near)):
        find(["5.18", name])
    result = emcas("--only", name, "-o", str(tmp_path / "t.html"))
    assert result.exit_code == 2
    assert not (tmp_path / "t.html").exists()


def test_page_has_each_entry_with_its_conditions(
        outputs: tuple[Mapping[str, Any], str, str]) -> None:
    entries, page, output = outputs
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
    assert "http" not in bare  # nothing is loaded, also not by a script
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|WebSocket|sendBeacon", page)
    assert "Figure 5.30" in output


def test_simulated_entries_name_the_estimates(outputs: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = outputs
    for name in ("Figure 3.18", "Figure 5.30", "Table 12"):
        assert "estimate" in entries[name]["unknown"]


def test_entries_have_the_numbers_of_the_thesis_text(outputs: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = outputs
    table1 = {row[""]: row["with Table 1's inertia and mass"] for row in entries["Table 1"]["rows"]}
    # 423 and 1396 rad/s by (2.53) and (2.55) with the rod and the inertia of Table 1, to three digits.
    assert table1["in tension [Hz]"] * 6.2832 == pytest.approx(423.0, rel=2e-3)
    assert table1["in torsion [Hz]"] * 6.2832 == pytest.approx(1396.0, rel=2e-3)
    assert [row["coefficient"] for row in entries["Table 4"]["rows"]] == [0.208, 0.018]
    limits = [row["limit"] for row in entries["Table 20"]["rows"]]
    assert {0.2, 220.0, 200.0, 10.0} <= set(limits)


def test_both_readings_of_the_drives_gains_agree_with_closed_forms(outputs: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = outputs
    as_set, other = entries["Figure 3.6"]["rows"]
    values = load_parameters().values
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    # A proportional loop around a winding reaches kp/(kp + R) with the time constant L/(kp + R).
    for row, kp in ((as_set, values["drive.kp"]), (other, 0.208 * values["drive.kp"])):
        assert row["reached at once [%]"] == pytest.approx(100.0 * kp / (kp + resistance))
        assert row["time constant [ms]"] == pytest.approx(1e3 * inductance / (kp + resistance))


def test_results_are_worse_without_setpoint_weight_or_compensation(outputs: tuple[Mapping[str, Any], str, str]) -> None:
    entries, _, _ = outputs
    with_it, without = entries["Figure 4.2"]["rows"]
    assert without["overshoot [%]"] > with_it["overshoot [%]"] + 1.0
    warm_on, warm_off, cold_on, cold_off = (row["rms error [deg]"] for row in entries["Figure 5.16"]["rows"])
    assert warm_off > 1.2 * warm_on
    assert cold_off > max(cold_on, warm_off)


def test_lever_is_equally_fast_in_both_directions_only_without_assembly_angle(
        outputs: tuple[Mapping[str, Any], str, str]) -> None:
    rows = {row["assembly angle [deg]"]: row for row in outputs[0]["Figure 2.1"]["rows"]}
    apart = {angle: row["negative [deg/s]"] - row["positive [deg/s]"] for angle, row in rows.items()}
    # Without an angle only friction differs, by some hundredths of the viscous damping.
    assert abs(apart[0.0]) < 0.1 * apart[10.0]
    assert apart[10.0] > apart[5.0] > apart[2.5] > abs(apart[0.0])


def test_simulated_backlash_is_identified(outputs: tuple[Mapping[str, Any], str, str]) -> None:
    values = {row[""]: row["value"] for row in outputs[0]["Figure 3.38"]["rows"]}
    gap = values["the gap itself, at fin angle 0 [deg]"]
    # 0.05 mm at an arm of 50 mm and an angle of 5 deg are 0.0573 cos^2 5 deg. The identification adds compliance.
    assert gap == pytest.approx(0.0573 * 0.9924, rel=2e-3)
    assert gap < values["identified [deg]"] < 1.1 * gap


def test_selected_entries_write_no_page_without_output_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = emcas("--only", "3.2", "--json", "t.json")
    assert result.exit_code == 0, result.output
    assert "Figure 3.2" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["t.json"]


@pytest.mark.drawn
def test_page_is_reproducible(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)  # the page contains the command line
        assert emcas("--only", "5.8", "--only", "3.4", "-o", "page.html").exit_code == 0
    assert (tmp_path / "a" / "page.html").read_bytes() == (tmp_path / "b" / "page.html").read_bytes()


def test_parameter_file_changes_the_entries(tmp_path: Path) -> None:
    (tmp_path / "stiff.toml").write_text('[friction]\nviscous.positive = "2e-3 N*m*s/rad"\n', encoding="utf-8")
    result = emcas("--only", "3.27", "-p", str(tmp_path / "stiff.toml"), "-o", str(tmp_path / "t.html"), "--json",
                   str(tmp_path / "t.json"))
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert document["differences"] == ["friction.viscous.positive"]
    positive = document["entries"][0]["rows"][0]
    assert positive["parameter [N.m.s/rad]"] == 2e-3
    assert positive["viscous coefficient, rig [N.m.s/rad]"] == pytest.approx(2e-3, rel=0.01)  # 0.4 %: fin's inertia


def test_entry_that_a_set_does_not_allow_is_not_finished_and_others_are_shown(tmp_path: Path) -> None:
    # Commands are limited to 0.2 deg, and the identification of backlash needs 5 deg.
    (tmp_path / "narrow.toml").write_text('[command]\nlimit = "0.2 deg"\n', encoding="utf-8")
    result = emcas("--only", "3.38", "--only", "5.20", "-p", str(tmp_path / "narrow.toml"), "-o",
                   str(tmp_path / "t.html"), "--json", str(tmp_path / "t.json"))
    assert result.exit_code == 1
    assert "not finished: Figure 3.38" in result.output
    document = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert {entry["entry"]: entry["status"] for entry in document["entries"]} == {
        "Figure 5.20": OWN, "Figure 3.38": NOT_FINISHED}
    assert "sweep at least 5 deg" in (tmp_path / "t.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["3.27", pytest.param("3.31", marks=pytest.mark.slow)])
def test_error_if_the_rig_cannot_overcome_the_friction(name: str, tmp_path: Path) -> None:
    (tmp_path / "stuck.toml").write_text('[friction]\nfin_coulomb = "1000 N*m"\n', encoding="utf-8")
    result = emcas("--only", name, "-p", str(tmp_path / "stuck.toml"))
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)
    message, = (line for line in result.output.splitlines() if line.startswith("not finished: "))
    assert message.startswith(f"not finished: Figure {name}: the friction rig's motor moves")
    assert "friction.fin_coulomb" in message


@pytest.mark.parametrize("text", [EPILOG, *((ROOT / name).read_text(encoding="utf-8") for name in (
    "README.md", "docs/tools/thesis.md"))], ids=["help", "README.md", "thesis.md"])
def test_documented_commands_are_accepted(text: str) -> None:
    lines = re.findall(r"python -m docs\.thesis (-[^`\n]*)", text)
    assert lines
    for line in lines:
        find(get_command(app).make_context("thesis", shlex.split(line)).params["only"] or ())


def test_help_has_examples_and_no_types() -> None:
    shown = emcas("--help")
    assert shown.exit_code == 0
    assert "python -m docs.thesis --only 5.18" in shown.output
    assert "<" not in shown.output


@pytest.mark.parametrize("arguments", [("--output", "x.pdf"), ("--json", "x.txt"), ("--output", "none/x.html"),
                                       ("--json", "none/x.json"), ("-p", "bad.toml"), ("--onyl", "3.2")])
def test_refused_command_writes_nothing(arguments: tuple[str, ...], tmp_path: Path,
                                        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text("nonsense = 1\n", encoding="utf-8")
    assert emcas(*arguments).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.slow
def test_program_runs_with_a_named_set_and_the_page_has_its_command(tmp_path: Path) -> None:
    """Standard error, which is no terminal, is empty."""
    page = tmp_path / "t.html"
    result = subprocess.run([sys.executable, "-m", "docs.thesis", "--only", "3.2", "-p", "drive-pi", "-o", page],
                            cwd=ROOT, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert f"python -m docs.thesis --only 3.2 -p drive-pi -o {page}" in unescape(page.read_text(encoding="utf-8"))


def test_package_does_not_import_docs() -> None:
    for path in (ROOT / "emcas_fmu").rglob("*.py"):
        assert not re.search(r"^\s*(?:from|import) docs\b", path.read_text(encoding="utf-8"), re.MULTILINE), path


def test_error_of_an_identification_names_no_temporary_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(files: list[Path], _: object) -> None:
        raise EmcasError(f"{files[0]}: too few rows")

    monkeypatch.setattr("docs.thesis.kinematics.identification.identify", fail)
    outcome, = carry_out(Runs(), find(["3.38"])).outcomes
    assert outcome.stopped == "backlash.csv: too few rows"


def test_programming_error_is_not_caught() -> None:
    def broken(_: Runs) -> Shown:
        raise AssertionError

    with pytest.raises(AssertionError):
        carry_out(Runs(), [Entry("Figure", "5.18", "broken", broken)])

"""`emcas report` of FMUs and parameter files: figures, requirements, pages, and errors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from html.parser import HTMLParser
from math import isnan
from pathlib import Path
from typing import Any

import junitparser
import pytest
from typer.testing import CliRunner
from typer.testing import Result as Done

from emcas_fmu.actuators import NAMES, NONLINEAR
from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.bench.metrics import figures_of, result_name
from emcas_fmu.bench.requirements import Specification, load_requirements
from emcas_fmu.bench.subject import ParameterSubject, Subject
from emcas_fmu.bench.verdict import in_words, judge
from emcas_fmu.bench.writers import plain
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.pages.numbers import number
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.report.acceptance import (
    TESTS,
    Acceptance,
    _of_report,
    as_dict,
    carry_out,
    flat_figures,
    summary,
    write_report,
)
from tests.marks import others_slow

from ..bench.subjects import FIN_PORT, Broken, Play

pytestmark = pytest.mark.acceptance


def emcas(*arguments: object) -> Done:
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


@pytest.fixture(scope="module")
def progress() -> list[tuple[str, int, int]]:
    """The calls of the progress function in the acceptance test of the shipped parameters."""
    return []


@pytest.fixture(scope="module")
def shipped(progress: list[tuple[str, int, int]]) -> Acceptance:
    """The acceptance test of the shipped parameters, by the kernel."""
    with open_subject(None) as subject:
        return carry_out(subject, progress=lambda *each: progress.append(each))


def page(result: Acceptance, folder: Path, date: str = "") -> str:
    write_report(result, folder / "page.html", date)
    return (folder / "page.html").read_text(encoding="utf-8")


RANGE = """[[requirements]]
name = "range"
test = { kind = "step", amplitude = "20 deg" }
figure = "held_angle"
minimum = "19.8 deg"
"""


def specification(folder: Path, limit: str = "1 deg", figure: str = "static_accuracy.grid.hysteresis_deg",
                  sense: str = "maximum", name: str = "hysteresis", more: str = "") -> Path:
    """Write a file with two requirements, on the range and on a figure of the report, and return its path."""
    path = folder / "specification.toml"
    path.write_text(f'{RANGE}[[requirements]]\nname = "{name}"\nfigure = "{figure}"\n{sense} = "{limit}"\n{more}\n',
                    encoding="utf-8")
    return path


def loaded(folder: Path, *arguments: str, model: str = NONLINEAR, **more: str) -> Specification:
    """Return these requirements for an actuator."""
    return load_requirements(specification(folder, *arguments, **more), load_parameters(model=model))


def judge_result(specification: Specification, found: Acceptance) -> list[Any]:
    """Judge requirements on the figures of an existing report."""
    rows = judge(ParameterSubject(load_parameters()), Specification(specification.requirements[1:]))
    return [_of_report(each, found.outcomes, specification.file, optional=False) for each in rows]


@pytest.mark.slow
def test_fmu_and_parameter_set_give_the_same_figures(native: Path, shipped: Acceptance) -> None:
    """The native FMU gives the kernel's bits, and the Python FMU those of the native FMU (tests/parity)."""
    with open_subject(native) as subject:
        by_fmu = carry_out(subject)
    figures, expected = dict(flat_figures(by_fmu.outcomes)), dict(flat_figures(shipped.outcomes))
    assert figures.keys() == expected.keys()
    assert [name for name, value in expected.items()
            if figures[name] != value and not (isnan(figures[name]) and isnan(value))] == []
    assert [j.measured for j in by_fmu.judged] == [j.measured for j in shipped.judged]
    assert by_fmu.about.parameters_sha256 == shipped.about.parameters_sha256
    assert by_fmu.about.estimates == shipped.about.estimates
    assert by_fmu.about.guid.startswith("{")


def test_verdicts_equal_those_of_validate(shipped: Acceptance) -> None:
    parameters = load_parameters()
    assert list(shipped.judged) == judge(ParameterSubject(parameters), load_requirements(None, parameters))
    assert shipped.passed  # the documentation says so


def test_note_if_the_chosen_load_differs_from_the_loads_of_the_requirements(
        shipped: Acceptance, tmp_path: Path) -> None:
    chosen = replace(shipped, load=400.0)
    note = ("tests and mission have a load of 400 N.m, but requirements are judged under their own: 100 N.m: "
            "accuracy_loaded, endurance, load_recovery, load_step, loaded_rate, loaded_rate_low_supply, rated_current, "
            "rest_loaded, symmetry; 250 N.m: torque_reserve")
    assert note in page(chosen, tmp_path)
    assert f"[yellow]note:[/] {note}" in list(summary(chosen))
    assert not shipped.load_note


@pytest.mark.parametrize(("test", "runs"), [
    ("step_response", "jump"), ("slew_rate", "jump"), ("frequency_response", "sweep"), ("mission", "usage")])
def test_report_has_every_figure_of_its_runs_under_its_name(test: str, runs: str, shipped: Acceptance) -> None:
    for figures in shipped.outcomes[test].figures.values():
        assert set(figures) - {"duration_s"} == {result_name(name)[0] for name in figures_of(runs)}


def test_figures_are_consistent(shipped: Acceptance) -> None:
    """These relations hold for any gains."""
    figures = {name: outcome.figures for name, outcome in shipped.outcomes.items()}
    slew = figures["slew_rate"]
    for direction in ("positive", "negative"):
        rates = [slew[f"{load}_{direction}"]["sustained_rate_deg_per_s"] for load in ("opposing", "unloaded", "aiding")]
        assert rates == sorted(rates)
    grid = figures["static_accuracy"]["grid"]
    # Hysteresis is the difference of two means, each within the largest error; bidirectional accuracy encloses both.
    assert grid["hysteresis_deg"] <= 2.0 * grid["largest_error_deg"]
    assert grid["hysteresis_deg"] <= grid["bidirectional_accuracy_deg"]
    mission = figures["mission"]["synthetic"]
    assert mission["net_energy_j"] == pytest.approx(mission["energy_drawn_j"] - mission["energy_returned_j"])
    assert 0.0 < mission["rms_current_a"] < mission["peak_current_a"]
    assert 0.0 < mission["energy_returned_j"] < mission["energy_drawn_j"]
    stiffness = figures["dynamic_stiffness"]
    assert stiffness["unpowered_below_breakaway"]["friction_locked"]
    # The loops hold the fin where friction and inertia alone do not.
    assert (stiffness["powered"]["least_stiffness_n_m_per_rad"]
            > stiffness["unpowered_above_breakaway"]["least_stiffness_n_m_per_rad"])


class _Page(HTMLParser):
    """Parser that checks that tags are balanced, and lists links and tags."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "br", "wbr"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.drawn
def test_page_has_all_figures_and_parameters_and_loads_no_other_file(
        shipped: Acceptance, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    text = page(shipped, tmp_path)
    parsed = _Page()
    parsed.feed(text)
    assert parsed.open == []
    assert all(link.startswith("#") for link in parsed.links)
    assert text.count("<svg") == 7  # one for each test except thresholds and stepping
    for outcome in shipped.outcomes.values():
        assert f'id="{outcome.name}"' in text
        for q in (q for rows, _ in outcome.tables() for q in rows):
            assert q.how.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("'", "&#39;") in text
    assert text.index("Summary") < text.index("Step response</h2>")
    for name in ("tested by", "checked by", "accepted by"):
        assert f"<th>{name}</th><td></td><td></td><td></td>" in text
    assert "<strong>Estimate.</strong>" in text
    assert "friction-locked" in text
    assert "<th>date</th><td>1970-01-01</td>" in text
    assert "<th>document</th>" not in text
    for name, value in (("supply", "39 V"), ("temperature", "24 °C"), ("rated hinge moment", "100 N·m")):
        assert f"<tr><th>{name}</th><td>{value}" in text
    for name, value in shipped.parameters.items():
        cell = f'<td class="n">{number(value).replace("-", "−")}</td>'
        assert f"<code>{name.replace('_', '_<wbr>')}</code></td>{cell}" in text
    assert "required 220°/s" in text  # beside the limited figure
    assert "required 198" not in text  # at 90 % of the supply; the plotted slews have the full one


def test_document_and_revision_are_escaped_in_the_style_sheet(shipped: Acceptance, tmp_path: Path) -> None:
    name = 'AT "7\\"; } body { display: none }\n</style><b>'
    write_report(shipped, tmp_path / "page.html", "2026-03-31", name, name)
    text = (tmp_path / "page.html").read_text("utf-8")
    assert "<th>date</th><td>2026-03-31</td>" in text
    line = re.search(r'@bottom-left \{ content: "([^"\n]*)"; font', text)
    assert line is not None
    assert "<" not in line[1]
    assert re.sub(r"\\([0-9a-f]+) ", lambda found: chr(int(found[1], 16)), line[1]) == f"{name} rev. {name}"


@pytest.mark.slow
@pytest.mark.drawn
def test_files_are_reproducible_and_contain_no_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    (tmp_path / "my_actuator.toml").write_text('[command]\nlimit = "15 deg"\n', encoding="utf-8")
    written = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        monkeypatch.chdir(folder)  # the page contains the command line
        found = emcas("../my_actuator.toml", "-o", "report.html", "--json", "figures.json", "--junit", "junit.xml",
                      "--requirements", specification(folder).name, "--document", "AT-0042", "--revision", "B")
        # A command limit of 15 deg misses the range of 20 deg, and no other requirement.
        assert found.exit_code == 1, found.output
        written.append([(folder / name).read_bytes() for name in ("report.html", "figures.json", "junit.xml")])
        assert all(str(tmp_path).encode() not in data for data in written[-1])
    assert written[0] == written[1]
    document = json.loads(written[0][1])
    judged = {r["name"]: r["passed"] for r in document["requirements"]}
    assert judged == {"range": False, "hysteresis": True}
    assert document["passed"] is False
    assert document["identification"]["file"] == "my_actuator.toml"
    assert document["identification"]["differences"] == ["command.limit"]
    assert set(document["figures"]) == set(TESTS)
    assert "plus_15deg" in document["figures"]["step_response"]
    failures = {case.name for suite in junitparser.JUnitXml.fromfile(str(tmp_path / "one" / "junit.xml"))
                for case in suite if case.result}
    assert failures == {"range"}


def test_command_on_the_shipped_parameters(tmp_path: Path) -> None:
    found = emcas("-o", tmp_path / "report.html", "--requirements", specification(tmp_path), "--date", "2026-03-31")
    assert found.exit_code == 0, found.output
    assert "all 2 requirements are met" in found.output
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "2026-03-31" in text
    assert f"emcas report -o {tmp_path / 'report.html'} --requirements" in text
    missed = emcas("--model", "second-order", "-o", tmp_path / "report.html", "--requirements",
                   specification(tmp_path, sense="minimum"))
    assert missed.exit_code == 1
    assert "1 of 2 requirements is not met" in missed.output


def test_mission_may_be_a_file(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text("time,fin_command\n0,0\n0.1,0.1\n0.5,0.1\n", encoding="utf-8")
    found = emcas("--model", "second-order", "-o", tmp_path / "report.html", "--mission", path, "--json",
                  tmp_path / "figures.json")
    assert found.exit_code == 0, found.output
    document = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    assert document["figures"]["mission"]["file"]["duration_s"] == pytest.approx(0.5)
    assert document["methods"]["mission"]["estimate"] is None
    text, of_mission = (tmp_path / "report.html").read_text(encoding="utf-8").split('<h2 id="mission">')
    assert "unless a test below states others; aero_torque has no effect on this actuator&#39;s motion." in text
    assert "An integral, if the controller has one, answers even smaller commands later." in text
    assert "<strong>Estimate.</strong>" not in of_mission


@pytest.mark.parametrize(("arguments", "message"), [
    (["{tmp}/absent.fmu"], "there is no such file"),
    (["{tmp}/absent.toml"], "cannot be read"),
    (["{tmp}/text.txt"], "neither an FMU nor a parameter file"),
    (["{tmp}/text.fmu"], "not a ZIP archive"),
    (["--date", "yesterday"], "expected a date such as 2026-03-31"),
    (["--load", "-3"], "must be finite and above 0, in N.m"),
    (["--output", "{tmp}/absent/report.html"], "make it first"),
    (["--mission", "{tmp}/text.txt"], "cannot be read as a table of numbers"),
    (["--mission", "{tmp}/instant.csv"], "instant.csv"),
    (["--requirements", "{tmp}/absent.toml"], "cannot be read"),
])
def test_error_names_the_option_and_the_remedy(arguments: list[str], message: str, tmp_path: Path) -> None:
    for name in ("text.txt", "text.fmu"):
        (tmp_path / name).write_text("no table\nno archive\n", encoding="utf-8")
    (tmp_path / "instant.csv").write_text("time,fin_command\n0,0\n", encoding="utf-8")
    found = emcas("-o", tmp_path / "report.html", *(a.replace("{tmp}", str(tmp_path)) for a in arguments))
    assert found.exit_code == 2, found.output
    assert message in " ".join(found.output.split())
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize(("limit", "expected"), [("1 deg", 1.0), ("0.001 rad", 0.05729577951308232), ("6 arcmin", 0.1)])
def test_limit_may_have_any_unit_of_its_quantity(limit: str, expected: float, tmp_path: Path) -> None:
    wanted = loaded(tmp_path, limit).requirements[1]
    assert wanted.limit == pytest.approx(expected, rel=1e-12)
    assert (wanted.shown, wanted.sense) == (("deg", 1.0), "maximum")


@pytest.mark.parametrize(("figure", "limit", "expected"), [
    ("frequency_response.1deg.peak_gain_db", "3 dB", 3.0), ("step_response.plus_1deg.overshoot_percent", "5 %", 5.0),
    ("frequency_response.1deg.lowest_coherence_percent", "90 %", 90.0),
    ("dynamic_stiffness.powered.stiffness_10hz_n_m_per_rad", "1 N.m/deg", 57.29577951308232),
    ("slew_rate.unloaded_positive.peak_rate_deg_per_s", "1 rad/s", 57.29577951308232)])
def test_limit_is_converted_to_the_unit_of_its_figure(figure: str, limit: str, expected: float, tmp_path: Path) -> None:
    wanted = loaded(tmp_path, limit, figure, "minimum").requirements[1]
    assert wanted.limit == pytest.approx(expected, rel=1e-12)
    assert wanted.sense == "minimum"


A = "[[requirements]]\nname = 'a'\n"


@pytest.mark.parametrize(("text", "message"), [
    ("[[requirement", "is not valid TOML: Expected"),
    ("", "requirements is missing; there is cases, requirements"),
    ("[[requirement]]", "unknown key 'requirement'; did you mean requirements?"),
    ("requirements = []", "at least one"),
    (A, "requirements.a: figure is missing; there is name, title, test, figure, maximum, minimum"),
    (A + "figure = 'b.c'\nmaximum = '1 s'", "there is rise_time"),
    (A + "figure = 'b.c.d_s'\nmaximum = 1", "a number with a unit such as s"),
    ("[[requirements]]\nname = 5\nfigure = 'b.c.d_s'\nmaximum = '1 s'", "must be a string"),
    (A + "figure = 'b.c.d_s'\nmaximum = '1'", "has no unit"),
    (A + "figure = 'b.c.d_s'\nmaximum = '1 deg'", "does not measure"),
    (A + "figure = 'b.c.d_db'\nmaximum = '1'", "with a unit such as dB"),
    (A + "figure = 'b.c.d_s'\nmaximum = '1 s'\nunit = 's'", "unknown key 'unit'"),
    (A + "figure = 'b.c.d_s'\nlimit = '1 s'\nsense = '<='", "unknown key 'limit'"),
    (2 * (A + "figure = 'b.c.d_s'\nmaximum = '1 s'\n"), "appears twice"),
])
def test_error_names_the_entry_of_a_requirement(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(EmcasError, match=r"wrong\.toml") as raised:
        load_requirements(path, load_parameters())
    assert message in str(raised.value)


@pytest.mark.parametrize(("figure", "message"), [
    ("static_accuracy.grid.hysteresis", "did you mean static_accuracy.grid.hysteresis_deg?"),
    ("dynamic_stiffness.powered.friction_locked", "there is no such figure that is a number")])
def test_unknown_figure_is_refused(figure: str, message: str, tmp_path: Path, shipped: Acceptance) -> None:
    wanted = loaded(tmp_path, "1 deg" if figure.endswith("_deg") else "1", figure)
    with pytest.raises(EmcasError, match=r"specification\.toml: requirements\.hysteresis\.figure = ") as raised:
        judge_result(wanted, shipped)
    assert message in str(raised.value)


def test_margin_is_negative_if_a_limit_is_missed(shipped: Acceptance, tmp_path: Path) -> None:
    figure = "step_response.plus_1deg.rise_time_s"
    measured = float(dict(flat_figures(shipped.outcomes))[figure])
    for sense, share, passed in (("maximum", 2.0, True), ("maximum", 0.5, False), ("minimum", 0.5, True),
                                 ("minimum", 2.0, False)):
        wanted = loaded(tmp_path, f"{share * measured!r} s", figure, sense)
        (judged,) = judge_result(wanted, shipped)
        assert judged.passed is passed
        expected = (1 if passed else -1) * abs(share - 1.0)
        # The limit is rounded to nine decimals.
        assert judged.margin == pytest.approx(expected * measured, abs=1e-9)
        assert judged.margin_percent == pytest.approx(expected / share * 100.0, rel=1e-5)


@contextmanager
def _opened(subject: Subject) -> Iterator[Subject]:
    yield subject


@pytest.mark.drawn
def test_report_of_an_article_whose_runs_end_early(tmp_path: Path) -> None:
    found = carry_out(Broken(), specification=loaded(tmp_path))
    assert not found.passed
    assert set(found.stopped) == set(TESTS)
    assert [(j.passed, j.skipped, j.measured) for j in found.judged] == [(False, False, None)] * 2
    assert "the bridge is open" in found.judged[1].note
    text = page(found, tmp_path)
    assert f"{len(TESTS)} of {len(TESTS)} tests were not finished" in text
    assert "the bridge is open" in text
    assert as_dict(found)["methods"]["mission"]["stopped"].endswith("the bridge is open")


def test_command_fails_if_runs_end_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emcas_fmu.bench.fmu_subject.open_subject", lambda *_, **__: _opened(Broken()))
    found = emcas("-o", tmp_path / "report.html", "--junit", tmp_path / "junit.xml")
    assert found.exit_code == 1
    assert "Mission profile: not finished: " in found.output
    failed = {case.name for suite in junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
              for case in suite if case.result}
    assert set(TESTS) <= failed


@pytest.mark.drawn
@pytest.mark.parametrize("entry", [
    pytest.param({"controller.position.kp": 0.0, "controller.position.ki": 0.0}, id="dead"),
    pytest.param({"friction.fin_coulomb": 9e3}, id="stuck")])
@pytest.mark.slow
def test_report_of_an_article_that_does_not_move(entry: dict[str, float], tmp_path: Path) -> None:
    found = carry_out(ParameterSubject(load_parameters().with_values(entry)))
    # Requirements without a motion may be met, but none of Table 2.
    assert not found.passed
    assert [j.name for j in found.judged if j.passed and "Table 2" in j.source] == []
    figures = dict(flat_figures(found.outcomes))
    assert isnan(figures["threshold.from_rest.positive_deg"])
    assert isnan(figures["step_response.plus_1deg.rise_time_s"])
    text = page(found, tmp_path)
    assert text.count("deg the gain is below -3 dB already at 2 Hz") == 2
    json.dumps(plain(as_dict(found)), allow_nan=False)


def test_progress_counts_every_test(shipped: Acceptance, progress: list[tuple[str, int, int]]) -> None:
    assert set(shipped.outcomes) == set(TESTS)
    assert [done for _, done, _ in progress] == list(range(len(TESTS) + 2))
    assert {total for *_, total in progress} == {len(TESTS) + 1}


def test_json_has_no_infinity_and_no_nan(shipped: Acceptance) -> None:
    document: Any = plain(as_dict(shipped))
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text)["schema"] == "emcas-acceptance/3"
    grid = document["curves"]["static_accuracy"]["grid"]
    assert grid["error_from_below_deg"][0] is None  # the lowest angle has no approach from below
    assert len(grid["command_deg"]) == len(grid["error_from_above_deg"])


def test_credibility_card_has_figures_of_the_tests(shipped: Acceptance, tmp_path: Path) -> None:
    document: Any = plain(as_dict(shipped))
    facts = {fact["what"]: fact for factor in document["credibility"]["factors"] for fact in factor["facts"]}
    errors = [group["fin_angle_deg"] for group in document["figures"]["stepping"].values()]
    assert facts["accuracy of the stepping, checked with a shorter tick"]["value"] == max(errors)
    static = {what: fact["value"] for what, fact in facts.items() if what.startswith("largest static error, ")}
    assert [*static.values()] == [group["largest_error_deg"]
                                  for group in document["figures"]["static_accuracy"].values()]
    assert "mission profile is made up" in facts["inputs, which the host supplies"]["note"]
    assert {"comparison with an independent integration", "earlier uses and their results"} <= {
        *document["credibility"]["not_done"]}
    text = page(shipped, tmp_path)
    assert all(f"<td>{what}</td>" in text for what in facts)


def test_bandwidth_outside_the_searched_range_is_a_bound(tmp_path: Path) -> None:
    file = tmp_path / "bandwidth.toml"
    file.write_text("".join(f"""[[requirements]]
name = "{name}"
figure = "frequency_response.1deg.bandwidth_3db_hz"
{sense} = "{limit} Hz"
""" for name, sense, limit in (("met", "minimum", 20), ("cannot_tell", "minimum", 70), ("bounded", "maximum", 70))),
                    encoding="utf-8")
    found = carry_out(Play(outputs=FIN_PORT), specification=load_requirements(file, load_parameters()))
    assert [(j.name, j.measured, j.beyond, j.passed) for j in found.judged] == [
        ("met", 60.0, True, True), ("cannot_tell", 60.0, True, False), ("bounded", 60.0, True, False)]
    assert str(found.judged[1]).startswith("cannot_tell: > 60 Hz, required >= 70 Hz")
    text = " ".join(page(found, tmp_path).split())
    assert '1 deg: -3 dB</td><td class="n">&gt; 60 Hz</td>' in text
    assert '<td>-3 dB</td><td class="n">&gt; 60 Hz</td><td class="n">&gt; 60 Hz</td>' in text


@pytest.mark.parametrize(("more", "skipped"), [("", False), ("optional = true", True)])
def test_figure_of_a_missing_output_is_not_applicable(more: str, skipped: bool, tmp_path: Path) -> None:
    wanted = loaded(tmp_path, "5 A", "mission.synthetic.rms_current_a", more=more)
    found = carry_out(Play(outputs=FIN_PORT), specification=wanted)
    assert not found.stopped
    figures = dict(flat_figures(found.outcomes))
    assert not any(part in name for name in figures for part in ("current", "_power_", "energy"))
    assert {"mission.synthetic.peak_angle_deg",
            "slew_rate.unloaded_positive.peak_rate_deg_per_s"} <= set(figures)
    why = found.outcomes["mission"].not_applicable
    assert why["rms_current_a"] == "this actuator has no motor_current"
    assert why["net_energy_j"] == "this actuator has no supply_power"
    # A requirement whose figure has no value is missed, or skipped if it is optional.
    last = found.judged[-1]
    assert (last.passed, last.skipped, last.note) == (
        False, skipped, "not applicable: this actuator has no motor_current")
    assert found.passed is skipped
    assert ("the one requirement is met; 1 more was not judged" if skipped else "1 of 2 requirements is not met"
            ) in in_words(found.judged)
    text = page(found, tmp_path)
    assert "Not applicable: peak current, rms current (this actuator has no motor_current)." in text
    assert as_dict(found)["methods"]["mission"]["not_applicable"]["energy_drawn_j"].endswith("supply_power")


@pytest.mark.drawn
@pytest.mark.parametrize("model", others_slow(
    (name for name in (*NAMES, "elastic+stribeck+heat+faults") if name != NONLINEAR),
    lambda name: name == "second-order"))
def test_report_of_every_actuator(model: str, tmp_path: Path) -> None:
    found = emcas("--model", model, "-o", tmp_path / "report.html", "--json", tmp_path / "figures.json")
    assert found.exit_code in (0, 1), found.output
    document = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    assert document["identification"]["model"] == model
    assert not [name for name, method in document["methods"].items() if method["stopped"]]
    # Every actuator follows a step of 1 deg within a tenth.
    assert abs(document["figures"]["step_response"]["plus_1deg"]["steady_error_deg"]) < 0.1
    assert document["figures"]["frequency_response"]["1deg"]["bandwidth_3db_hz"] > 1.0
    assert model in (tmp_path / "report.html").read_text(encoding="utf-8")

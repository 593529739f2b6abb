"""All commands give the same number for the same quantity of one parameter set."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import unescape
from html.parser import HTMLParser
from math import radians
from typing import Any, NamedTuple

import pytest
from typer.testing import CliRunner

from emcas_fmu.bench.measure import BANDWIDTHS
from emcas_fmu.cli import app
from emcas_fmu.pages.numbers import number
from emcas_fmu.studies.analysis.sweep import _RESOLVED
from emcas_fmu.studies.baseline.model import DIGITS
from emcas_fmu.studies.tuning import optimise

from ..conftest import leave_undrawn

pytestmark = [pytest.mark.acceptance, pytest.mark.slow]  # six commands

# Name: test, figure, limit. The limits are far from the measured values: more digits are shown near a limit.
QUANTITIES: Mapping[str, tuple[str, str, str]] = {
    "bandwidth_1deg": ('kind = "sine", amplitude = "1 deg"', "bandwidth_3db", 'minimum = "5 Hz"'),
    "bandwidth_3p5deg": ('kind = "sine", amplitude = "3.5 deg"', "bandwidth_3db", 'minimum = "5 Hz"'),
    "lag_1deg": ('kind = "sine", amplitude = "1 deg"', "bandwidth_90deg", 'minimum = "5 Hz"'),
    "settling_1deg": ('kind = "step", amplitude = "1 deg", duration = "3 s"', "settling_time", 'maximum = "2 s"'),
    "settling_5deg": ('kind = "step", amplitude = "5 deg", duration = "3 s"', "settling_time", 'maximum = "2 s"'),
    "overshoot_5deg": ('kind = "step", amplitude = "5 deg", duration = "3 s"', "overshoot", 'maximum = "50 %"'),
    "held_20deg": ('kind = "step", amplitude = "20 deg", duration = "3 s"', "held_error", 'maximum = "2 deg"'),
    "unloaded_rate": ('kind = "slew", amplitude = "20 deg", duration = "1 s"', "sustained_rate",
                      'minimum = "50 deg/s"'),
    "loaded_rate": ('kind = "slew", amplitude = "20 deg", duration = "1 s", torque = "-100 N*m"', "sustained_rate",
                    'minimum = "50 deg/s"'),
    "gain_margin": ('kind = "linear"', "gain_margin", 'minimum = "3 dB"'),
    "phase_margin": ('kind = "linear"', "phase_margin", 'minimum = "10 deg"')}
SPECIFICATION = "[cases.nominal]\n" + "".join(f"""[[requirements]]
name = "{name}"
title = "quantity {name}"
test = {{ {test} }}
figure = "{figure}"
{limit}
""" for name, (test, figure, limit) in QUANTITIES.items())
TUNABLE = '[tunables]\n"controller.position.kp" = { lower = "40 1/s", upper = "60 1/s" }\n'


class _Rows(HTMLParser):
    """Parser of a page's tables: `rows` lists the texts of each row's cells."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th") and self.rows:
            self.rows[-1].append("")
        self.inside = tag in ("td", "th") or (self.inside and tag not in ("script", "style"))

    def handle_data(self, data: str) -> None:
        if self.inside and self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


class Outputs(NamedTuple):
    """JSON, table rows of the page by first cell, and terminal output, each by command."""

    documents: Mapping[str, Any]
    pages: Mapping[str, Mapping[str, list[str]]]
    terminal: Mapping[str, str]


def _run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code in (0, 1), result.output
    return result.output


@pytest.fixture(scope="module", params=["default", "robust"])
def outputs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Outputs:
    """The outputs of every command for one parameter set."""
    folder, name = tmp_path_factory.mktemp(request.param), request.param
    (folder / "mine.toml").write_text(SPECIFICATION, encoding="utf-8")
    (folder / "study.toml").write_text(TUNABLE + SPECIFICATION, encoding="utf-8")
    subject = [] if name == "default" else [name]
    chosen = [] if name == "default" else ["-p", name]
    mine = ["--requirements", folder / "mine.toml"]

    def files(command: str, page: str = "--report") -> list[object]:
        return ["--json", folder / f"{command}.json", page, folder / f"{command}.html"]

    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        patch.setattr(optimise, "_POPULATION", 4)
        patch.setattr(optimise, "_LOCAL", 1)
        terminal = {"validate": _run("validate", *subject, *mine, *files("validate")),
                    "report": _run("report", *subject, *mine, *files("report", "-o")),
                    "compare": _run("compare", name, *mine, *files("compare")),
                    "tune": _run("tune", folder / "study.toml", *chosen, "--generations", 1, "--workers", 1,
                                 *files("tune")),
                    "analyse": _run("analyse", *chosen, *files("analyse"))}
    _run("baseline", "record", *subject, "--output", folder / "baseline")
    terminal["check"] = _run("baseline", "check", *subject, "--baseline", folder / "baseline", *files("check"))
    documents: dict[str, Any] = {}
    pages: dict[str, dict[str, list[str]]] = {}
    for command in terminal:
        documents[command] = json.loads((folder / f"{command}.json").read_text(encoding="utf-8"))
        parser = _Rows()
        parser.feed((folder / f"{command}.html").read_text(encoding="utf-8"))
        pages[command] = {row[0].strip(): row for row in parser.rows if row}
    return Outputs(documents, pages, terminal)


def _verdicts(outputs: Outputs) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the requirements' rows in the JSON of each command, by name."""
    rows = {"validate": [c for c in outputs.documents["validate"]["criteria"] if c["group"] == "requirements"],
            "report": outputs.documents["report"]["requirements"],
            "compare": outputs.documents["compare"]["sets"][0]["requirements"]}
    return {command: {row["name"]: row for row in each} for command, each in rows.items()}


def _measured(outputs: Outputs) -> dict[str, float]:
    return {name: row["measured"] for name, row in _verdicts(outputs)["validate"].items()}


def test_verdicts_are_identical_in_all_commands(outputs: Outputs) -> None:
    verdicts, keys = _verdicts(outputs), ("measured", "unit", "passed", "margin", "case")
    assert set(verdicts["validate"]) == set(QUANTITIES)
    before = {row["requirement"]: row for row in outputs.documents["tune"]["requirements_before"]}
    for name, row in verdicts["validate"].items():
        for other in ("report", "compare"):
            assert {key: verdicts[other][name][key] for key in keys} == {key: row[key] for key in keys}, (other, name)
        assert before[name]["measured"] == row["measured"], name


def test_pages_and_terminals_show_the_same_digits(outputs: Outputs) -> None:
    for name, measured in _measured(outputs).items():
        shown = number(measured).replace("-", "−")
        compared = list(outputs.pages["compare"])  # a heading for each requirement, then one row for each set
        below = compared[next(i for i, text in enumerate(compared) if text.startswith(f"quantity {name}:")) + 1]
        cells = {**{command: outputs.pages[command][f"quantity {name}"][2] for command in ("validate", "report")},
                 "compare": below.lstrip("✓✗ ")}
        for command, cell in cells.items():
            assert re.match(rf"{re.escape(shown)}(?![\d.])", unescape(cell).strip()), (command, name, cell)
        for command in ("validate", "report"):
            assert re.search(rf"{name} +│ +{re.escape(number(measured))} │", outputs.terminal[command]), (command, name)
        assert number(measured) in outputs.terminal["compare"]


def test_worse_direction_of_the_reports_figures_is_the_judged_number(outputs: Outputs) -> None:
    figures, measured = outputs.documents["report"]["figures"], _measured(outputs)
    steps, slews, sines = figures["step_response"], figures["slew_rate"], figures["frequency_response"]
    for size in (1, 5):
        both = [steps[f"{sign}_{size}deg"]["settling_time_s"] for sign in ("plus", "minus")]
        assert max(both) * 1e3 == pytest.approx(measured[f"settling_{size}deg"], rel=1e-12)
    assert max(steps[f"{sign}_5deg"]["overshoot_percent"] for sign in ("plus", "minus")) == pytest.approx(
        measured["overshoot_5deg"], rel=1e-12)
    for load, name in (("unloaded", "unloaded_rate"), ("opposing", "loaded_rate")):
        both = [slews[f"{load}_{way}"]["sustained_rate_deg_per_s"] for way in ("positive", "negative")]
        assert min(both) == pytest.approx(measured[name], rel=1e-12)
    for amplitude in ("1deg", "3p5deg"):
        assert sines[amplitude]["bandwidth_3db_hz"] == measured[f"bandwidth_{amplitude}"]
    assert sines["1deg"]["bandwidth_90deg_hz"] == measured["lag_1deg"]


def test_baseline_records_the_same_figures(outputs: Outputs) -> None:
    """A baseline rounds to its digits and has one direction per case."""
    rows = {(row["case"], row["name"]): row["approved"] for row in outputs.documents["check"]["comparisons"]}
    figures, measured = outputs.documents["report"]["figures"], _measured(outputs)
    steps, slews = figures["step_response"], figures["slew_rate"]
    expected = {
        ("small_step", "settling_time"): 1e3 * steps["plus_1deg"]["settling_time_s"],
        ("step", "settling_time"): 1e3 * steps["minus_5deg"]["settling_time_s"],
        ("step", "overshoot"): steps["minus_5deg"]["overshoot_percent"],
        ("opposing_load", "sustained_rate"): slews["opposing_positive"]["sustained_rate_deg_per_s"],
        ("sweep_small", "bandwidth_3db"): measured["bandwidth_1deg"],
        ("sweep_small", "bandwidth_90deg"): measured["lag_1deg"],
        ("sweep", "bandwidth_3db"): measured["bandwidth_3p5deg"]}
    for key, value in expected.items():
        assert rows[key] == float(f"{value:.{DIGITS}g}"), key
    assert rows["large_step", "held_error"] <= measured["held_20deg"] * (1.0 + 1e-5)  # one of the two directions


def test_analysis_gives_the_same_margins_and_bandwidths(outputs: Outputs) -> None:
    document, measured = outputs.documents["analyse"], _measured(outputs)
    linear = document["linear"]["loops"]["reference"]
    # The analysis interpolates a coarser grid of 7 % steps with a cubic spline.
    assert linear["gain_margin_db"] == pytest.approx(measured["gain_margin"], rel=1e-4)
    assert linear["phase_margin_deg"] == pytest.approx(measured["phase_margin"], rel=1e-4)
    # Both bracket the crossing: the analysis to _RESOLVED, the bisection of the bench to 2 in 1000.
    resolution = _RESOLVED + 2e-3
    for sweep in document["sweep"]:
        for size, name in ((1.0, "bandwidth_1deg"), (3.5, "bandwidth_3p5deg")):
            if abs(sweep["amplitude_deg"] - size) < 1e-6:
                assert sweep["bandwidth_3db_hz"] == pytest.approx(measured[name], rel=resolution)
        if abs(sweep["amplitude_deg"] - 1.0) < 1e-6:
            assert sweep["bandwidth_90deg_hz"] == pytest.approx(measured["lag_1deg"], rel=resolution)
    assert BANDWIDTHS[0] < measured["bandwidth_1deg"] < BANDWIDTHS[1]
    assert radians(measured["phase_margin"]) > 0.0

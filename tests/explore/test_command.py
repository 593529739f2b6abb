"""What a page knows of its actuator, the command that writes it, and the page in docs; nothing is compiled."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.cli import app
from emcas_fmu.pages.page import environment
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.studies.explore import page
from tests.docs.recipes import ROOT
from tests.own_actuator.example import MODEL as DIRECT_DRIVE

from .browser import SHOWN


@pytest.fixture
def explore(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The command without its compiler."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "compiled", lambda files: b"unit")

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(app, ["explore", *arguments])

    return run


def data(path: str = "explore.html") -> dict[str, Any]:
    """Inputs of a page's scripts."""
    text = Path(path).read_text(encoding="utf-8")
    read: dict[str, Any] = json.loads(text.split('id="data">')[1].split("</script>")[0])
    return read


def described(parameters: ParameterSet) -> dict[str, Any]:
    return page.document(ParameterSubject(parameters), {}, load_requirements(None, parameters))


@pytest.mark.parametrize("model", [*NAMES, DIRECT_DRIVE, "elastic+stribeck+heat+homing+supply+faults"],
                         ids=lambda model: Path(model).stem)
def test_an_actuator_is_described_whole(model: str) -> None:
    actuator, parameters = get(model), load_parameters(model=model)
    given = json.loads(json.dumps(described(parameters), allow_nan=False))
    assert [p["name"] for p in given["parameters"]] == [v.name for v in actuator.parameters]
    assert all(p["value"] == p["shipped"] == parameters.values[p["name"]] for p in given["parameters"])
    outputs = {v.name for v in actuator.outputs}
    assert {name for panel in given["panels"] for name in panel["names"]} <= outputs
    known, first = {v["name"] for v in (*given["parameters"], *given["inputs"])}, page._first(parameters)
    assert {name for names in first.values() for name in names} <= known
    assert first.get("Gains") or first["Parameters"]
    judged = [r for r in given["requirements"] if not r["left_out"]]
    assert {r["test"] for r in judged} == set(range(len(given["tests"])))
    assert all(r["figure"] in given["tests"][r["test"]]["figures"] for r in judged)
    assert {name for test in given["tests"] for name in test["outputs"]} <= outputs
    assert all(abs(p["value"] / p["shown"][1]) < 1e9 for p in given["parameters"])
    assert {name for preset in given["presets"] for name in preset["values"]} <= known


def test_the_torque_speed_plane_is_of_actuators_with_its_limits() -> None:
    shown = {model for model in NAMES if described(load_parameters(model=model))["plane"]}
    assert {"nonlinear", "worm-gear", "electrohydrostatic"} <= shown
    assert not {"linear", "second-order", "electrohydraulic"} & shown
    for model in ("nonlinear", "linear"):
        assert ("limits_torque" in page.sources(model)["limits.h"]) is (model in shown)


def test_margins_are_of_actuators_with_the_loop() -> None:
    for model in ("second-order", "nonlinear", "nonlinear+homing"):
        given = described(load_parameters(model=model))
        judged = {r["figure"] for r in given["requirements"] if not r["left_out"]}
        assert ("gain_margin" in judged) is bool(given["linear"]) is (
            "at_rest_plant" in page.sources(model)["linear.h"])
        assert bool(given["linear"]) is (model != "second-order")


def test_presets_are_those_of_the_actuator() -> None:
    two = {"controller.load_observer", "trajectory.rate_limit", "filters.speed_bandwidth"}
    found = {model: {p["name"]: p["values"].keys() for p in described(load_parameters(model=model))["presets"]}
             for model in ("nonlinear", "nonlinear+filters+trajectory", "servo", "second-order")}
    assert {"cold", "sag", "robust"} <= found["nonlinear"].keys()
    assert "two-degrees-of-freedom" not in found["nonlinear"]  # its extensions are not in the page
    assert two <= found["nonlinear+filters+trajectory"]["two-degrees-of-freedom"]
    assert found["servo"].keys() == {"initial values", "sag", "xl330"}
    assert found["second-order"].keys() == {"initial values"}
    cold = described(load_parameters(model="nonlinear").with_values({"friction.temperature": -6.0}))["presets"]
    assert "cold" not in {p["name"] for p in cold}  # the page begins so


def test_a_parameter_is_shown_in_the_unit_of_its_file() -> None:
    given = described(load_parameters())
    shown = {p["name"]: (p["shown"][0], p["value"] / p["shown"][1]) for p in given["parameters"]}
    assert shown["drive.transport_delay"] == ("ms", pytest.approx(3.7))
    assert shown["screw.lead"] == ("mm/turn", pytest.approx(5.0))
    assert shown["friction.temperature"] == ("°C", 24.0)
    assert {"1/s²", "kg·m²", "V/(A·s)"} <= {unit for unit, _ in shown.values()}


def test_a_page_starts_from_what_is_given(explore: Any, tmp_path: Path) -> None:
    Path("mine.toml").write_text('motor.resistance = "0.3 Ohm"\n', encoding="utf-8")
    done = explore("-p", "mine.toml", "--set", "controller.position.kp=60", "--set", "aero_torque=-20", "--set",
                   "supply_voltage=30", "--date", "2026-03-31", "-o", "mine.html")
    assert done.exit_code == 0, done.output
    given, text = data("mine.html"), Path("mine.html").read_text(encoding="utf-8")
    values = {v["name"]: v["value"] for v in (*given["parameters"], *given["inputs"])}
    assert (values["motor.resistance"], values["controller.position.kp"]) == (0.3, 60.0)
    assert (values["aero_torque"], values["supply_voltage"]) == (-20.0, 30.0)
    assert "emcas explore --parameters mine.toml --set controller.position.kp=60" in text
    assert "2026-03-31" in text
    assert "2 differ from the defaults" in text
    again = explore("-p", "mine.toml", "--set", "controller.position.kp=60", "--set", "aero_torque=-20", "--set",
                    "supply_voltage=30", "--date", "2026-03-31", "-o", "mine.html")
    assert again.exit_code == 0
    assert Path("mine.html").read_text(encoding="utf-8") == text


def test_a_page_says_that_its_linear_model_has_no_dead_time(explore: Any) -> None:
    """In the words of the page of `emcas analyse`."""
    words = environment().from_string("{{ m.no_dead_time(true) }}").render()
    assert "the inverter's dead time, a series resistance at rest, is left out" in words
    for model, count in (("nonlinear", 0), ("nonlinear+inverter", 1)):
        assert explore("--model", model).exit_code == 0
        assert Path("explore.html").read_text(encoding="utf-8").count(words) == count


def test_a_page_judges_by_requirements_that_are_given(explore: Any) -> None:
    Path("mine.toml").write_text("""
[cases]
nominal = {}
hot = { "friction.temperature" = "71 degC" }

[[requirements]]
name = "quick"
test = { kind = "slew", amplitude = "50 %", torque = "-50 N*m" }
figure = "sustained_rate"
minimum = "150 deg/s"

[[requirements]]
name = "robust"
test = { kind = "linear" }
figure = "gain_margin"
minimum = "4 dB"
optional = true
cases = ["hot"]

[[requirements]]
name = "drops"
figure = "lifetime.endurance.wear_percent"
maximum = "1 %"
optional = true
""", encoding="utf-8")
    done = explore("--requirements", "mine.toml", "-o", "mine.html")
    assert done.exit_code == 0, done.output
    given = data("mine.html")
    assert [(r["name"], r["test"], r["limit"], r["unit"], r["cases"]) for r in given["requirements"]] == [
        ("quick", 0, 150.0, "°/s", ["nominal", "hot"]), ("robust", 1, 4.0, "dB", ["hot"]),
        ("drops", None, 1.0, "%", ["nominal", "hot"])]
    assert [r["left_out"] for r in given["requirements"]] == [
        "", "", "a figure of the acceptance report: emcas report judges it"]
    assert given["cases"] == {"nominal": {}, "hot": {"friction.temperature": 71.0}}
    assert [rule for panel in given["panels"] for rule in panel["rules"]] == [[150.0, "required 150 °/s, loaded"]]
    assert "--requirements mine.toml" in Path("mine.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("arguments", "said"), [
    (("--set", "fin_command=0.1"), "--set fin_command: a slider of the page sets it"),
    (("--set", "controller.position.kq=1"), "controller.position.kp"),
    (("--set", "fin.stop_angle=0.1"), "fin.stop_angle"),
    (("--date", "tomorrow"), "--date tomorrow: expected a date"),
    (("--model", "no-such"), "there is no actuator"),
    (("--requirements", "none.toml"), "none.toml"),
    (("-o", "none/page.html"), "there is no folder none"),
])
def test_what_cannot_be_is_said_and_nothing_written(explore: Any, arguments: tuple[str, ...], said: str,
                                                    tmp_path: Path) -> None:
    done = explore(*arguments)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_no_text_ends_a_script_element() -> None:
    text = page._embedded({"description": "</script><b>"})
    assert "<" not in text
    assert json.loads(text) == {"description": "</script><b>"}


def test_the_page_in_docs_is_not_stale(explore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page names the SHA-256 of the C that it was compiled from, so that nothing has to be compiled here."""
    shown = SHOWN.read_text(encoding="utf-8")
    unit = re.search(r'id="actuator">([^<]*)</script>', shown)
    assert unit is not None
    monkeypatch.setattr(page, "compiled", lambda files: zlib.decompress(base64.b64decode(unit[1]), -zlib.MAX_WBITS))
    monkeypatch.setattr(page, "packed", lambda code: unit[1])  # another zlib may compress in another way
    path = SHOWN.relative_to(ROOT)
    path.parent.mkdir(parents=True)  # in the test's own folder
    date = re.search(r"--date (\d{4}-\d\d-\d\d)", shown)
    assert date is not None
    assert explore("-o", path.as_posix(), "--date", date[1]).exit_code == 0
    assert path.read_text(encoding="utf-8") == shown, f"run emcas explore -o {path.as_posix()} --date {date[1]}"
    assert len(shown) < 400_000

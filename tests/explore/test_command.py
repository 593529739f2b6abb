"""The data in a page, the command that writes it, and the page in docs; nothing is compiled."""

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

from .browser import DEFAULT_PAGE


@pytest.fixture
def explore(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Function that runs the command without compiling."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "compiled", lambda files: b"unit")

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(app, ["explore", *arguments])

    return run


def data(path: str = "explore.html") -> dict[str, Any]:
    """Return the data of a page's scripts."""
    text = Path(path).read_text(encoding="utf-8")
    document: dict[str, Any] = json.loads(text.split('id="data">')[1].split("</script>")[0])
    return document


def document(parameters: ParameterSet) -> dict[str, Any]:
    """Return the data of a page with shipped requirements."""
    return page.document(ParameterSubject(parameters), {}, load_requirements(None, parameters))


@pytest.mark.parametrize("model", [*NAMES, DIRECT_DRIVE, "elastic+stribeck+heat+homing+supply+faults"],
                         ids=lambda model: Path(model).stem)
def test_data_of_a_page_refer_to_the_actuators_variables(model: str) -> None:
    actuator, parameters = get(model), load_parameters(model=model)
    contents = json.loads(json.dumps(document(parameters), allow_nan=False))
    assert [p["name"] for p in contents["parameters"]] == [v.name for v in actuator.parameters]
    assert all(p["value"] == p["shipped"] == parameters.values[p["name"]] for p in contents["parameters"])
    outputs = {v.name for v in actuator.outputs}
    assert {name for panel in contents["panels"] for name in panel["names"]} <= outputs
    known, first = {v["name"] for v in (*contents["parameters"], *contents["inputs"])}, page._first(parameters)
    assert {name for names in first.values() for name in names} <= known
    assert first.get("Gains") or first["Parameters"]
    judged = [r for r in contents["requirements"] if not r["left_out"]]
    assert {r["test"] for r in judged} == set(range(len(contents["tests"])))
    assert all(r["figure"] in contents["tests"][r["test"]]["figures"] for r in judged)
    assert {name for test in contents["tests"] for name in test["outputs"]} <= outputs
    assert all(abs(p["value"] / p["shown"][1]) < 1e9 for p in contents["parameters"])
    assert {name for preset in contents["presets"] for name in preset["values"]} <= known


def test_only_actuators_with_torque_limits_have_a_torque_speed_plane() -> None:
    shown = {model for model in NAMES if document(load_parameters(model=model))["plane"]}
    assert {"nonlinear", "worm-gear", "electrohydrostatic"} <= shown
    assert not {"linear", "second-order", "electrohydraulic"} & shown
    for model in ("nonlinear", "linear"):
        assert ("limits_torque" in page.sources(model)["limits.h"]) is (model in shown)


def test_only_actuators_with_a_position_loop_have_margins() -> None:
    for model in ("second-order", "nonlinear", "nonlinear+homing"):
        contents = document(load_parameters(model=model))
        judged = {r["figure"] for r in contents["requirements"] if not r["left_out"]}
        assert ("gain_margin" in judged) is bool(contents["linear"]) is (
            "at_rest_plant" in page.sources(model)["linear.h"])
        assert bool(contents["linear"]) is (model != "second-order")


def test_each_actuator_has_its_presets() -> None:
    two = {"controller.load_observer", "trajectory.rate_limit", "filters.speed_bandwidth"}
    found = {model: {p["name"]: p["values"].keys() for p in document(load_parameters(model=model))["presets"]}
             for model in ("nonlinear", "nonlinear+filters+trajectory", "servo", "second-order")}
    assert {"cold", "sag", "robust"} <= found["nonlinear"].keys()
    assert "two-degrees-of-freedom" not in found["nonlinear"]  # this preset needs extensions
    assert two <= found["nonlinear+filters+trajectory"]["two-degrees-of-freedom"]
    assert found["servo"].keys() == {"initial values", "sag", "xl330"}
    assert found["second-order"].keys() == {"initial values"}
    cold = document(load_parameters(model="nonlinear").with_values({"friction.temperature": -6.0}))["presets"]
    assert "cold" not in {p["name"] for p in cold}  # these are the page's initial values


@pytest.mark.parametrize(("model", "load"), [("nonlinear", 100.0), ("servo", 5.0)])
def test_slider_of_the_torque_ends_at_twice_the_rated_load_and_a_load_step_has_it(model: str, load: float) -> None:
    contents = document(load_parameters(model=model))
    (torque,) = (field for field in contents["fields"] if field["name"] == "excitation.torque")
    assert torque["range"] == [-2.0 * load, 2.0 * load]
    assert contents["kinds"]["load"]["usual"]["torque"] == -load
    assert "torque" not in contents["kinds"]["step"]["usual"]


def test_parameters_are_shown_in_the_units_of_the_file() -> None:
    contents = document(load_parameters())
    shown = {p["name"]: (p["shown"][0], p["value"] / p["shown"][1]) for p in contents["parameters"]}
    assert shown["drive.transport_delay"] == ("ms", pytest.approx(3.7))
    assert shown["screw.lead"] == ("mm/turn", pytest.approx(5.0))
    assert shown["friction.temperature"] == ("°C", 24.0)
    assert {"1/s²", "kg·m²", "V/(A·s)"} <= {unit for unit, _ in shown.values()}


def test_file_and_options_set_the_initial_values(explore: Any) -> None:
    """A second command writes the same text."""
    Path("mine.toml").write_text('motor.resistance = "0.3 Ohm"\n', encoding="utf-8")
    arguments = ("-p", "mine.toml", "--set", "controller.position.kp=60", "--set", "aero_torque=-20", "--set",
                 "supply_voltage=30", "--date", "2026-03-31", "-o", "mine.html")
    done = explore(*arguments)
    assert done.exit_code == 0, done.output
    contents, text = data("mine.html"), Path("mine.html").read_text(encoding="utf-8")
    values = {v["name"]: v["value"] for v in (*contents["parameters"], *contents["inputs"])}
    assert (values["motor.resistance"], values["controller.position.kp"]) == (0.3, 60.0)
    assert (values["aero_torque"], values["supply_voltage"]) == (-20.0, 30.0)
    assert "emcas explore --parameters mine.toml --set controller.position.kp=60" in text
    assert "2026-03-31" in text
    assert "2 differ from the defaults" in text
    assert explore(*arguments).exit_code == 0
    assert Path("mine.html").read_text(encoding="utf-8") == text


def test_page_states_that_the_linear_model_has_no_dead_time(explore: Any) -> None:
    """With the sentence of `emcas analyse`."""
    words = environment().from_string("{{ m.no_dead_time(true) }}").render()
    assert "the inverter's dead time, a series resistance at rest, is left out" in words
    for model, count in (("nonlinear", 0), ("nonlinear+inverter", 1)):
        assert explore("--model", model).exit_code == 0
        assert Path("explore.html").read_text(encoding="utf-8").count(words) == count


def test_page_contains_the_users_requirements(explore: Any) -> None:
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
    contents = data("mine.html")
    assert [(r["name"], r["test"], r["limit"], r["unit"], r["cases"]) for r in contents["requirements"]] == [
        ("quick", 0, 150.0, "°/s", ["nominal", "hot"]), ("robust", 1, 4.0, "dB", ["hot"]),
        ("drops", None, 1.0, "%", ["nominal", "hot"])]
    assert [r["left_out"] for r in contents["requirements"]] == [
        "", "", "a figure of the acceptance report: emcas report judges it"]
    assert contents["cases"] == {"nominal": {}, "hot": {"friction.temperature": 71.0}}
    assert [rule for panel in contents["panels"] for rule in panel["rules"]] == [[150.0, "required 150 °/s, loaded"]]
    assert "--requirements mine.toml" in Path("mine.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("arguments", "message"), [
    (("--set", "fin_command=0.1"), "--set fin_command: a slider of the page sets it"),
    (("--set", "controller.position.kq=1"), "controller.position.kp"),
    (("--set", "fin.stop_angle=0.1"), "fin.stop_angle"),
    (("--date", "tomorrow"), "--date tomorrow: expected a date"),
    (("--model", "no-such"), "there is no actuator"),
    (("--requirements", "none.toml"), "none.toml"),
    (("-o", "none/page.html"), "there is no folder none"),
])
def test_wrong_argument_is_an_error_and_no_file_is_written(explore: Any, arguments: tuple[str, ...], message: str,
                                                           tmp_path: Path) -> None:
    done = explore(*arguments)
    assert done.exit_code == 2
    assert message in " ".join(done.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_embedded_text_cannot_end_the_script_element() -> None:
    text = page._embedded({"description": "</script><b>"})
    assert "<" not in text
    assert json.loads(text) == {"description": "</script><b>"}


def test_page_in_docs_is_up_to_date(explore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled: the page contains the SHA-256 of its C sources."""
    shown = DEFAULT_PAGE.read_text(encoding="utf-8")
    unit = re.search(r'id="actuator">([^<]*)</script>', shown)
    assert unit is not None
    monkeypatch.setattr(page, "compiled", lambda files: zlib.decompress(base64.b64decode(unit[1]), -zlib.MAX_WBITS))
    monkeypatch.setattr(page, "packed", lambda code: unit[1])  # another version of zlib may give other bytes
    path = DEFAULT_PAGE.relative_to(ROOT)
    path.parent.mkdir(parents=True)  # in the test's own folder
    date = re.search(r"--date (\d{4}-\d\d-\d\d)", shown)
    assert date is not None
    assert explore("-o", path.as_posix(), "--date", date[1]).exit_code == 0
    assert path.read_text(encoding="utf-8") == shown, f"run emcas explore -o {path.as_posix()} --date {date[1]}"
    assert len(shown) < 400_000

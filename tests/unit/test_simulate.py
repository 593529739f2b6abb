"""`emcas simulate`: settings, several fins, figures, statuses and plots."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from emcas_fmu import api
from emcas_fmu.actuators import get
from emcas_fmu.bench import metrics
from emcas_fmu.bench.excitation import step_to
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import ParameterError, ParameterSet, load_parameters
from emcas_fmu.plotting.plots import style
from emcas_fmu.reference.files import read_csv
from emcas_fmu.response import Response
from emcas_fmu.simulation import simulate, simulate_fins, spread
from tests import commands
from tests.marks import slow
from tests.own_actuator.example import MODEL as DIRECT_DRIVE

MODELS = ("nonlinear", "second-order", DIRECT_DRIVE, "elastic+heat+homing+faults")
SAG = {"bus.source_resistance": 0.02}


def test_sag_scales_with_the_supply_voltage(tmp_path: Path) -> None:
    for settings, levels in (((), {39.0, 28.0}), (("--set", "drive.supply_voltage=28 V"), {28.0, 20.1025641})):
        assert f"Supply sags from {max(levels):g} to" in emcas("--case", "sag", "-o", tmp_path / "s.csv", *settings)
        assert set(read_csv(tmp_path / "s.csv")["supply_voltage"]) == levels


def test_settings_give_the_warnings_of_a_file() -> None:
    printed = emcas("--step", "5", "--set", "motor.torque_constant=0.2")
    assert "warning: motor.torque_constant = 0.2" in printed
    assert "are 0.2 and 0.11 in SI units" in printed
    assert "warning" not in emcas("--step", "5", "--set", "motor.torque_constant=0.12")


@pytest.mark.parametrize(("model", "setting", "message"), [
    (DIRECT_DRIVE, "supply_voltag=20", "the direct-drive actuator has no such parameter or input; did you mean supply"),
    ("second-order", "supply_voltage=20", "the second-order actuator has no such parameter or input; its inputs are"),
    ("second-order", "aero_torqe=20", "; did you mean aero_torque?"),
    ("second-order", "motor.resistance=1", "the second-order actuator has no such parameter or input"),
])
def test_unknown_setting_is_refused_with_similar_names(model: str, setting: str, message: str) -> None:
    assert message in commands.refusal("simulate", "--model", model, "--step", "5", "--set", setting)


def emcas(*arguments: str | Path) -> str:
    """Run `emcas simulate` and return its printed text."""
    done = commands.emcas("simulate", *arguments)
    assert done.exit_code == 0, done.output
    return str(done.output)


@pytest.mark.parametrize("model", MODELS)
def test_fin_on_a_stiff_bus_moves_as_alone(model: str) -> None:
    """To the bit, since nothing couples the fins."""
    sets = fin_sets(load_parameters(model=model), 2, "cross", {})
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.1 * (t > 0.005), "aero_torque": -20.0}
    both = simulate_fins([each.values for each in sets], 0.03, model=model, **{**inputs, "fin[2].fin_command": 0.0})
    for fin, signals in ((1, inputs), (2, {**inputs, "fin_command": 0.0})):
        alone = simulate(sets[fin - 1].values, 0.03, kernel="python", model=model, **signals)
        assert all(np.array_equal(both[f"fin[{fin}].{v.name}"], alone[v.name]) for v in get(model).outputs)


@pytest.mark.fmu
@pytest.mark.parametrize("model", ["nonlinear", *slow(DIRECT_DRIVE)])
def test_fmu_of_two_fins_has_the_same_bus_and_mixing(model: str, tmp_path: Path) -> None:
    base = load_parameters(model=model)
    path = build(base, tmp_path / "two.fmu", fins=2, references=False).path
    signals: dict[str, Any] = {"fin[1].fin_command": 0.1, "fin[2].fin_command": -0.2, "pitch_command": 0.05}
    names = ["bus_voltage", "bus_current", "fin[1].fin_angle", "fin[2].fin_angle"]
    of_fmu = fmpy.simulate_fmu(str(path), stop_time=0.03, output_interval=1e-3, start_values={**SAG, **signals},
                               output=names)
    sets = [each.values for each in fin_sets(base, 2, "cross", {})]
    ours = simulate_fins(sets, 0.03, model=model, line=SAG, **signals)
    assert np.min(ours["bus_voltage"]) < base.values["drive.supply_voltage"] - 0.1
    # The times of fmpy and of simulate_fins may differ by rounding.
    assert all(np.allclose(ours[name], of_fmu[name], rtol=1e-9, atol=1e-12) for name in names)


def test_wrong_fins_and_options_are_refused() -> None:
    good = load_parameters().values
    with pytest.raises(ParameterError, match=r"fin 2: motor.resistance"):
        simulate_fins([good, {**good, "motor.resistance": -1.0}], 0.01)
    with pytest.raises(ParameterError, match=r"bus.source_resistance"):
        simulate_fins([good, good], 0.01, line={"bus.source_resistance": 2.0})
    with pytest.raises(ValueError, match="one fin shares no line"):
        simulate_fins([good], 0.01)
    unknown: dict[str, Any] = {"fin[3].fin_command": 0.1}
    with pytest.raises(TypeError, match=r"no input 'fin\[3\].fin_command'"):
        simulate_fins([good, good], 0.01, **unknown)
    for arguments, message in ((("--fin", "2=a.toml"), "add --fins"), (("--fins", "9"), "1 to 8 fins"),
                            (("--fins", "2", "--kernel", "compiled"), "computed in Python"),
                            (("--fins", "2", "--kernel", "fortran"), "kernel fortran"),
                            (("--fins", "2", "--model", "second-order", "--set", "bus.source_resistance=0.02"),
                             "second-order has no supply"),
                            (("--fins", "2", "--set", "fin[2].drive.supply_voltage=20"), "differs between fins"),
                            (("--fins", "2", "--set", "fin[2].motor.resistence=1"), "did you mean motor.resistance"),
                            (("--set", "aero_torque=3"), "Step to +5 deg sets this input already"),
                            (("--set", "enable=5"), "expected true or false"),
                            (("--set", "bus.source_resistance=0.1"), "needs --fins"),
                            (("--fins", "4", "--set", "fin[7].motor.resistance=1"), "fins are 1 to 4"),
                            (("--set", "fault.jam.begin=1"), "--model nonlinear+faults"),
                            (("--fins", "2", "--set", "bus.source_resistance=2"), "within 0 .. 1 Ohm")):
        assert message in commands.refusal("simulate", "--step", "5", *arguments)


def test_command_simulates_four_fins(tmp_path: Path) -> None:
    (tmp_path / "worn.toml").write_text('[motor]\ntorque_constant = "0.09 N.m/A"\n')
    files = {key: tmp_path / f"r.{key}" for key in ("output", "plot", "json")}
    files |= {"output": tmp_path / "r.csv", "plot": tmp_path / "r.svg"}
    printed = emcas("--fins", "4", "--fin", f"2={tmp_path / 'worn.toml'}", "--layout", "plus", "--step", "5", "--stop",
                    "0.2", "--set", "bus.source_resistance=0.02", "--set", "pitch_command=1 deg",
                    *(part for key, path in files.items() for part in (f"--{key}", path)))
    assert "fin 4" in printed
    assert "bus: lowest_bus_voltage_v 3" in printed
    columns = read_csv(files["output"])
    assert {f"fin[{i}].{v.name}" for i in range(1, 5) for v in get("nonlinear").outputs} < set(columns)
    assert {"pitch_command", "fin[3].fin_command", "bus_voltage", "bus_current"} < set(columns)
    figures = json.loads(files["json"].read_text())
    assert len(figures["fins"]) == 4
    # A pitch command moves fin 1, along body y, by -cos(0) times it, fin 3 the other way, and fins 2 and 4 not at all.
    mixed = [each["fin_angle_final_deg"] + each["tracking_error_final_deg"] for each in figures["fins"]]
    assert mixed == pytest.approx([4.0, 5.0, 6.0, 5.0], abs=1e-9)  # rounding
    assert figures["fins"][1]["peak_current_a"] != figures["fins"][3]["peak_current_a"]
    # Errors are computed from the mixed command; without mixing they would be 1 deg.
    assert all(abs(each["steady_error_deg"]) < 0.5 for each in figures["fins"])
    assert figures["bus"]["lowest_bus_voltage_v"] < 38.9


def response(model: str, changes: list[Mapping[str, Any]], stop: float = 0.2) -> Response:
    """Return the response of fins with changed parameters to a step of 5 deg."""
    excitation, interface = step_to(radians(5.0), stop - 0.05), FmuInterface(len(changes), model)
    columns: dict[str, Any] = dict(excitation.columns)
    sets = [load_parameters(model=model).with_values(change) for change in changes]
    if interface.fins == 1:
        return Response(interface, sets, excitation, simulate(sets[0].values, stop, model=model, **columns))
    moved = simulate_fins([each.values for each in sets], stop, model=model, **columns)
    return Response(interface, sets, excitation.holding(spread(excitation.columns, interface)), moved)


@pytest.mark.parametrize("model", MODELS)
def test_figures_are_those_of_the_bench(model: str) -> None:
    changes = {"homing.required": False} if "homing" in model else {}
    ours = response(model, [changes]).metrics()
    subject = ParameterSubject(load_parameters(model=model).with_values(changes))
    run = subject.run(step_to(radians(5.0), 0.15))
    for key, value in metrics.displayed(metrics.motion_figures(run)).items():
        assert ours[key] == pytest.approx(value, rel=1e-12, nan_ok=True)
    assert ("peak_current_a" in ours) is ("motor_current" in subject.outputs)
    assert ("energy_drawn_j" in ours) is ("supply_power" in subject.outputs)


def test_statuses_and_faults_are_shown_by_name() -> None:
    """In the table and the plot; fin 2 is jammed from 60 ms on."""
    jam = {"fault.jam.begin": 0.06, "fault.jam.end": 9.0, "monitor.persistence": 0.02}
    homed = {"homing.required": False}
    run = response("nonlinear+homing+faults", [homed, {**homed, **jam}], 0.3)
    lines = {name: values for name, *values in run.lines()}
    assert lines["status"][0] == "operational"
    assert lines["status"][1].startswith("operational, ")
    assert lines["status"][1].endswith("failed")
    # The fault of a sample is in the output one row later.
    assert lines["fault_word"] == ["none", "none, 0.061 s jam"]
    assert "tracking" in lines["built_in_test"][1]
    assert "fault_word_final" not in lines
    with style():
        ticks = {axes.get_ylabel(): [label.get_text() for label in axes.get_yticklabels()] for axes in run.plot().axes}
    assert ticks["fault word"] == ["jam"]
    assert "operational" in ticks["status"]
    assert "tracking" in ticks["built in test"]


def test_estimated_figures_are_marked(tmp_path: Path) -> None:
    files = {name: tmp_path / f"r.{name}" for name in ("json", "html")}
    printed = emcas("--model", "nonlinear+heat+faults", "--step", "5", "--json", files["json"], "--plot", files["html"])
    page, figures = files["html"].read_text(encoding="utf-8"), json.loads(files["json"].read_text())
    temperatures = ("winding_temperature", "case_temperature")
    assert all(f"{name}_final (estimate)" in printed for name in temperatures)
    assert all(f"{name.replace('_', ' ')} final (estimate)" in page for name in temperatures)
    for text in (" ".join(printed.split()), page):
        assert re.search(r"Estimate: winding.temperature.final, .*from engineering estimates of heat\.", text)
    assert set(figures["estimates"]) == {f"{name}_final" for name in (*temperatures, "i2t_load", "current_limit")}
    assert "heat.case_to_ambient" in figures["estimates"]["winding_temperature_final"]
    assert "peak_current_a (estimate)" not in printed
    with style():
        labels = [axes.get_ylabel() for axes in response("nonlinear+heat", [{}], 0.1).plot().axes]
    assert "winding temperature [degC] (estimate)" in labels
    base = load_parameters(model="nonlinear+heat")
    measured = ParameterSet(tuple(replace(entry, source="measured") for entry in base.entries), base.model)
    run = replace(response("nonlinear+heat", [{}], 0.1), sets=[measured])
    assert not run.estimates
    assert "estimates" not in run.as_dict()


def test_figures_of_the_bus_have_their_own_table(tmp_path: Path) -> None:
    emcas("--fins", "4", "--step", "5", "--stop", "0.1", "--plot", tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    tables = dict(re.findall(r"<caption[^>]*>(.*?)</caption>(.*?)</table>", page, flags=re.DOTALL))
    (of_bus,), (of_fins,) = ([body for caption, body in tables.items() if word in caption]
                             for word in ("bus that the fins share", "Figures of merit"))
    assert re.findall(r"<th(?: [^>]*)?>(.*?)</th>", of_bus) == ["figure", "all fins", "unit"]
    assert "lowest bus voltage" in of_bus
    assert "bus" not in of_fins
    assert [len(re.findall("<t[dh][ >]", row)) for row in re.findall(r"<tr>(.*?)</tr>", of_fins, flags=re.DOTALL)
            ] == [6] * of_fins.count("<tr>")  # the name, four fins, the unit


def test_plot_has_the_outputs_of_the_actuator() -> None:
    """Outputs that every actuator has, then its own by their units of measurement, the motor's speed in rpm."""
    common = ["fin angle [deg]", "tracking error [deg]", "fin rate [deg/s]", "hinge torque [N.m]"]
    own = {"second-order": [], DIRECT_DRIVE: ["motor current [A]", "motor voltage [V]", "supply power [W]"],
           "nonlinear": ["motor angle [deg]", "motor speed [rpm]", "[A]", "[V]", "motor torque [N.m]",
                         "nut position [m]", "supply power [W]"]}
    with style():
        for model, labels in own.items():
            panels = {axes.get_ylabel(): axes for axes in response(model, [{}], 0.1).plot().axes if axes.get_visible()}
            assert list(panels) == [*common, *labels]
            if "[V]" in panels:
                assert panels["[V]"].get_legend_handles_labels()[1] == ["motor voltage", "drive reference"]


def test_boolean_is_plotted_between_0_and_1() -> None:
    with style():
        panel = next(axes for axes in response("nonlinear+supply", [{}], 0.05).plot().axes
                     if axes.get_ylabel() == "supply tripped")
    assert panel.get_yticks().tolist() == [0, 1]


def test_picture_is_as_wide_as_its_page(tmp_path: Path) -> None:
    response("second-order", [{}], 0.05).plot(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "figure svg { width: 100%" in page
    assert page.count('<figure class="curves">') == 1


def test_page_lists_changed_parameters(tmp_path: Path) -> None:
    jam = {"fault.jam.begin": 0.08}
    base = load_parameters(model="nonlinear+faults").with_values({"motor.resistance": 1.1})
    api.simulate([base, base.with_values(jam)], stop=0.005).plot(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    listed = page[page.index(">Conditions</h2>"):page.index(">Figures of merit</h2>")]
    for name, value in (("motor.resistance", "1.1 Ohm"), ("fin[1].fault.jam.begin", "0 s"),
                        ("fin[2].fault.jam.begin", "80 ms")):
        assert f"<code>{name}</code></th><td>{value}</td>" in listed
    assert "a limit of any fin is active" in page


def test_every_column_of_panels_has_its_time_axis() -> None:
    """Of seven panels the last is alone in its row; the panel above the gap has its column's axis, too."""
    with style():
        plot = response(DIRECT_DRIVE, [{}], 0.05).plot()
        plot.draw_without_rendering()
        panels = [axes for axes in plot.axes if axes.get_visible()]
        labelled = [bool(axes.get_xlabel()) and axes.xaxis.get_ticklabels()[0].get_visible() for axes in panels]
    assert labelled == [*[False] * 5, True, True]


def test_values_are_converted_to_words() -> None:
    by_name = {v.name: v for v in get("nonlinear+faults").outputs}
    assert by_name["status"].in_words(6.0) == "failed"
    assert by_name["fault_word"].in_words(5.0) == "jam hard_over"
    assert by_name["built_in_test"].in_words(0.0) == "none"
    assert by_name["fin_angle"].in_words(0.5) == "0.5"

"""Several fins on one pressure line: single fins if it is stiff, otherwise an independent integration by SciPy."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring
from zipfile import ZipFile

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from emcas_fmu.actuators import get
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import read_csv
from emcas_fmu.simulation import simulate, simulate_fins
from tests.fmu.built import both
from tests.fmu.host import OK, Fmu, Instance
from tests.fmu.lockstep import Lockstep

MODEL = str(Path(__file__).with_name("throttled.py"))
VALUES = load_parameters(model=MODEL).values
FOUR = FmuInterface(4, MODEL)
VOLUME = "line.accumulator_volume"
SAG = {VOLUME: 5e-5, "line.pump_flow": 8e-5}


def run_of(commands: Any, line: Mapping[str, float], pressure: Any, **changes: float) -> Any:
    """Return a run of four fins under commands [rad] and pump settings [Pa] at samples of 1 ms."""
    inputs: dict[str, Any] = {f"fin[{k}].fin_command": commands[k - 1] for k in range(1, 5)}
    return simulate_fins([{**VALUES, **changes}] * 4, (len(pressure) - 1) * 1e-3, 1e-3, MODEL, line,
                         supply_pressure=pressure, **inputs)


def test_four_fins_on_a_stiff_line_are_single_ones() -> None:
    """To the bit, with any pump: the line does not couple them."""
    rng = np.random.default_rng(7)
    pressure, commands = 21e6 * rng.uniform(-0.1, 1.2, 61), rng.uniform(-0.4, 0.4, (4, 61))
    together = run_of(commands, {"line.pump_flow": 0.0}, pressure)
    for k in range(1, 5):
        alone = simulate(VALUES, 0.06, kernel="python", model=MODEL, supply_pressure=pressure,
                         fin_command=commands[k - 1])
        assert all(np.array_equal(together[f"fin[{k}].{v.name}"], alone[v.name]) for v in get(MODEL).outputs)
    assert np.array_equal(together["line_pressure"], np.r_[pressure[0], pressure[:-1]])


def integrated(line: Mapping[str, float], commands: np.ndarray[Any, Any], setting: np.ndarray[Any, Any]) -> Any:
    """Return the states at samples of 1 ms from an independent integration of fins, pump and gas."""
    v0, p0, n = line[VOLUME], 12.6e6, 1.4
    state, rows = np.r_[np.zeros(8), setting[0]], []

    def slope(_: float, y: Any, opening: Any, p_set: float) -> Any:
        p = y[8]
        flows = 1.7e-3 / 60.0 * opening * np.sqrt(p / 7e6)
        pump = min(max(1.5e-10 * (p_set - p), 0.0), line["line.pump_flow"])
        stiffness = n * p / (v0 * (p0 / p) ** (1.0 / n)) if p > p0 else 100.0 * n * p0 / v0
        return np.r_[y[4:8], (flows / 9.6e-6 - y[4:8]) / 5e-3, stiffness * (pump - np.abs(flows).sum())]

    for k in range(len(setting) - 1):
        rows.append(state)
        opening = np.clip(40.0 * (commands[:, k] - state[:4]), -1.0, 1.0)
        state = solve_ivp(slope, (0.0, 1e-3), state, args=(opening, setting[k]), rtol=1e-8, atol=1e-10).y[:, -1]
    return np.array([*rows, state])


@pytest.mark.parametrize(("volume", "flow"), [(5e-5, 8e-5), (2e-4, 0.0)])
def test_a_line_that_sags_converges_to_an_independent_integration(volume: float, flow: float) -> None:
    """To first order in the update time, with a small accumulator and without a pump."""
    line, time = {VOLUME: volume, "line.pump_flow": flow}, np.arange(151) * 1e-3
    commands = np.array([[0.3], [0.3], [-0.2], [0.25]]) * np.sign(np.sin(2.0 * np.pi * 8.0 * time + 0.1))
    setting = np.where(time < 0.1, 21e6, 24e6)
    exact = integrated(line, commands, setting)
    angles, pressures = [], []
    for update in (1e-3, 5e-4, 2.5e-4):
        run = run_of(commands, {**line, "line.update_time": update}, setting, **{"solver.max_tick": 5e-5})
        angles.append(max(np.abs(run[f"fin[{k}].fin_angle"] - exact[:, k - 1]).max() for k in range(1, 5)))
        pressures.append(np.abs(run["line_pressure"] - exact[:, 8]).max())
    assert exact[:, 8].min() < 0.85 * 21e6
    for errors in (angles, pressures):
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert np.abs(orders - 1.0).max() < 0.1, errors  # second-order terms are small at 1 ms
    assert np.degrees(angles[2]) < 0.01  # of 17 deg and more, at 2.5 times the default update time
    assert pressures[2] < 1e-3 * 21e6


def test_a_weak_line_makes_fins_that_move_together_slower() -> None:
    def angle(others: float, **line: float) -> float:
        run = simulate_fins([VALUES] * 4, 0.05, 1e-3, MODEL, {f"line.{k}": v for k, v in line.items()}, **{
            "fin[1].fin_command": 0.4, **{f"fin[{k}].fin_command": others for k in (2, 3, 4)}})
        return float(run["fin[1].fin_angle"][-1])

    assert angle(0.4) == angle(0.0)
    weak = {"accumulator_volume": 2e-5, "pump_flow": 5e-5}
    assert angle(0.4, **weak) < 0.95 * angle(0.0, **weak)


def test_power_is_pressure_times_flow() -> None:
    run = simulate_fins([VALUES] * 4, 0.1, 1e-3, MODEL, SAG, fin_command=0.3)
    # Rounding of four terms and a quotient.
    assert run["line_pressure"] * run["line_flow"] == pytest.approx(run["supply_power"], rel=1e-14)
    assert run["supply_power"] == pytest.approx(sum(run[f"fin[{k}].supply_power"] for k in range(1, 5)), rel=1e-14)
    assert run["line_pressure"].min() < 0.8 * 21e6


def test_a_parameter_of_a_bus_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"there is no bus.source_resistance; the pressure line has line.accumulator"):
        simulate_fins([VALUES] * 2, 0.01, model=MODEL, line={"bus.source_resistance": 0.1})
    assert FmuInterface(1, MODEL).line is None


def test_the_command_prints_pressure_and_flow_of_the_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, [
        "simulate", "--model", MODEL, "--fins", "4", "--step", "15", "--stop", "0.2", "--set", f"{VOLUME}=50 ml",
        "--set", "line.pump_flow=4.8 l/min", "--set", "supply_pressure=200 bar", "-o", str(tmp_path / "r.csv"),
        "--json", str(tmp_path / "r.json")])
    assert result.exit_code == 0, result.output
    columns, figures = read_csv(tmp_path / "r.csv"), json.loads((tmp_path / "r.json").read_text())["line"]
    assert columns["line_pressure"][0] == 20e6
    assert figures["lowest_line_pressure_mpa"] == pytest.approx(min(columns["line_pressure"]) / 1e6, rel=1e-12)
    assert figures["peak_line_flow_l_per_min"] == pytest.approx(max(columns["line_flow"]) * 6e4, rel=1e-12)
    assert "line: lowest_line_pressure_mpa 1" in result.output


# -- the FMUs -------------------------------------------------------------------

@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    return both(load_parameters(model=MODEL), tmp_path_factory.mktemp("hydraulic"), fins=4)


@pytest.fixture(scope="module")
def native(built: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("unpacked")
    shutil.unpack_archive(built["native"], folder, "zip")
    return Fmu(str(folder))


@pytest.mark.fmu
@pytest.mark.slow
@pytest.mark.parametrize("backend", ["python", "native"])
def test_the_fmu_describes_the_line(built: Mapping[str, Path], backend: str) -> None:
    assert validate_fmu(str(built[backend])) == []
    with ZipFile(built[backend]) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
        terminals = archive.read("terminalsAndIcons/terminalsAndIcons.xml").decode()
    assert "; 4 fins on one pressure line; fins at " in root.attrib["description"]
    variables = {v.attrib["name"]: v[0].attrib for v in root.findall("ModelVariables/ScalarVariable")}
    types = {t.attrib["name"]: t[0].attrib for t in root.findall("TypeDefinitions/SimpleType")}
    for name, unit, shown in (("supply_pressure", "Pa", "MPa"), ("line_pressure", "Pa", "MPa"),
                              ("line_flow", "m3/s", "l/min"), (VOLUME, "m3", "l")):
        assert (variables[name]["unit"], types[variables[name]["declaredType"]]["displayUnit"]) == (unit, shown)
    assert float(variables["supply_pressure"]["start"]) == 21e6
    assert not [name for name in variables if "bus" in name]
    assert "hydraulic supply" in terminals
    assert f"<code>{VOLUME}</code> above 0" in page
    assert "gas accumulator" in page


@pytest.mark.fmu
@pytest.mark.slow
def test_back_ends_compute_the_same_bits(native: Fmu) -> None:
    """In lockstep under changing inputs, with restored states."""
    fins = Lockstep(MODEL, native, {**SAG, "line.polytropic_exponent": 1.2, "supply_pressure": 18e6})
    levels = [fins.unit.get("line_pressure") for _ in fins.run(12, "supply_pressure", 0.0, 25e6)]
    assert min(levels) < 16e6
    fins.unit.free()


@pytest.mark.fmu
@pytest.mark.slow
@pytest.mark.parametrize("volume", [0.0, 5e-5])
def test_ramps_of_the_setting_do_not_depend_on_the_step(native: Fmu, volume: float) -> None:
    """A ramp by input derivatives in 1, 4 or 20 steps acts on the valves of a stiff line, otherwise on the pump."""
    results = []
    for steps in (1, 4, 20):
        instance = Instance(native)
        assert max(instance.initialize(**{**SAG, VOLUME: volume, "supply_pressure": 15e6})) == OK
        for k in range(1, 5):
            instance.set(f"fin[{k}].fin_command", radians(15.0))
        for k in range(steps):
            instance.set("supply_pressure", 15e6 + 10e6 * k / steps)
            assert instance.differentiate("supply_pressure", 1, 10e6 / 0.02) == OK
            assert instance.step(k * 0.02 / steps, 0.02 / steps) == OK
        results.append([instance.get(name) for name in (
            "fin[1].fin_angle", "fin[1].fin_rate", "line_pressure", "supply_pressure")])
        instance.free()
    # A tick uses the ramp at its middle; a tick cut by a communication point uses it at the middles of both parts.
    assert np.array(results[1:]) == pytest.approx(np.array([results[0], results[0]]), rel=1e-4)
    assert (results[0][2] == pytest.approx(25e6, rel=1e-12)) is (volume == 0.0)

"""A battery with charge and a common DC link on the bus: closed forms, energy, and an integration of four fins."""

from __future__ import annotations

import shutil
import warnings
import zipfile
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emcas_fmu import api
from emcas_fmu.actuators import get
from emcas_fmu.actuators.supply_line import BUS
from emcas_fmu.errors import EmcasWarning
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.namespace import namespace
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import bus
from emcas_fmu.simulation import simulate, simulate_fins
from tests.fmu.built import both, slave_class
from tests.fmu.host import ERROR, OK, WARNING, Fmu, Instance
from tests.fmu.lockstep import Lockstep

MODEL = str(Path(__file__).parents[2] / "examples" / "own_actuator" / "direct_drive.py")
VALUES = load_parameters(model=MODEL).values
RESISTANCE, LINK, CHARGE = "bus.source_resistance", "bus.capacitance", "bus.charge"
BATTERY = {RESISTANCE: 0.1, CHARGE: 30.0, "bus.charge_used": 24.0}
WITH_LINK = {**BATTERY, LINK: 2e-3, "bus.chopper_voltage": 42.0, "bus.chopper_resistance": 0.5}
TIME = np.arange(91) * 1e-3
COMMANDS = np.array([[0.3], [0.3], [-0.2], [0.25]]) * np.sign(np.sin(2.0 * np.pi * 8.0 * TIME + 0.1))


def bus_parameters(**changes: float) -> Any:
    """Return the bus's parameters."""
    return namespace({**BUS.values, **{f"bus.{name}": value for name, value in changes.items()}}).bus


def run_of(values: Mapping[str, Any], commands: Any, parameters: Mapping[str, float]) -> Any:
    """Return a run of four fins under commands [rad] at samples of 1 ms."""
    inputs: dict[str, Any] = {f"fin[{k}].fin_command": commands[k - 1] for k in range(1, 5)}
    return simulate_fins([values] * 4, (commands.shape[1] - 1) * 1e-3, 1e-3, MODEL, parameters, **inputs)


def angles(run: Any) -> Any:
    return np.array([run[f"fin[{k}].fin_angle"] for k in range(1, 5)])


# -- the bus alone --------------------------------------------------------------

def test_other_parameters_have_no_effect_without_charge_and_link_or_without_a_resistance() -> None:
    """To the bit; without a resistance the bus is stiff, and fins move as single ones."""
    plain = run_of(VALUES, COMMANDS[:, :61], {RESISTANCE: 0.1})
    others = run_of(VALUES, COMMANDS[:, :61], {RESISTANCE: 0.1, "bus.polarisation": 7.0, "bus.charge_used": 5.0,
                                             "bus.chopper_voltage": 20.0, "bus.chopper_resistance": 0.1})
    assert all(np.array_equal(plain[name], others[name]) for name in plain)
    stiff = run_of(VALUES, COMMANDS[:, :61], {**WITH_LINK, RESISTANCE: 0.0})
    for k in range(1, 5):
        alone = simulate(VALUES, 0.06, kernel="python", model=MODEL, fin_command=COMMANDS[k - 1, :61])
        assert all(np.array_equal(stiff[f"fin[{k}].{v.name}"], alone[v.name]) for v in get(MODEL).outputs)


def test_the_open_circuit_voltage_falls_with_the_charge() -> None:
    """E_0 - K Q/(Q - q) with E_0 = 39.4 V, K = 0.4 V, Q = 100 A.s, by hand; the fall of an empty battery is limited."""
    p = bus_parameters(charge=100.0, charge_used=20.0, polarisation=0.4)
    by_hand = {0.0: 39.0, 20.0: 38.9, 50.0: 38.6, 60.0: 38.4, 75.0: 37.8, 80.0: 37.4, 90.0: 35.4, 99.0: -0.6}
    for used, voltage in by_hand.items():
        assert 39.0 - bus.fall(FLOATS, p, used - 20.0) == pytest.approx(voltage, abs=1e-12)  # rounding of 40 V
    assert bus.fall(FLOATS, p, 80.0) == bus.fall(FLOATS, p, 1e9) == pytest.approx(0.4 / bus.EMPTY, rel=1e-5)
    assert bus.fall(FLOATS, bus_parameters(polarisation=5.0, charge_used=3.0), 1e9) == 0.0  # unlimited


@pytest.mark.parametrize("capacitance", [0.0, 5e-3])
def test_a_used_battery_starts_at_rest(capacitance: float) -> None:
    """90 % used, U q/(Q - q) = 9 U = 4.5 V: without a load the voltage is 34.5 V from the first output on."""
    run = run_of(VALUES, np.zeros((4, 11)), {RESISTANCE: 0.05, CHARGE: 100.0, "bus.charge_used": 90.0,
                                           LINK: capacitance})
    # Numbers of the order of 40 V; the stored charge leaves 1e-13 of them.
    assert run["bus_voltage"] == pytest.approx(np.full(11, 34.5), rel=1e-12)


def test_returned_power_charges_a_used_battery_until_it_is_full() -> None:
    """Half of 100 A.s is used; 30 A.s back leave a fall of U/4, and more than 50 A.s leave none."""
    p = bus_parameters(source_resistance=0.1, charge=100.0, charge_used=50.0, polarisation=0.8, update_time=1e-2)
    states = bus.start(FLOATS, p)
    assert states[0] == pytest.approx(0.8, rel=1e-12)
    for seconds, fall in ((3.0, 0.2), (3.0, 0.0)):
        for _ in range(round(seconds / p.update_time)):
            states = bus.following(FLOATS, p, 39.0, states, -10.0, -10.0, 0.0)
        # The sag is that of one update before, 0.1 A.s, at 0.0125 V for each A.s; -1 V is that of the resistance.
        assert states[0] == pytest.approx(fall - 1.0, abs=2e-3)
    assert states[2] == -50.0


@pytest.mark.parametrize("update", [1e-5, 1e-3, 1e-2])
def test_a_link_charges_by_the_exponential(update: float) -> None:
    """Under a constant current V = V_b - R I (1 - exp(-t/RC)), for any update time; the battery's is (V_b - V)/R."""
    p, states = bus_parameters(source_resistance=0.1, capacitance=5e-3, update_time=update), (0.0, bus.NO_LINK, 0.0)
    count = round(0.02 / update)
    for _ in range(count):
        states = bus.following(FLOATS, p, 39.0, states, 40.0, 40.0, 1e-9)  # of drives that follow the voltage
    decay = np.exp(-0.02 / 5e-4)
    assert states[1] == pytest.approx(39.0 - 4.0 * (1.0 - decay), rel=1e-12)
    # Each of 2000 updates rounds the link's charge, 39 V 5e-3 F, by some 1e-16 of it.
    assert states[2] == pytest.approx(40.0 * 0.02 - 5e-3 * 4.0 * (1.0 - decay), rel=1e-10)


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-3, 1.0), st.floats(1e-4, 1e-1), st.floats(0.0, 99.0), st.floats(1.0, 80.0),
       st.floats(-300.0, 300.0), st.floats(20.0, 60.0), st.floats(0.01, 10.0))
def test_no_update_of_the_link_creates_energy(resistance: float, capacitance: float, used: float, link: float,
                                              current: float, chopper: float, chopper_resistance: float) -> None:
    """Over 1 ms the battery's energy is at least the drives' and the change of the link's."""
    fine = bus_parameters(source_resistance=resistance, capacitance=capacitance, charge=100.0, charge_used=used,
                chopper_voltage=chopper, chopper_resistance=chopper_resistance, update_time=1e-3 / 64)
    voltages, states = [link], (0.0, link, 0.0)
    open_circuit = max(39.0 - bus.fall(FLOATS, fine, 0.0), 0.0)
    for _ in range(64):
        states = bus.following(FLOATS, fine, 39.0, states, current, current, 1e-9)
        voltages.append(states[1])
    assert states[2] >= 0.0  # the diode
    drawn = current * float(np.trapezoid(voltages, dx=1e-3 / 64))
    stored = 0.5 * capacitance * (voltages[-1] ** 2 - link**2)
    # The errors of trapezoids over the drives' energy and the chopper's charge are at most the changes of voltage.
    changes = np.abs(np.diff(voltages))
    quadrature = (abs(current) + open_circuit / chopper_resistance) * float(changes.sum()) * 1e-3 / 64
    assert open_circuit * states[2] - drawn - stored > -quadrature - 1e-9


# -- rules ------------------------------------------------------------------------

UNUSED = "bus.charge = 30 A.s and bus.capacitance = 0 F have no effect at bus.source_resistance = 0: raise"
EXCESS = "bus.charge_used = 31 A.s must be at most bus.charge = 30 A.s"


def test_a_battery_without_a_resistance_is_warned_of() -> None:
    sets = fin_sets(load_parameters(model=MODEL), 4)
    with pytest.warns(EmcasWarning, match=UNUSED):
        api.simulate(sets, stop=0.01, line={CHARGE: 30.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        api.simulate(sets, stop=0.01, line=BATTERY)


def test_a_used_charge_above_the_charge_is_refused() -> None:
    """The used charge of an unlimited battery has no limit; it may be the whole charge of another."""
    for allowed in ({CHARGE: 0.0, "bus.charge_used": 31.0}, {CHARGE: 30.0, "bus.charge_used": 30.0}):
        run_of(VALUES, COMMANDS[:, :3], {RESISTANCE: 0.1, **allowed})
    with pytest.raises(ParameterError, match=EXCESS):
        run_of(VALUES, COMMANDS[:, :3], {RESISTANCE: 0.1, CHARGE: 30.0, "bus.charge_used": 31.0})


# -- four fins ---------------------------------------------------------------------

def integrated(parameters: Mapping[str, float], commands: Any, linked: bool) -> tuple[Any, Any, Any]:
    """Return angles [rad], voltage [V] and charge [A.s] at the samples, from an independent integration by SciPy.

    Without a link V is the root of V^2 - V_b V + R P = 0, in which P depends on V for drives at their limit.
    """
    def p(name: str) -> float:
        return float(VALUES[name])

    inertia = p("inertia.fin") + p("inertia.shaft") + p("inertia.fork") + p("motor.inertia")
    resistance, full = parameters[RESISTANCE], parameters[CHARGE]

    def drives(y: Any, reference: Any, level: float) -> Any:
        return np.clip(reference, -level, level) * y[8:12]

    def battery(charge: float) -> float:
        used = min((charge + parameters["bus.charge_used"]) / full, 1.0 - 1e-9)
        return 39.0 - 0.5 * used / (1.0 - used)

    def level_of(y: Any, reference: Any) -> float:
        if linked:
            return float(y[12])
        # Bisection solves V = V_b - R P(V)/V, whose right side falls with V except in regeneration.
        low, high = 1e-3, 200.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            if battery(y[13]) - resistance * drives(y, reference, middle).sum() / middle > middle:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)

    def slope(_: float, y: Any, reference: Any) -> Any:
        level = level_of(y, reference)
        voltage = np.clip(reference, -level, level)
        rates = y[4:8]
        torque = (p("motor.torque_constant") * y[8:12] - p("spring.stiffness") * y[:4] - p("hinge.damping") * rates)
        rise = voltage - p("motor.resistance") * y[8:12] - p("motor.back_emf_constant") * rates
        drawn = (voltage * y[8:12]).sum() / level
        source = drawn
        change = 0.0
        if linked:
            source = max(battery(y[13]) - level, 0.0) / resistance
            brake = max(level - parameters["bus.chopper_voltage"], 0.0) / parameters["bus.chopper_resistance"]
            change = (source - drawn - brake) / parameters[LINK]
        return np.r_[rates, torque / inertia, rise / p("motor.inductance"), change, source]

    y, integral, reference, rows = np.r_[np.zeros(12), battery(0.0), 0.0], np.zeros(4), np.zeros(4), []
    for k in range(commands.shape[1] - 1):
        rows.append([*y[:4], level_of(y, reference), y[13]])
        level = rows[-1][4]
        error = commands[:, k] - y[:4]
        demand = p("controller.kp") * (p("controller.setpoint_weight") * commands[:, k] - y[:4]) + integral
        reference = np.clip(demand, -level, level)
        integral = integral + np.where(np.abs(demand) > level, 0.0,
                                       p("controller.sample_time") * p("controller.ki") * error)
        y = solve_ivp(slope, (0.0, 1e-3), y, args=(reference,), rtol=1e-8, atol=1e-8).y[:, -1]
    rows.append([*y[:4], level_of(y, reference), y[13]])
    table = np.array(rows)
    return table[:, :4].T, table[:, 4], table[:, 5]


@pytest.mark.parametrize("parameters", [
    pytest.param(BATTERY, id="battery", marks=pytest.mark.slow), pytest.param(WITH_LINK, id="link")])
def test_four_fins_converge_to_an_independent_integration(parameters: Mapping[str, float]) -> None:
    """To first order in the update time, with sag, regeneration, diode, chopper and a battery that empties."""
    exact = integrated(parameters, COMMANDS, LINK in parameters)
    errors = []
    for update in (2e-4, 1e-4, 5e-5):
        run = run_of({**VALUES, "solver.max_tick": 2e-5}, COMMANDS, {**parameters, "bus.update_time": update})
        errors.append((np.abs(angles(run) - exact[0]).max(), np.abs(run["bus_voltage"] - exact[1])[1:].max()))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 1.0).max() < 0.25, errors  # second-order terms are up to a quarter at 0.2 ms
    assert np.degrees(errors[1][0]) < 0.02  # at the default update time 0.007 and 0.012 deg, of 17 deg
    assert exact[1].min() < 25.0
    assert bool(exact[1].max() > 45.0) is (LINK in parameters)  # the chopper conducts
    assert exact[2][-1] > 0.9  # A.s, of the remaining 6


def test_a_nearly_empty_battery_browns_out() -> None:
    full, empty = (run_of(VALUES, np.full((4, 81), 0.3), {RESISTANCE: 0.1, CHARGE: 100.0, "bus.charge_used": used})
                   for used in (0.0, 99.0))
    assert full["fin[1].fin_angle"][-1] == pytest.approx(0.3, abs=0.01)
    assert empty["fin[1].fin_angle"][-1] < 0.2
    assert empty["bus_voltage"][-1] < 0.1 * full["bus_voltage"][-1]


def test_a_chopper_limits_the_voltage_of_a_link_behind_a_diode() -> None:
    """The link is charged by braking fins."""
    highest = [run_of(VALUES, COMMANDS, {RESISTANCE: 0.1, LINK: 1e-3, **chopper})["bus_voltage"].max()
               for chopper in ({}, {"bus.chopper_voltage": 42.0, "bus.chopper_resistance": 0.2})]
    assert highest[0] > 100.0
    assert 42.0 < highest[1] < 50.0


def test_a_small_link_does_not_ring() -> None:
    """With a link far below h^2 sum 1/L, 8 mF at 1 ms, fins and voltage are near those at 0.1 ms, not 3 deg and 130 V
    off."""
    parameters = {RESISTANCE: 0.1, LINK: 1e-5, "bus.chopper_voltage": 42.0}
    coarse, fine = (run_of(VALUES, COMMANDS, {**parameters, "bus.update_time": update}) for update in (1e-3, 1e-4))
    assert np.abs(angles(coarse) - angles(fine)).max() < radians(0.3)
    assert max(run["bus_voltage"].max() for run in (coarse, fine)) < 60.0


@pytest.mark.parametrize("capacitance", [0.0, 1e-6])
@pytest.mark.parametrize("model", ["servo", "clutch"])
def test_a_winding_without_inductance_does_not_let_the_bus_ring(model: str, capacitance: float) -> None:
    """Its current follows the voltage at once; the bus jumped between 0 V and 39 V or 100 kV."""
    values = load_parameters(model=model).values
    coarse, fine = (simulate_fins([values] * 4, 0.105, 7e-4, model, {  # an odd number of updates, or rows would hide it
        RESISTANCE: 1.0, LINK: capacitance, "bus.update_time": update},
        fin_command=lambda t: 0.2 if t < 0.07 else -0.2) for update in (1e-4, 2e-5))
    assert coarse["bus_voltage"].min() > 5.0
    assert coarse["bus_voltage"].max() < 100.0
    # The small link is raised to h sum 1/R of the servos: 0.16 deg, three times for margin.
    assert np.abs(angles(coarse) - angles(fine)).max() < radians(0.5)


@pytest.mark.parametrize("update", [1e-4, 1e-3])
@pytest.mark.parametrize("capacitance", [0.0, 1e-6, 1e-3])
def test_drives_of_constant_power_neither_collapse_nor_charge_the_bus(capacitance: float, update: float) -> None:
    """The voltage has no effect on `ozkan`: the bus fell to 1 mV, then rose to 100 kV."""
    values, resistance, source = load_parameters(model="ozkan").values, 0.1, 39.0
    run = simulate_fins([values] * 4, 0.3, 1e-3, "ozkan", {
        RESISTANCE: resistance, LINK: capacitance, "bus.update_time": update},
        fin_command=lambda t: 0.3 if t < 0.1 else -0.3)
    voltage, current, power = run["bus_voltage"], run["bus_current"], run["supply_power"]
    assert power.max() > source**2 / (4.0 * resistance)  # above the source's largest power
    assert voltage.min() == pytest.approx(source / 2.0)
    if capacitance:  # returned energy raises the link; C is at most raised, and rows of 1 ms integrate within 2 %
        assert 0.5 * capacitance * voltage.max() ** 2 < 1.02 * -np.sum(np.minimum(power, 0.0)) * 1e-3
    else:
        supplied = power < 0.95 * source**2 / (4.0 * resistance)
        exact = source - resistance * current[supplied]  # of the row; the bus is updated with the current before it
        assert np.abs(voltage[supplied] - exact).max() < 5e3 * update


@pytest.mark.parametrize("low", [0.0, 0.1, 5.0])
@pytest.mark.parametrize("capacitance", [0.0, 1e-3])
def test_bus_with_drives_of_constant_power_recovers_from_a_dip(capacitance: float, low: float) -> None:
    """The link stayed at the voltage of the dip for ever, since the drives took all current of the source."""
    run = simulate_fins([load_parameters(model="ozkan").values] * 4, 0.3, 1e-3, "ozkan", {
        RESISTANCE: 0.05, LINK: capacitance}, aero_torque=200.0,
        supply_voltage=lambda t: low if 0.1 < t < 0.2 else 39.0)
    time, voltage = run["time"], run["bus_voltage"]
    assert run["supply_power"][-1] > 100.0
    assert voltage[time < 0.19].min() < max(low, 1.0)
    assert np.ptp(voltage[time > 0.21]) < 1.0
    assert voltage[-1] == pytest.approx(voltage[time < 0.1][-1], abs=0.5)


# -- the FMUs -------------------------------------------------------------------

@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    return both(load_parameters(model=MODEL), tmp_path_factory.mktemp("battery"), fins=4)


@pytest.mark.fmu
@pytest.mark.slow
def test_back_ends_compute_the_same_bits(built: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> None:
    """In lockstep under changing inputs, with restored states; a damaged state is refused."""
    folder = tmp_path_factory.mktemp("unpacked")
    shutil.unpack_archive(built["native"], folder, "zip")
    fins = Lockstep(MODEL, Fmu(str(folder)), WITH_LINK)
    native = fins.unit
    assert min(native.get("bus_voltage") for _ in fins.run(8, "supply_voltage", 20.0, 42.0)) < 30.0
    damaged = bytearray(native.serialize(native.save()))
    damaged[-9] ^= 64
    assert native.restore(bytes(damaged)) != OK
    native.free()


@pytest.mark.fmu
def test_the_native_fmu_checks_the_rules_of_the_bus(built: Mapping[str, Path], tmp_path: Path) -> None:
    """It refuses a used charge above the charge until it is corrected, and logs the warning once."""
    shutil.unpack_archive(built["native"], tmp_path, "zip")
    instance = Instance(Fmu(str(tmp_path)))
    assert [instance.setup(), instance.enter(), instance.set(CHARGE, 30.0)] == [OK] * 3
    assert instance.set("bus.charge_used", 31.0) == OK
    assert instance.call("ExitInitializationMode") == ERROR
    assert EXCESS in instance.messages(ERROR)
    assert [instance.set("bus.charge_used", 24.0), instance.call("ExitInitializationMode")] == [OK, OK]
    assert instance.messages(WARNING).count(UNUSED) == 1
    instance.free()


@pytest.mark.fmu
def test_the_python_fmu_checks_the_rules_of_the_bus(built: Mapping[str, Path],
                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    four, log = FmuInterface(4, MODEL), []
    with zipfile.ZipFile(built["python"]) as archive:
        (model,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("model.py"))
    assert "make_line_checks = staticmethod(line_checks.make)" in model
    sets = [each.values for each in fin_sets(load_parameters(model=MODEL), 4, "cross", {})]
    for used, message in ((31.0, EXCESS), (24.0, UNUSED)):
        instance = slave_class(four, sets)(instance_name="fins")
        monkeypatch.setattr(instance, "_log", lambda text, status="error": log.append((status, text)))
        instance.setup_experiment(0.0)
        instance.enter_initialization_mode()
        instance.set_real([four.reference[CHARGE], four.reference["bus.charge_used"]], [30.0, used])
        instance.exit_initialization_mode()
        assert message in log[-1][1]
    assert [status for status, _ in log] == ["error", "warning"]

"""The drive's DC link and supply: closed forms, an independent integration, energy, and the models without it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import log, radians, sin, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import step_means, supply
from emcas_fmu.simulation import simulate, simulate_fins
from tests.fmu.built import lean
from tests.marks import others_slow
from tests.runs import assert_equal, run_both_kernels

from . import runs
from .runs import BLOCKED, NO_CONTROLLER, NO_COULOMB
from .supply_reference import angle_and_voltage

MODEL = "nonlinear+supply"
BASE = load_parameters(model=MODEL)
MODELS = ("nonlinear", "elastic", "habibi", "ristanovic")
NO_CHOPPER = {"supply.chopper_voltage": 1e5}
LOSSLESS = {"supply.quiescent_power": 0.0, "supply.device_voltage": 0.0, "supply.device_resistance": 0.0}
# Ten times the gain, so that the current of a blocked motor is its reference within 0.5 %.
BLOCKED_MOTOR = {**BLOCKED, "encoder.enabled": False, "drive.kp": 50.0}
values_of = partial(runs.values_of, model=MODEL)


def run_of(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(values_of(overrides), stop, step, model=MODEL, **inputs)


# -- the link alone ---------------------------------------------------------------

_ohms = st.floats(-3.0, 1.0).map(lambda x: 10.0**x)


# Under a constant slope Radau's error is 0, and it divides by the error to choose the next step.
@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value):RuntimeWarning")
@settings(derandomize=True, max_examples=30)
@given(begin=st.floats(1.0, 80.0), source=st.floats(0.0, 80.0), chopper=st.floats(1.0, 80.0),
       load=st.floats(-200.0, 200.0), source_resistance=_ohms, chopper_resistance=_ohms, one_way=st.booleans(),
       span=st.floats(-5.0, -2.0).map(lambda x: 10.0**x))
def test_link_voltage_and_charge_follow_their_equation(
        begin: float, source: float, chopper: float, load: float, source_resistance: float, chopper_resistance: float,
        one_way: bool, span: float) -> None:
    """Radau integrates through diode and chopper in any order; the voltage does not fall below zero."""
    p = SimpleNamespace(supply=SimpleNamespace(
        source_resistance=source_resistance, one_way=one_way, capacitance=2e-3, chopper_voltage=chopper,
        chopper_resistance=chopper_resistance))

    def slope(_: float, y: Any) -> list[float]:
        current = (source - y[0]) / source_resistance
        current = max(current, 0.0) if one_way else current
        return [(current - max(y[0] - chopper, 0.0) / chopper_resistance - load) / 2e-3, current]

    exact, exact_charge = solve_ivp(slope, (0.0, span), [begin, 0.0], "Radau", rtol=1e-9, atol=1e-9).y[:, -1]
    end, charge = supply.moved(FLOATS, p, begin, source, load, span)
    # Radau is off by up to 3e-6 V at a kink; in A.s the 2 mF of the link make 4e-8 of the voltage's tolerance.
    assert end == pytest.approx(max(exact, 0.0), abs=2e-5)
    assert charge == pytest.approx(exact_charge, abs=2e-6)


@pytest.mark.parametrize("ratio", [1e-3, 9.9e-3, 1.01e-2, 0.3, 6.0])
def test_mean_product_of_two_exponentials(ratio: float) -> None:
    """Quadrature agrees; the series, for ratios up to 0.01, is off by 1e-6."""
    def at(s: float, start: float, end: float) -> float:
        return start + (end - start) * float(np.expm1(-ratio * s) / np.expm1(-ratio))

    exact = quad(lambda s: at(s, 39.0, -3.0) * at(s, 5.0, 20.0), 0.0, 1.0, epsabs=1e-12)[0]
    assert step_means.mean_product(FLOATS, (39.0, 5.0), (-3.0, 20.0), ratio) == pytest.approx(exact, rel=1e-5)
    assert step_means.mean_product(FLOATS, (5.0, 7.0), (5.0, 7.0), ratio) == 35.0


def test_a_link_without_source_feeds_the_electronics() -> None:
    """C v^2/2 falls by P t down to the trip; below it a resistance V_t^2/P discharges the link."""
    power, capacity, trip, failure = 100.0, 2.2e-3, 18.0, 5e-3
    run = run_of({**NO_CHOPPER, "supply.quiescent_power": power}, 0.06, 1e-4, enable=False,
                 supply_voltage=lambda t: 39.0 if t < failure else 0.0)
    begin = run["link_voltage"][50]
    assert begin == pytest.approx(0.5 * (39.0 + sqrt(39.0**2 - 4.0 * 0.05 * power)), rel=1e-9)
    trips = failure + 0.5 * capacity * (begin**2 - trip**2) / power
    assert 0.015 < trips < 0.03
    time = run["time"]
    before = (time >= failure) & (time <= trips)
    exact = np.sqrt(begin**2 - 2.0 * power * (time[before] - failure) / capacity)
    # The error is of second order in the tick: 1.5e-3 V at the trip.
    assert run["link_voltage"][before] == pytest.approx(exact, abs=3e-3)
    # Rows are 0.1 ms apart; an error of 1.5e-3 V shifts the trip by 6e-7 s.
    assert trips - 2e-6 <= time[np.argmax(run["supply_tripped"])] < trips + 1.1e-4
    late = time > trips + 1e-3
    first = int(np.argmax(late))
    decay = np.exp(-(time[late] - time[first]) * power / (capacity * trip**2))
    assert run["link_voltage"][late] == pytest.approx(run["link_voltage"][first] * decay, rel=2e-3)  # measured 9e-4


def test_a_charging_link_recovers_at_the_recovery_voltage() -> None:
    """From 0 V v = V (1 - exp(-t/RC))."""
    run = run_of({**LOSSLESS, **BLOCKED_MOTOR, "supply.source_resistance": 1.0, "supply.capacitance": 0.02,
                  "drive.current_offset": 0.0}, 0.05, 1e-4, supply_voltage=lambda t: 0.0 if t < 1e-3 else 39.0)
    recovers = 1e-3 - 0.02 * log(1.0 - 20.0 / 39.0)
    assert run["link_voltage"][150] == pytest.approx(39.0 * -np.expm1(-0.014 / 0.02), rel=1e-9)
    assert run["supply_tripped"][0]  # the link starts at the source's 0 V
    # A tick of 0.7 ms late at most, in rows 0.1 ms apart.
    assert recovers <= run["time"][np.argmin(run["supply_tripped"])] < recovers + 8e-4


# -- a blocked motor --------------------------------------------------------------

@pytest.mark.parametrize("current", [20.0, -35.0])
def test_a_blocked_motor_draws_the_losses_of_copper_and_inverter(current: float) -> None:
    run = run_of({**BLOCKED_MOTOR, "drive.current_offset": current}, 0.05)
    i = abs(run["motor_current"][-1])
    assert i == pytest.approx(abs(current), rel=6e-3)
    loss = 0.3 * i + 8e-3 * i**2
    power = 0.25 * i**2 + loss + 8.0
    link = 0.5 * (39.0 + sqrt(39.0**2 - 4.0 * 0.05 * power))
    assert run["inverter_loss"][-1] == pytest.approx(loss, rel=1e-12)
    assert run["link_voltage"][-1] == pytest.approx(link, rel=1e-9)
    assert run["supply_power"][-1] == pytest.approx(39.0 * (39.0 - link) / 0.05, rel=1e-9)
    assert run["brake_power"][-1] == 0.0


def test_four_fins_share_a_line() -> None:
    """Each has the link voltage of a single fin whose source also has four times the line's resistance."""
    values = values_of({**BLOCKED_MOTOR, "drive.current_offset": 20.0})
    run = simulate_fins([values] * 4, 0.05, 1e-3, MODEL, {"bus.source_resistance": 0.01})
    i = run["fin[1].motor_current"][-1]
    power = 0.25 * i**2 + 0.3 * i + 8e-3 * i**2 + 8.0
    link = 0.5 * (39.0 + sqrt(39.0**2 - 4.0 * (0.05 + 0.04) * power))
    # The sag is updated every 0.1 ms; after 50 ms the transient is over.
    assert run["fin[3].link_voltage"][-1] == pytest.approx(link, rel=1e-6)
    assert run["bus_voltage"][-1] == pytest.approx(39.0 - 0.04 * power / link, rel=1e-6)
    assert run["bus_current"][-1] == pytest.approx(4.0 * power / link, rel=1e-6)


@pytest.mark.parametrize("interval", [1e-5, 1e-4, 1e-3])
def test_a_line_with_links_does_not_ring(interval: float) -> None:
    """Also with links of R_s C = 44 us, far faster than the longest update time."""
    values = values_of({"supply.source_resistance": 0.02, "supply.one_way": True})
    run = simulate_fins([values] * 4, 0.1, 1e-3, MODEL, {"bus.source_resistance": 0.01, "bus.update_time": interval},
                        fin_command=0.1)
    settled = run["bus_voltage"][-20:]
    assert np.ptp(settled) < 0.05
    assert settled[-1] == pytest.approx(39.0, abs=0.05)  # 8 W of each drive and the current that holds the fin
    assert run["bus_voltage"].min() > 33.0


# -- regeneration -----------------------------------------------------------------

# A moment drives the fin back against the motor's torque.
DRIVEN_BACK = {**NO_CONTROLLER, **NO_COULOMB, "drive.ki": 0.0, "encoder.enabled": False,
               "fin.start_angle": radians(-20.0), "drive.current_offset": 60.0, "friction.temperature": 24.0}


def _driving_torque(t: float) -> float:
    return -20.0 if t < 0.06 else -900.0


def test_behind_a_diode_the_chopper_limits_the_link_voltage() -> None:
    run = run_of({**DRIVEN_BACK, "supply.chopper_resistance": 0.05}, 0.11, 1e-4, aero_torque=_driving_torque)
    power = (run["motor_voltage"] * run["motor_current"]).min()
    assert power < -500.0
    assert run["supply_power"].min() == 0.0
    # The resistor takes all power: the link is at most R_b P/V_b above the chopper's voltage.
    assert 45.0 < run["link_voltage"].max() <= 45.0 - 0.05 * power / 45.0
    assert run["brake_power"].max() > 400.0


def test_without_chopper_the_capacitor_stores_the_returned_energy() -> None:
    """C v^2/2 grows by the shaft's work -K_t i w less the losses of copper and the change of the inductance's energy.
    """
    run = run_of({**DRIVEN_BACK, **NO_CHOPPER, **LOSSLESS, "supply.capacitance": 0.02, "solver.max_tick": 2e-5}, 0.11,
                 2e-5, aero_torque=_driving_torque)
    link, current, time = run["link_voltage"], run["motor_current"], run["time"]
    rows = np.flatnonzero((link > 39.0) & (time > 0.06))[:-1]
    assert len(rows) > 300
    work = np.trapezoid((run["motor_torque"] * run["motor_speed"] + 0.25 * current**2)[rows], time[rows])
    magnetic = 0.5 * 0.6e-3 * (current[rows[-1]]**2 - current[rows[0]]**2)
    stored = 0.5 * 0.02 * (link[rows[-1]]**2 - link[rows[0]]**2)
    assert stored > 5.0
    assert stored == pytest.approx(-work - magnetic, rel=1e-3)  # trapezia over 20 us


def test_without_a_diode_the_source_receives_the_returned_power() -> None:
    run = run_of({**DRIVEN_BACK, **NO_CHOPPER, "supply.one_way": False}, 0.11, 1e-4, aero_torque=_driving_torque)
    power = run["supply_power"].min()
    assert power < -500.0
    assert run["link_voltage"].max() == pytest.approx(39.0 - 0.05 * power / 39.0, rel=1e-9)


def test_the_source_s_energy_is_work_heat_and_charge() -> None:
    """Trapezia integrate the outputs of a motion with regeneration."""
    values = values_of({"solver.max_tick": 1e-5})
    run = simulate(values, 0.3, 1e-5, model=MODEL, fin_command=lambda t: 0.25 if sin(30.0 * t) > 0.0 else -0.25)
    time, link = run["time"], run["link_voltage"]

    def energy(power: Any) -> float:
        return float(np.trapezoid(power, time))

    line = np.maximum(39.0 - link, 0.0)**2 / 0.05
    losses = [run["inverter_loss"], run["brake_power"], line]
    assert all(loss.min() >= 0.0 for loss in losses)
    assert energy(run["brake_power"]) > 1.0
    assert energy(run["inverter_loss"]) > 2.0
    used = energy(run["motor_voltage"] * run["motor_current"]) + sum(map(energy, losses)) + 8.0 * 0.3
    stored = 0.5 * 2.2e-3 * (link[-1]**2 - link[0]**2)
    # The voltage jumps within an interval at each sample: measured 1.2e-3, and half of that with half the interval.
    assert used + stored == pytest.approx(energy(run["supply_power"]), rel=2.5e-3)


# -- with the actuator ------------------------------------------------------------

@pytest.mark.parametrize("changes", others_slow([
    {}, {"supply.one_way": False, "supply.source_resistance": 0.15},
    {"supply.capacitance": 5e-4, "supply.chopper_resistance": 0.5}], lambda changes: "supply.one_way" in changes))
def test_against_an_independent_integration(changes: Mapping[str, Any]) -> None:
    """With ticks of 0.1 ms, since a jump of 60 A at rest makes even the plain actuator 0.006 deg wrong at 0.25 ms."""
    values = values_of({**DRIVEN_BACK, **changes, "solver.max_tick": 1e-4})
    torques = [_driving_torque(k * 1e-3) for k in range(95)]
    run = simulate(values, 0.095, model=MODEL, aero_torque=[*torques, torques[-1]])
    exact = angle_and_voltage(values, torques, 1e-3)
    assert np.ptp(exact[:, 1]) > 15.0
    assert np.degrees(np.abs(run["fin_angle"] - exact[:, 0]).max()) < 0.002
    assert np.abs(run["link_voltage"] - exact[:, 1]).max() < 0.1  # V; measured 0.05 as the current jumps, then 0.004


def test_second_order_in_the_tick() -> None:
    fine, *coarse = (run_of({"encoder.enabled": False, "solver.max_tick": tick}, 0.2, aero_torque=-50.0,
                            fin_command=lambda t: 0.26 if sin(40.0 * t) > 0.0 else -0.26)["fin_angle"]
                     for tick in (5e-6, 2e-4, 1e-4, 5e-5))
    errors = [np.abs(each - fine).max() for each in coarse]
    slope = np.polyfit(np.log([4.0, 2.0, 1.0]), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.3), errors
    assert np.degrees(errors[0]) < 0.002


def test_a_trip_opens_the_bridge_and_resets_the_controllers() -> None:
    """From 0.1 to 0.15 s a weak source and 500 W empty the link; afterwards the fin returns to its command."""
    run = run_of({"supply.quiescent_power": 500.0}, 0.6, fin_command=0.2, aero_torque=-40.0,
                 supply_voltage=lambda t: 15.0 if 0.1 <= t < 0.15 else 39.0)
    tripped = run["supply_tripped"] > 0.5
    assert tripped.any()
    assert not tripped[run["time"] < 0.1].any()
    assert not tripped[run["time"] > 0.153].any()
    assert np.abs(run["motor_current"][tripped]).max() == 0.0
    assert np.abs(run["drive_reference"][tripped][2:]).max() == 0.0
    assert (run["status"] == np.where(tripped, 1.0, 4.0)).all()
    assert run["fin_angle"][-1] == pytest.approx(0.2, abs=radians(0.2))


@pytest.mark.parametrize("ohms", [0.05, 0.5, 1e3])
def test_a_trip_is_located_within_its_tick(ohms: float) -> None:
    """Behind 1 kOhm the drive's 40 A lower the link by 1.8 V in a tick of 0.1 ms, which must not delay the trip."""
    weak = {"supply.source_resistance": ohms, "supply.quiescent_power": 50.0, "encoder.enabled": False}
    fine, *coarse = (run_of({**weak, "solver.max_tick": tick}, 0.012, 1e-4, fin_command=0.3, aero_torque=-60.0,
                            supply_voltage=lambda t: 39.0 if t < 0.004 else 16.0) for tick in (2e-6, 1e-4, 5e-5))
    assert 0 < fine["supply_tripped"].sum() < len(fine["time"])
    errors = [np.abs(run["link_voltage"] - fine["link_voltage"]).max() for run in coarse]
    assert errors[0] < 0.03, errors  # V
    assert all((run["supply_tripped"] == fine["supply_tripped"]).all() for run in coarse)


def test_the_trip_time_is_that_of_the_exact_link() -> None:
    """Through chopper and diode; without a trip it is the whole step."""
    p = SimpleNamespace(supply=SimpleNamespace(source_resistance=0.05, one_way=True, capacitance=2e-3,
                                               chopper_voltage=45.0, chopper_resistance=0.5, trip_voltage=18.0))
    for begin, source, load in ((50.0, 30.0, 400.0), (50.0, 10.0, 400.0), (20.0, 40.0, 1000.0), (18.0, 0.0, 5.0)):
        time = supply.trip_time(FLOATS, p, begin, source, load, 1.0)
        assert 0.0 <= time < 1.0
        assert supply.moved(FLOATS, p, begin, source, load, time)[0] == pytest.approx(18.0, abs=1e-9)
    for load, h in ((400.0, 1e-4), (200.0, 1.0)):
        assert supply.trip_time(FLOATS, p, 50.0, 30.0, load, h) == h


def test_between_trip_and_recovery_voltage_the_bridge_stays_as_it_is() -> None:
    def source(t: float) -> float:
        return 39.0 if t < 0.02 else 19.0 if t < 0.04 else 15.0 if t < 0.06 else 19.5 if t < 0.08 else 21.0

    run = run_of({**BLOCKED_MOTOR, "drive.current_offset": 0.0, "supply.quiescent_power": 200.0,
                  "supply.source_resistance": 1e-3}, 0.1, supply_voltage=source)
    assert run["supply_tripped"][[19, 39, 59, 79, 99]].tolist() == [False, False, True, True, False]


def test_a_stiff_lossless_supply_is_nearly_the_plain_model() -> None:
    stiff = {**LOSSLESS, **NO_CHOPPER, "supply.one_way": False, "supply.source_resistance": 1e-6}
    inputs: dict[str, Any] = {"fin_command": 0.3, "aero_torque": -60.0}
    run = run_of(stiff, 0.3, **inputs)
    plain = simulate(load_parameters().with_values({"solver.max_tick": 2.5e-4}).values, 0.3, **inputs)
    # The source drops 60 uV, and ticks differ a little; a count of the encoder is 7e-4 deg.
    assert np.degrees(np.abs(run["fin_angle"] - plain["fin_angle"]).max()) < 2e-3
    assert run["supply_power"] == pytest.approx(plain["supply_power"], abs=0.1 * np.abs(plain["supply_power"]).max())


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("model", others_slow(MODELS, lambda model: model == "nonlinear"))
def test_kernels_agree(model: str) -> None:
    values = values_of({"supply.source_resistance": 0.2, "supply.capacitance": 1e-3, "supply.trip_voltage": 22.0,
                        "supply.recovery_voltage": 26.0}, model=f"{model}+supply")
    run = run_both_kernels(
        values, 0.2, f"{model}+supply", 3.7e-4, fin_command=lambda t: 0.3 if sin(40.0 * t) > 0.0 else -0.3,
        aero_torque=-40.0, enable=lambda t: not 0.1 < t < 0.11,
        supply_voltage=lambda t: 8.0 if 0.12 < t < 0.17 else 39.0)
    assert 0 < np.count_nonzero(run["supply_tripped"]) < len(run["time"])
    assert run["brake_power"].max() > 0.0


def test_recovery_below_the_trip_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"supply\.recovery_voltage = 17 V must not be below"):
        BASE.with_values({"supply.recovery_voltage": 17.0})


def test_units_of_files() -> None:
    values = BASE.with_values({"supply.capacitance": "2200 uF", "supply.source_resistance": "50 mohm"}).values
    assert values["supply.capacitance"] == 2.2e-3
    assert values["supply.source_resistance"] == 0.05


@pytest.mark.fmu
def test_two_fins_in_a_native_fmu(tmp_path: Path) -> None:
    """On a soft line the FMU computes the bits of the run in Python."""
    path = lean(BASE, tmp_path / "native.fmu", fins=2)
    time = np.arange(101) * 1e-3
    command = np.where(np.sin(60.0 * time) >= 0.0, 0.2, -0.2)
    names = [f"fin[{k}].{name}" for k in (1, 2)
             for name in ("fin_angle", "link_voltage", "brake_power", "supply_power")]
    line = ["bus_voltage", "bus_current", "supply_power"]
    run = simulate_fmu(
        str(path), stop_time=0.1, step_size=1e-3, output_interval=1e-3, output=[*line, *names],
        input=np.array(list(zip(time, command, strict=True)), dtype=[("time", float), ("fin[2].fin_command", float)]),
        start_values={"bus.source_resistance": 0.02})
    expected = simulate_fins([BASE.values] * 2, 0.1, 1e-3, MODEL, {"bus.source_resistance": 0.02},
                             **{"fin[2].fin_command": command})
    assert expected["fin[2].brake_power"].max() > 0.0
    assert_equal(run, {name: expected[name] for name in (*line, *names)})

"""Fins with DC links on a bus: balances of charge and energy, and links faster than the bus's update time."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from math import exp, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import supply
from emcas_fmu.simulation import simulate_fins
from tests.marks import slow

from ..fmu.built import lean
from ..fmu.host import Fmu
from ..fmu.lockstep import Lockstep

MODEL = "nonlinear+supply"
RESISTANCE, UPDATE, COMMON = "bus.source_resistance", "bus.update_time", "bus.capacitance"
# Links without loads.
QUIET = {"supply.quiescent_power": 0.0, "supply.device_voltage": 0.0, "supply.device_resistance": 0.0,
         "supply.chopper_voltage": 1e5, "supply.one_way": False}


def values_of(overrides: Mapping[str, Any], model: str = MODEL) -> Any:
    """Return values of a model, some replaced."""
    return load_parameters(model=model).with_values(overrides).values


def disabled_run(sets: list[Any], line: dict[str, float], voltages: list[float]) -> Any:
    """Return a run of disabled fins for five updates at each voltage [V] of the source, with a row at each update."""
    h = line[UPDATE]
    source = np.repeat(voltages, 5)
    off: dict[str, Any] = {f"fin[{k}].enable": False for k in range(1, len(sets) + 1)}
    return simulate_fins(sets, (len(source) - 1) * h, h, MODEL, line, supply_voltage=source, **off)


def links(run: Any, count: int) -> Any:
    return np.array([run[f"fin[{k}].link_voltage"] for k in range(1, count + 1)])


SETTINGS = settings(derandomize=True, max_examples=15)
_logarithmic = {name: st.floats(*bounds).map(lambda x: 10.0**x)
                for name, bounds in {"ohms": (-4.0, 0.0), "farads": (-4.0, -2.0), "times": (-5.0, -2.0)}.items()}
_fins = st.lists(st.tuples(_logarithmic["ohms"], _logarithmic["farads"]), min_size=2, max_size=3)
_in_step = st.sampled_from([1e-5, 5e-5, 1e-4, 2.5e-4, 1e-3, 1e-2])  # others have updates near samples
_voltages = st.lists(st.floats(5.0, 60.0), min_size=2, max_size=3)


@SETTINGS
@given(each=_fins, resistance=_logarithmic["ohms"], update=_logarithmic["times"], voltages=_voltages,
       one_way=st.booleans())
def test_the_bus_supplies_the_charge_that_links_gain(
        each: list[tuple[float, float]], resistance: float, update: float, voltages: list[float],
        one_way: bool) -> None:
    sets = [values_of({**QUIET, "supply.source_resistance": r, "supply.capacitance": c, "supply.one_way": one_way})
            for r, c in each]
    run = disabled_run(sets, {RESISTANCE: resistance, UPDATE: update}, voltages)
    stored = sum(c * (v[-1] - v[0]) for v, (_, c) in zip(links(run, len(sets)), each, strict=True))
    # The charge of each row and the charges of the links are rounded.
    scale = update * np.abs(run["bus_current"]).sum() + 60.0 * sum(c for _, c in each)
    assert update * run["bus_current"][1:].sum() == pytest.approx(stored, abs=1e-13 * scale)


@SETTINGS
@given(each=_fins, resistance=_logarithmic["ohms"], update=_in_step, voltages=_voltages)
def test_no_energy_appears_on_a_bus(each: list[tuple[float, float]], resistance: float, update: float,
                                    voltages: list[float]) -> None:
    """The resistance only dissipates: the sag in an interval is the resistance times the current in it."""
    sets = [values_of({**QUIET, "supply.source_resistance": r, "supply.capacitance": c}) for r, c in each]
    run = disabled_run(sets, {RESISTANCE: resistance, UPDATE: update}, voltages)
    source = np.repeat(voltages, 5)
    # An interval in which the source changes begins with the sag before the change.
    rows = np.array([k for k in range(1, len(source) - 1) if k % 5])
    sag, current = source[rows] - run["bus_voltage"][rows], run["bus_current"][rows + 1]
    scale = max(np.abs(sag).max(), resistance * np.abs(run["bus_current"]).max(), 1.0)
    # A link of up to 10 ms loses 1e-3 of its voltage difference in 10 us, computed as a rounded difference.
    assert sag == pytest.approx(resistance * current, abs=1e-9 * scale)


@SETTINGS
@given(each=_fins, common=_logarithmic["farads"], update=_logarithmic["times"], high=st.floats(10.0, 60.0))
def test_no_energy_appears_between_links(each: list[tuple[float, float]], common: float, update: float, high: float
                                         ) -> None:
    """The source fails while the links of bus and fins differ: their energy then only falls, and their charge is
    constant."""
    sets = [values_of({**QUIET, "supply.source_resistance": r, "supply.capacitance": c}) for r, c in each]
    run = disabled_run(sets, {RESISTANCE: 0.01, UPDATE: update, COMMON: common}, [5.0, high, 0.0, 0.0])
    capacities = np.array([c for _, c in each])
    # The model's bus has at least the capacitance of the links that takes part in an update.
    least = sum(c * (1.0 - exp(-update / (r * c))) for r, c in each)
    # The source has failed in row 10. Row k is after the update k; the bus loses the fins' charge at the next update.
    bus, fins = run["bus_voltage"][11:], links(run, len(sets))[:, 11:]
    charge = max(common, least) * bus + capacities @ fins
    energy = max(common, least) * bus**2 + capacities @ fins**2
    assert charge == pytest.approx(charge[0], rel=1e-9)
    assert np.diff(energy).max() <= 1e-9 * energy[0]


def test_a_battery_loses_the_charge_that_links_gain() -> None:
    """At rest the bus has the open-circuit voltage U q/(Q - q) below the source's."""
    values = values_of({**QUIET, "supply.capacitance": 0.02})
    run = disabled_run([values] * 2, {RESISTANCE: 0.01, UPDATE: 1e-2, "bus.charge": 5.0, "bus.charge_used": 3.0,
                               "bus.polarisation": 2.0}, [39.0, 20.0, *[45.0] * 6])
    gained = 0.02 * np.diff(links(run, 2)[:, [0, -1]]).sum()
    assert abs(gained) > 0.1
    # After thirty updates the transient is rounding.
    assert run["bus_voltage"][-1] == pytest.approx(45.0 - 2.0 * (3.0 + gained) / (2.0 - gained), abs=1e-9)


@pytest.mark.parametrize(("one_way", "mean", "ahead"), [(False, 10.0, None), (True, 10.0, 0.0), (True, 2.0, None)])
def test_mean_current_ahead(one_way: bool, mean: float, ahead: float | None) -> None:
    """The next step's mean of an exponential follows from the mean and the end of this step of 0.7 time constants; it
    is 0 against a diode."""
    p = type("P", (), {"supply": type("S", (), {"source_resistance": 0.1, "capacitance": 0.02, "one_way": one_way})})
    ratio = 0.7
    first = (1.0 - exp(-ratio)) / ratio
    begin = (mean - 1.0) / first if ahead is None else mean / first
    load = 1.0 if ahead is None else -20.0
    end, mean = load + begin * exp(-ratio), load + begin * first
    exact = load + begin * exp(-ratio) * first if ahead is None else ahead
    assert supply.mean_ahead(FLOATS, p, end, mean, ratio * 0.1 * 0.02) == pytest.approx(exact, rel=1e-12)


def _step(update: float, ohms: float, step: float = 1e-3, **overrides: Any) -> Any:
    """Return a run of four fins in a step of 10 deg, with links behind a resistance [ohm]."""
    values = values_of({"supply.source_resistance": ohms, **overrides})
    return simulate_fins([values] * 4, 0.04, step, MODEL, {RESISTANCE: 0.02, UPDATE: update},
                         fin_command=radians(10.0))


def test_links_faster_than_the_update_time() -> None:
    """With R_s C of 2.2 us the error is of first order, and the largest current within 2 % up to 180 times R_s C."""
    resolved: dict[str, Any] = {"solver.max_tick": 2e-5, "encoder.enabled": False}
    fine = _step(1e-5, 1e-3, **resolved)
    errors = []
    for update in (4e-4, 1e-4, 5e-5):
        run = _step(update, 1e-3, **resolved)
        errors.append((np.linalg.norm(run["bus_voltage"] - fine["bus_voltage"]),
                       np.linalg.norm(run["fin[1].link_voltage"] - fine["fin[1].link_voltage"])))
        assert np.degrees(np.abs(run["fin[1].fin_angle"] - fine["fin[1].fin_angle"]).max()) < 0.005
        assert run["bus_current"].max() == pytest.approx(fine["bus_current"].max(), rel=0.02)
    orders = np.log2(np.array(errors[1]) / np.array(errors[2]))
    # The order is 1; differences from a reference with 10 us instead of 0 have 1.17.
    assert ((orders > 0.9) & (orders < 1.4)).all(), errors
    assert np.abs(run["bus_voltage"] - fine["bus_voltage"]).max() < 0.12  # V; the sag is 4.4 V


@pytest.mark.parametrize("ohms", [1e-3, *slow(0.05)])
def test_the_bus_supplies_the_charge_of_links_drives_and_choppers(ohms: float) -> None:
    """Trapezia integrate the outputs."""
    resolved = {"supply.chopper_voltage": 41.0, "solver.max_tick": 1e-5}
    run, fine = (_step(1e-3, ohms, step, **resolved) for step in (1e-3, 1e-5))
    time = fine["time"]
    charge = 0.0
    for k in range(1, 5):
        link, voltage, current, loss, chopper = (fine[f"fin[{k}].{name}"] for name in (
            "link_voltage", "motor_voltage", "motor_current", "inverter_loss", "brake_power"))
        charge += 2.2e-3 * (link[-1] - link[0])
        charge += float(np.trapezoid((voltage * current + loss + chopper + 8.0) / link, time))
    # The voltage jumps within an interval at each sample: measured 2e-3, and half of that with half the interval.
    assert 1e-3 * run["bus_current"][1:].sum() == pytest.approx(charge, rel=5e-3)


def test_in_a_brown_out_the_bus_receives_the_power_that_links_return() -> None:
    """The bus's voltage is higher than behind the drop, so that its current is less than the links'."""
    model = f"{MODEL}+faults"
    values = values_of({"supply.one_way": False, "supply.chopper_voltage": 1e5, "solver.max_tick": 2e-5}, model)
    weak = {**values, "fault.brown_out.active": True, "fault.brown_out.share": 0.6}
    run = simulate_fins([weak, weak], 0.1, 1e-3, model, {RESISTANCE: 0.02, UPDATE: 1e-5},
                        fin_command=lambda t: 0.25 if sin(60.0 * t) > 0.0 else -0.25, aero_torque=60.0)
    power = run["fin[1].supply_power"] + run["fin[2].supply_power"]
    returned = power < -100.0
    assert returned.sum() > 3
    # The current is the mean over the last 10 us, the voltage the one since.
    assert run["bus_current"][returned] == pytest.approx((power / run["bus_voltage"])[returned], rel=0.05)


@pytest.mark.parametrize("update", [1e-4, 1e-3])
def test_powers_of_fins_add_up_to_that_of_the_bus(update: float) -> None:
    """With rows an update apart they are also the bus's current times its voltage in that update."""
    line = {RESISTANCE: 0.05, UPDATE: update}
    run = simulate_fins([values_of({"supply.source_resistance": 0.001})] * 4, 0.1, 1e-3, MODEL, line,
                        **{f"fin[{k}].fin_command": radians(10.0 - 20.0 * (k % 2)) for k in range(1, 5)})
    fins = sum(run[f"fin[{k}].supply_power"] for k in range(1, 5))
    np.testing.assert_allclose(run["supply_power"], fins, rtol=1e-12, atol=1e-9)
    if update == 1e-3:
        # The current of a row flowed at the voltage of the row before.
        mean = run["supply_power"][2:] / run["bus_voltage"][1:-1]
        np.testing.assert_allclose(run["bus_current"][2:], mean, rtol=1e-12, atol=1e-9)


@pytest.mark.fmu
def test_back_ends_compute_the_same_bits_with_restored_charges(tmp_path: Path) -> None:
    """In lockstep under changing inputs with trips."""
    built = lean(load_parameters(model=MODEL), tmp_path / "fins.fmu", fins=4)
    shutil.unpack_archive(built, tmp_path / "fins", "zip")
    fins = Lockstep(MODEL, Fmu(str(tmp_path / "fins")), {RESISTANCE: 0.05, "bus.charge": 50.0})
    levels = [fins.unit.get("bus_voltage") for _ in fins.run(5, "supply_voltage", 12.0, 42.0)]
    assert min(levels) < 18.0
    fins.unit.free()

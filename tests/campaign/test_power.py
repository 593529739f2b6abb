"""Power and energy: right in spite of transients in step with the controller, and with their signs."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.excitation import STEP
from emcas_fmu.campaign import measure, runners
from emcas_fmu.campaign.experiments import POWER_STEP, Excitation, Experiment, Profile, excitation
from emcas_fmu.reference.cases import LEAD_IN
from emcas_fmu.simulation import respond

FINE = 50  # rows of 20 us
Set = Mapping[str, Any]


def stepped(values: Set, degrees: float, *profiles: Profile, **more: float) -> tuple[Excitation, dict[str, float]]:
    """A step's excitation and figures."""
    experiment = Experiment("a", "step", 0.6, profiles)
    numbers = {"experiments.a.amplitude": radians(degrees), **{f"load.{k}": v for k, v in more.items()}}
    made = excitation(experiment, values, numbers)
    found = measure.figures(experiment, numbers, made, runners.by_kernel(values, made))
    return made, {name.removeprefix("a."): value for name, value in found.items()}


def finely(values: Set, made: Excitation) -> dict[str, Any]:
    """The response from the command's instant on, in rows of 20 us."""
    table = np.repeat(made.table, FINE, axis=0)[:1 - FINE]
    first = round(LEAD_IN / STEP) * FINE
    return {name: column[first:] for name, column in respond(values, table, STEP / FINE).items()}


@pytest.mark.parametrize("degrees", [1.0, 5.0, 20.0])
def test_rows_of_20_us_say_the_same(values: Set, degrees: float) -> None:
    """What remains is measured: 0.9 % at most with the shipped delay, a third of it of the 20 us themselves."""
    made, found = stepped(values, degrees)
    power = finely(values, made)["supply_power"]
    assert found["energy"] == pytest.approx(np.trapezoid(power, dx=STEP / FINE), rel=0.012)
    assert found["power_rms"] == pytest.approx(np.sqrt(np.mean(power**2)), rel=0.012)


def test_energy_goes_into_the_winding_and_the_shaft(values: Set) -> None:
    """Drawn: copper loss, what the shaft is given (motion, friction), and the field's change. Regenerating, the
    motor gives some of it back: without signs it would be a quarter more. Two integrals of one response agree to
    the 1 % of the rows' distance."""
    made, found = stepped(values, 1.0)
    fine = finely(values, made)
    current, speed = fine["motor_current"], fine["motor_speed"]
    copper = values["motor.resistance"] * current**2
    shaft = values["motor.back_emf_constant"] * speed * current
    field = values["motor.inductance"] / 2.0 * (current[-1]**2 - current[0]**2)
    assert found["energy"] == pytest.approx(np.trapezoid(copper + shaft, dx=STEP / FINE) + field, rel=0.015)
    assert found["energy"] < 0.85 * np.trapezoid(np.abs(fine["supply_power"]), dx=STEP / FINE)


def test_a_spring_is_sampled_as_finely(values: Set) -> None:
    """One too weak to be felt: the coupled run steps through the same response, to a millionth."""
    _, plain = stepped(values, 5.0)
    _, sprung = stepped(values, 5.0, Profile("aero_torque", "spring", "load"), stiffness=1e-9, offset=0.0)
    for name in ("energy", "power_rms", "power_peak"):
        assert sprung[name] == pytest.approx(plain[name], rel=1e-6)


@pytest.mark.parametrize("leap", [3.0, 3.25, 3.7])
def test_leaps_between_rows_cost_nothing(values: Set, leap: float) -> None:
    """Of lines between leaps, wherever these lie, energy is exact but for rounding."""
    experiment = Experiment("a", "hold", 0.1)
    numbers = {"experiments.a.amplitude": 0.0}
    made = excitation(experiment, {**values, "drive.transport_delay": leap * 1e-3}, numbers)
    response = runners.by_kernel(values, made)
    time = np.arange(len(response["supply_power"])) * POWER_STEP - LEAD_IN
    phase = np.mod(time / STEP - leap % 1.0 - 1e-6, 1.0)  # a row on a leap is before it
    found = measure.figures(experiment, numbers, made, {**response, "supply_power": 7.0 - 4.0 * phase})
    assert found["a.energy"] == pytest.approx(0.1 * 5.0, rel=0.005)  # the first and last cut are not extended to


def test_samples_too_close_to_be_told_apart(values: Set) -> None:
    quick = {**values, "controller.sample_time": 0.25e-3}
    assert not len(excitation(Experiment("a", "hold", 0.1), quick, {"experiments.a.amplitude": 0.0}).told)

"""The series clutch actuator: loads that act with the motion give nothing back, and hold at no current."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from emcas_fmu.actuators import capabilities, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "series-clutch"
LOAD = 100.0  # N.m


def _returned(model: str, load: float) -> float:
    """Energy [J] that comes back from a slew with a load on the way."""
    values = load_parameters(model=model).values
    run = simulate(values, 0.9, 1e-4, model=model, aero_torque=lambda t: load if t > 0.45 else 0.0,
                   fin_command=lambda t: radians(20.0 if t > 0.5 else -20.0))
    return -float(np.trapezoid(np.minimum(run["supply_power"], 0.0), dx=1e-4))


def test_a_load_returns_no_energy() -> None:
    """What comes back is less than the rotor has in motion, whatever the load; of the nonlinear one, most work."""
    values = load_parameters(model=MODEL).values
    rotor = 0.5 * (values["inertia.motor"] + values["inertia.screw"]) * (
        1.1 * values["controller.speed_limit"])**2  # which the motor overshoots by less
    # Twice: once at the end of each slew, to -20 and to 20 deg.
    assert _returned(MODEL, LOAD) < 2.0 * rotor
    work = LOAD * radians(40.0)
    assert _returned("nonlinear", LOAD) - _returned("nonlinear", 0.0) > 0.3 * work
    # The motor's speed is not the same to the end: within what a slew without load returns.
    assert _returned(MODEL, LOAD) <= 1.5 * _returned(MODEL, 0.0) + 1.0


@pytest.mark.parametrize("load", [LOAD, -LOAD])
def test_it_holds_any_load_without_current(load: float) -> None:
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.5, model=MODEL, enable=False, aero_torque=3.0 * load)
    assert np.all(run["fin_angle"] == 0.0)
    assert np.all(run["supply_power"] == 0.0)


def test_a_load_with_the_motion_is_turned_into_heat() -> None:
    """At a steady rate the motor gives what it gives without load, and the clutch takes the load's power."""
    values = load_parameters(model=MODEL).values

    def steady(load: float) -> tuple[float, float, float]:
        run = simulate(values, 0.35, 1e-4, model=MODEL, aero_torque=load,
                       fin_command=lambda t: radians(-18.0 + 100.0 * max(t - 0.05, 0.0)))
        part = (run["time"] > 0.2) & (run["time"] < 0.3)
        return (float(run["supply_power"][part].mean()), float(run["screw_loss"][part].mean()),
                float((run["fin_rate"] * run["hinge_torque"])[part].mean()))

    loaded, heat, power = steady(LOAD)
    assert heat == pytest.approx(power, rel=0.02)  # and what little the fin's inertia takes
    assert loaded == pytest.approx(steady(0.0)[0], rel=0.1)  # the loops hunt for their rate by some %


def test_it_has_its_losses_itself() -> None:
    assert capabilities.SCREW_LOAD not in get(MODEL).provides
    with pytest.raises(EmcasError, match="efficiency needs a screw without losses"):
        get(f"{MODEL}+efficiency")

"""Saturation of the motor's iron: closed forms, independent integrations, order in the tick, energy, both kernels."""

from __future__ import annotations

from functools import partial
from math import radians, sin

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.capabilities import CURRENT_LIMIT, MOTOR_CURRENT
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics.saturation import constants_left
from emcas_fmu.simulation import simulate
from tests.marks import others_slow, slow
from tests.runs import run_both_kernels
from tests.simulation import acting

from . import runs
from .held import BLOCKED_FAST
from .runs import NO_CONTROLLER, REFERENCES, tick_errors

MODEL = "nonlinear+saturation"
HAVE = [name for name in NAMES if {MOTOR_CURRENT, CURRENT_LIMIT} <= get(name).provides]
SHARE, SATURATION_CURRENT = 0.2, 60.0  # 1, A
SATURATED = {"saturation.share": SHARE}
values_of = partial(runs.values_of, model=MODEL)


@pytest.mark.parametrize("current", [-60.0, 5.0, 30.0, 60.0])
def test_stall_torque(current: float) -> None:
    """A blocked motor has the torque K_t i (1 - s (i/i_s)^2), to rounding; saturation does not change its current."""
    run, plain = (simulate(values_of(BLOCKED_FAST, drive__current_offset=current, saturation__share=share), 0.01,
                           model=MODEL) for share in (SHARE, 0.0))
    i = run["motor_current"][-1]
    assert i == pytest.approx(current, rel=1e-3)  # less by R/(R + K_p)
    assert run["motor_torque"][-1] == pytest.approx(0.11 * i * (1.0 - SHARE * (i / SATURATION_CURRENT) ** 2), rel=1e-12)
    assert np.array_equal(run["motor_current"], plain["motor_current"])


@pytest.mark.parametrize("model", others_slow(REFERENCES, lambda name: name == "nonlinear"))
def test_independent_integration_agrees(model: str) -> None:
    """In a step of 10 deg against 50 N.m, with a fifth of the motor constants lost at 60 A, ticks as shipped are within
    0.003 deg (measured 0.0020 with the worm gear and 0.0016 nonlinear at 0.7 ms, far less with the others' shorter
    ticks)."""
    parameters = load_parameters(model=f"{model}+saturation")
    values = parameters.with_values({**SATURATED, **parameters.having({"encoder.enabled": False})}).values
    assert tick_errors(model, "saturation", values, 0.15, [1.0], fin_command=radians(10.0), aero_torque=-50.0) < 3e-3


@pytest.mark.parametrize("load", [-100.0, 100.0, *slow(0.0)])
def test_order_in_the_tick(load: float) -> None:
    """Half the tick leaves a quarter of the error, from 0.35 ms on, three time constants of the current."""
    errors = tick_errors("nonlinear", "saturation", values_of(SATURATED, encoder__enabled=False), 0.15,
                         (0.5, 0.25, 0.125), fin_command=radians(20.0), aero_torque=load)
    assert errors[0] < 5e-4
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - 2.0) < 0.3), errors


@pytest.mark.parametrize("load", [-150.0, 150.0])
@pytest.mark.parametrize("current", [-50.0, 50.0])
def test_no_energy_appears(current: float, load: float) -> None:
    """The drive's work is the heat of the winding, the energy of its inductance and the work on the shaft, whether the
    motor drives or is driven. With the whole back-EMF over a joule would be missing or appear.

    The reference is constant: trapezoids of 5 us leave 3e-5 J (measured) of the current's fast rise at the start.
    """
    run = simulate(values_of(NO_CONTROLLER, drive__current_offset=current, solver__max_tick=5e-6,
                             saturation__share=0.3), 0.04, 5e-6, model=MODEL, aero_torque=load)
    v, i, torque, speed = (run[f"motor_{name}"][1:] for name in ("voltage", "current", "torque", "speed"))
    lost = np.trapezoid(v * i - 0.25 * i * i - torque * speed, dx=5e-6)
    moved = np.trapezoid(np.abs(torque * speed), dx=5e-6)
    stored = 0.5 * 0.6e-3 * (i[-1] ** 2 - i[0] ** 2)
    assert moved > 15.0
    assert lost == pytest.approx(stored, abs=1e-4)


def test_small_motions_have_the_slope_of_the_torque() -> None:
    """d(dw/dt)/di = K_t (1 - 3 s (i/i_s)^2)/J; the difference over 2 mA is off by s (1 mA/i_s)^2, 6e-11, and rounding.
    """
    actuator, p = get(MODEL), load_parameters(model=MODEL).with_values(SATURATED).nested()
    start = actuator.start(FLOATS, p)

    def rate(current: float) -> float:
        x = Record(**{**start, "motor_current": current})
        return float(actuator.rates(FLOATS, p, x, acting())["motor_speed"])

    slopes = [(rate(i + 1e-3) - rate(i - 1e-3)) / 2e-3 for i in (0.0, 40.0)]
    assert slopes[1] / slopes[0] == pytest.approx(1.0 - 3.0 * SHARE * (40.0 / SATURATION_CURRENT) ** 2, rel=1e-6)


def test_beyond_the_largest_torque_the_motor_constants_are_two_thirds() -> None:
    p = load_parameters(model=MODEL).with_values(SATURATED).nested()
    largest = SATURATION_CURRENT / (3.0 * SHARE) ** 0.5
    assert constants_left(FLOATS, p, largest**2) == pytest.approx(2.0 / 3.0, rel=1e-12)
    assert constants_left(FLOATS, p, 4.0 * largest**2) == 2.0 / 3.0


def test_a_drive_beyond_the_largest_torque_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"largest torque at 51\.6398 A, .* below drive\.current_limit = 60 A"):
        load_parameters(model=MODEL).with_values({"saturation.current": 40.0, "saturation.share": 0.2})


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize("model", [MODEL, *slow(*(f"{name}+saturation+heat+faults" for name in HAVE))])
def test_kernels_agree(model: str) -> None:
    run = run_both_kernels(values_of(SATURATED, model=model), 0.2, model, aero_torque=20.0,
                           fin_command=lambda t: 0.3 * sin(20.0 * t))
    assert np.abs(run["motor_current"]).max() > 15.0  # it saturates

"""Saturation of the motor's iron: closed forms, independent integrations, order in the tick, energy, both kernels."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from math import radians, sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.capabilities import CURRENT_LIMIT, MOTOR_CURRENT
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics.saturation import constants_left
from emcas_fmu.reference.simulate import simulate as integrated
from emcas_fmu.simulation import simulate
from tests.marks import others_slow, slow
from tests.simulation import acting

from .held import HELD

MODEL = "nonlinear+saturation"
HAVE = [name for name in NAMES if {MOTOR_CURRENT, CURRENT_LIMIT} <= get(name).provides]
SHARE, AT = 0.2, 60.0  # 1, A
REFERENCES = {"nonlinear": ("plant", "Plant"), "worm-gear": ("worm_gear", "WormPlant"),
              "worm-gear-elastic": ("worm_gear_elastic", "MeshPlant"),
              "series-clutch": ("series_clutch", "SeriesClutch"),
              "electrohydrostatic": ("electrohydrostatic", "Electrohydrostatic")}


def _values(model: str = MODEL, **overrides: Any) -> Any:
    named = {name.replace("__", "."): value for name, value in overrides.items()}
    return load_parameters(model=model).with_values({"saturation.share": SHARE, **named}).values


@pytest.mark.parametrize("current", [-60.0, 5.0, 30.0, 60.0])
def test_stall_torque(current: float) -> None:
    """K_t i (1 - s (i/i_s)^2) of a motor that friction holds, to rounding; its current does not saturate."""
    still: dict[str, Any] = {name.replace(".", "__"): value for name, value in HELD.items()}
    run, plain = (simulate(_values(**still, drive__current_offset=current, saturation__share=share), 0.01, model=MODEL)
                  for share in (SHARE, 0.0))
    i = run["motor_current"][-1]
    assert i == pytest.approx(current, rel=1e-3)  # short by R/(R + K_p)
    assert run["motor_torque"][-1] == pytest.approx(0.11 * i * (1.0 - SHARE * (i / AT) ** 2), rel=1e-12)
    assert np.array_equal(run["motor_current"], plain["motor_current"])


def _differences(model: str, ticks: Sequence[float], command: float, load: float) -> Any:
    """Return the largest differences [deg] to the independent integration in 0.15 s, ticks shorter by factors."""
    module, kind = REFERENCES[model]
    name = f"{model}+saturation"
    parameters = load_parameters(model=name)
    values = parameters.with_values({"saturation.share": SHARE, **parameters.having({"encoder.enabled": False})}).values
    time = np.arange(151) * 1e-3
    columns = {"time": time, "fin_command": np.full(151, command), "aero_torque": np.full(151, load)}
    expected = integrated(values, columns, getattr(import_module(f"emcas_fmu.reference.{module}"), kind))
    runs = [simulate({**values, "solver.max_tick": values["solver.max_tick"] * tick}, 0.15, model=name,
                     fin_command=command, aero_torque=load) for tick in ticks]
    return np.array([np.degrees(np.abs(run["fin_angle"] - expected["fin_angle"]).max()) for run in runs])


@pytest.mark.parametrize("model", others_slow(REFERENCES, lambda name: name == "nonlinear"))
def test_against_the_independent_integration(model: str) -> None:
    """Steps of 10 deg against 50 N.m with a fifth of the constants lost at 60 A: ticks of 0.7 ms are within 0.003 deg
    (measured 0.0020 with the worm gear, 0.0016 nonlinear), the shorter ones of the others far below."""
    assert _differences(model, [1.0], radians(10.0), -50.0) < 3e-3


@pytest.mark.parametrize("load", [-100.0, 100.0, *slow(0.0)])
def test_order_in_the_tick(load: float) -> None:
    """Of second order, from ticks of 0.35 ms, three time constants of the current: a quarter with half the tick."""
    errors = _differences("nonlinear", (0.5, 0.25, 0.125), radians(20.0), load)
    assert errors[0] < 5e-4
    assert np.all(np.abs(np.log2(errors[:-1] / errors[1:]) - 2.0) < 0.3), errors


@pytest.mark.parametrize("load", [-150.0, 150.0])
@pytest.mark.parametrize("current", [-50.0, 50.0])
def test_no_energy_appears(current: float, load: float) -> None:
    """The drive's work is the heat of the winding, the energy of its inductance and the work on the shaft, whether the
    motor drives or is driven; with the whole back-EMF over a joule would be missing or appear. The reference is
    constant: trapezoids of 5 us leave 3e-5 J (measured) of the winding's fast rise at the start."""
    loops: dict[str, Any] = {f"controller__{gain}": 0.0 for gain in ("position__kp", "position__ki", "velocity__kp")}
    run = simulate(_values(**loops, compensation__gain=0.0, drive__current_offset=current, solver__max_tick=5e-6,
                           saturation__share=0.3), 0.04, 5e-6, model=MODEL, aero_torque=load)
    v, i, torque, speed = (run[f"motor_{name}"][1:] for name in ("voltage", "current", "torque", "speed"))
    lost = np.trapezoid(v * i - 0.25 * i * i - torque * speed, dx=5e-6)
    moved = np.trapezoid(np.abs(torque * speed), dx=5e-6)
    stored = 0.5 * 0.6e-3 * (i[-1] ** 2 - i[0] ** 2)
    assert moved > 15.0
    assert lost == pytest.approx(stored, abs=1e-4)


def test_small_motions_have_the_slope_of_the_torque() -> None:
    """d(dw/dt)/di = K_t (1 - 3 s (i/i_s)^2)/J: a sixth of 2e-6 A of a cubic, and rounding, below 1e-6 of it."""
    actuator, p = get(MODEL), load_parameters(model=MODEL).with_values({"saturation.share": SHARE}).nested()
    start = actuator.start(FLOATS, p)

    def rate(current: float) -> float:
        x = Record(**{**start, "motor_current": current})
        return float(actuator.rates(FLOATS, p, x, acting())["motor_speed"])

    slopes = [(rate(i + 1e-3) - rate(i - 1e-3)) / 2e-3 for i in (0.0, 40.0)]
    assert slopes[1] / slopes[0] == pytest.approx(1.0 - 3.0 * SHARE * (40.0 / AT) ** 2, rel=1e-6)


def test_beyond_the_largest_torque() -> None:
    """Two thirds of the constants are left there and beyond, so that the torque does not fall with the current."""
    p = load_parameters(model=MODEL).with_values({"saturation.share": SHARE}).nested()
    largest = AT / (3.0 * SHARE) ** 0.5
    assert constants_left(FLOATS, p, largest**2) == pytest.approx(2.0 / 3.0, rel=1e-12)
    assert constants_left(FLOATS, p, 4.0 * largest**2) == 2.0 / 3.0


def test_a_drive_beyond_the_largest_torque_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"largest torque at 51\.6398 A, .* below drive\.current_limit = 60 A"):
        load_parameters(model=MODEL).with_values({"saturation.current": 40.0, "saturation.share": 0.2})


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize("model", [MODEL, *slow(*(f"{name}+saturation+heat+faults" for name in HAVE))])
def test_both_kernels(model: str) -> None:
    """The same bits, of a motion that saturates."""
    python, compiled = (simulate(_values(model), 0.2, model=model, kernel=kernel, aero_torque=20.0,
                                 fin_command=lambda t: 0.3 * sin(20.0 * t)) for kernel in ("python", "compiled"))
    assert all(np.array_equal(python[name], compiled[name]) for name in python)
    assert np.abs(python["motor_current"]).max() > 15.0

"""The extension `torque`: the actuator coupled to the host's fin moves as the actuator with its own fin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import degrees, radians
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emcas_fmu.actuators import NAMES, NONLINEAR, TORQUE, get, with_extension
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference.plant import simulate
from emcas_fmu.runtime import codegen
from tests.marks import slow

from .runs import NO_COULOMB

Moment = Callable[[float, float, float], float]
Values = Mapping[str, Any]
STEP = 1e-3
RIGID = (NONLINEAR, "linear", "ristanovic", "worm-gear")
PARTS = ("inertia.fin", "inertia.shaft", "inertia.fork")
# With an encoder a difference of one bit could become a count, 0.0007 deg at the fin.
NO_ENCODER = {"encoder.enabled": False}
FRICTIONLESS = {**NO_COULOMB, "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0,
                "compensation.gain": 0.0}


class NamedCore:
    """The core of an actuator, with its inputs and outputs by name."""

    def __init__(self, model: str, changes: Values) -> None:
        self.values = {**load_parameters(model=model).values, **changes}
        self.actuator, self.core = get(model), codegen.core(self.values, model)
        self.inputs = {v.name: float(v.initial(self.values)) for v in self.actuator.inputs}

    def run(self, end: float, **inputs: float) -> dict[str, float]:
        self.inputs |= inputs
        values = self.core.run(end, codegen.core_inputs(self.core, list(self.inputs.values()), self.actuator))
        return dict(zip((v.name for v in self.actuator.outputs), map(float, values), strict=True))


class Host:
    """A fin with the armature that a host integrates in one step, by semi-implicit `euler` or by Runge-Kutta."""

    def __init__(self, inertia: float, euler: bool, moment: Moment) -> None:
        self.inertia, self.euler, self.moment, self.angle, self.rate = inertia, euler, moment, 0.0, 0.0

    def step(self, time: float, torque: float, h: float) -> None:
        def rates(t: float, angle: float, rate: float) -> tuple[float, float]:
            return rate, (torque + self.moment(t, angle, rate)) / self.inertia

        a, w = self.angle, self.rate
        if self.euler:
            self.rate = w + h * rates(time, a, w)[1]
            self.angle = a + h * self.rate
            return
        k1 = rates(time, a, w)
        k2 = rates(time, a + 0.5 * h * k1[0], w + 0.5 * h * k1[1])
        k3 = rates(time, a + 0.5 * h * k2[0], w + 0.5 * h * k2[1])
        k4 = rates(time, a + h * k3[0], w + h * k3[1])
        self.angle, self.rate = (x + h / 6.0 * (p + 2.0 * q + 2.0 * r + s)
                                 for x, p, q, r, s in zip((a, w), k1, k2, k3, k4, strict=True))


def coupled(model: str, stop: float, moment: Moment, *, euler: bool = True, scale: float = 1.0, h: float = STEP,
            known: bool = False, values: Values | None = None, **inputs: Callable[[float], float]
            ) -> Iterator[tuple[float, Host, dict[str, float]]]:
    """Yield time, host and outputs after each step; the host's fin has `scale` times the default inertia.

    The actuator's parameters have this inertia if it is `known`, otherwise the default.
    """
    default = load_parameters(model=model).values
    core = NamedCore(with_extension(model, TORQUE), {
        **(values or {}), **({name: scale * default[name] for name in PARTS} if known else {})})
    inertia = scale * sum(default[name] for name in PARTS)
    host = Host(inertia, euler, moment)
    for k in range(round(stop / h)):
        out = core.run(k * h + h, step_begin=k * h, hinge_angle=host.angle, hinge_rate=host.rate,
                       **{name: float(value(k * h)) for name, value in inputs.items()})
        host.inertia = inertia + out["armature"]
        host.step(k * h, out["actuator_torque"], h)
        yield (k + 1) * h, host, out


def whole(model: str, stop: float, moment: Moment, *, scale: float = 1.0, h: float = STEP, values: Values | None = None,
          **inputs: Callable[[float], float]) -> NDArray[np.float64]:
    """Return the angle [rad] of the actuator's own fin after each step, with a new moment every 0.1 ms."""
    default = load_parameters(model=model).values
    core, fine = NamedCore(model, {**(values or {}), **{name: scale * default[name] for name in PARTS}}), 1e-4
    angle, rate, angles, parts = 0.0, 0.0, [], round(h / fine)
    for k in range(round(stop / h)):
        at = {name: float(value(k * h)) for name, value in inputs.items()}
        for j in range(1, parts + 1):
            middle = moment(k * h, angle + 0.5 * fine * rate, rate)  # of the step, for second order
            out = core.run(k * h + j * fine, aero_torque=middle, **at)
            angle, rate = out["fin_angle"], out["fin_rate"]
        angles.append(angle)
    return np.array(angles)


def restoring(time: float, angle: float, rate: float) -> float:
    return -100.0 * angle - 0.5 * rate  # N.m


def pushed(time: float, angle: float, rate: float) -> float:
    return -20.0 if time > 0.1 else 0.0  # N.m


def steps(time: float) -> float:
    return radians(10.0 * (time > 0.02) - 15.0 * (time > 0.15))


def difference(model: str, moment: Moment, *, stop: float = 0.3, h: float = STEP, **options: Any) -> float:
    """Return the largest difference [deg] of the host's fin from that of the actuator with its fin."""
    no_encoder = NO_ENCODER if "encoder.enabled" in load_parameters(model=model).values else {}
    shared = {"values": no_encoder | options.pop("values", {}), "fin_command": options.pop("command", steps)}
    angles = np.array([host.angle for _, host, _ in coupled(model, stop, moment, h=h, **options, **shared)])
    expected = whole(model, stop, moment, h=h, scale=options.get("scale", 1.0), **shared)
    assert np.ptp(expected) > radians(0.02)
    return degrees(np.abs(angles - expected).max())


@pytest.mark.parametrize("euler", [True, False])
@pytest.mark.parametrize("moment", [restoring, pushed])
@pytest.mark.parametrize("scale", [0.25, 1.0, 4.0])
def test_the_host_s_fin_moves_as_the_actuator_s_own(scale: float, moment: Moment, euler: bool) -> None:
    """At 1 ms, with the parameters of the default inertia. Measured 0.0007 to 0.005 deg; the limit is 0.01 deg."""
    assert difference(NONLINEAR, moment, euler=euler, scale=scale) < 0.01


@pytest.mark.parametrize("h", [1e-4, 3e-4, *slow(5e-4, 7e-4)])
@pytest.mark.parametrize("euler", [True, False])
def test_any_step_size_of_the_host(h: float, euler: bool) -> None:
    """Also one that does not divide the sample time. Same limit."""
    assert difference(NONLINEAR, restoring, euler=euler, h=h) < 0.01


@pytest.mark.parametrize("euler", [True, False])
@pytest.mark.parametrize("model", slow("ristanovic", "worm-gear", f"{NONLINEAR}+stribeck+efficiency+heat+supply"))
def test_the_host_s_fin_moves_as_that_of_other_actuators(model: str, euler: bool) -> None:
    """Measured up to 0.008 deg, with the inertia known."""
    assert difference(model, restoring, euler=euler, known=True) < 0.01


@pytest.mark.parametrize("euler", [True, *slow(False)])
def test_independent_integration_agrees(euler: bool) -> None:
    """SciPy integrates rotor and fin as one body under a load over time."""
    time = np.arange(301) * STEP
    values = {**load_parameters().values, **NO_ENCODER}
    expected = simulate(values, {"time": time, "fin_command": np.array([steps(t) for t in time]),
                                 "aero_torque": np.array([pushed(t, 0.0, 0.0) for t in time])})["fin_angle"]
    angles = [host.angle for _, host, _ in coupled(NONLINEAR, 0.3, pushed, euler=euler, values=NO_ENCODER,
                                                   fin_command=steps)]
    assert degrees(np.abs(np.array(angles) - expected[1:]).max()) < 0.01


@pytest.mark.parametrize("euler", [True, False])
@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_a_fin_at_rest_does_not_begin_to_oscillate(scale: float, euler: bool) -> None:
    """Under 20 N.m, in 5 s, its rate is rounding (1e-18 rad/s)."""
    moved = [(host.angle, host.rate) for _, host, _ in coupled(
        NONLINEAR, 10.0, lambda time, angle, rate: -20.0, euler=euler, scale=scale, values=NO_ENCODER)]
    angles, rates = np.array(moved[5000:]).T
    assert np.ptp(angles) < 1e-12
    assert np.abs(rates).max() < 1e-12


@pytest.mark.parametrize("euler", [True, False])
def test_friction_holds_the_host_s_fin(euler: bool) -> None:
    """8 N.m are less than the dry friction of 12 N.m at the fin of a disabled drive.

    In the first step the actuator does not yet know the load T: the fin turns by T h^2/J, and by 2.8 times that until
    it rests (measured).
    """
    moved = [host.angle for _, host, _ in coupled(NONLINEAR, 1.0, lambda *_: 8.0, euler=euler,
                                                  enable=lambda time: False)]
    assert 0.0 < moved[-1] < 3.0 * 8.0 * STEP * STEP / 1.19
    assert moved[-1] == moved[10]


@pytest.mark.parametrize("euler", [True, False])
@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_the_host_s_fin_rests_at_a_stop(scale: float, euler: bool) -> None:
    """400 N.m push the fin of a disabled drive to its stop; it leaves the stop when they change their sign."""
    def moment(time: float, angle: float, rate: float) -> float:
        return 400.0 if time < 0.5 else -400.0

    run = [(host.angle, host.rate, out["at_stop"]) for _, host, out in coupled(
        NONLINEAR, 0.6, moment, euler=euler, scale=scale, enable=lambda time: False)]
    angle, rate, at_stop = run[499]
    assert degrees(angle) == pytest.approx(25.0, abs=1e-6)
    assert abs(rate) < 1e-6
    assert at_stop == 1.0
    assert degrees(run[-1][0]) < 20.0


@pytest.mark.parametrize("euler", [True, False])
def test_the_motor_s_work_is_the_energy_of_a_spring_at_the_fin(euler: bool) -> None:
    """From rest to rest without friction. Measured error: 4e-4 of the motor's positive work of 13 J (1e-4 with steps of
    0.1 ms, and with the actuator's own fin: the quadrature's)."""
    model, default = with_extension(NONLINEAR, TORQUE), load_parameters().values
    core, spring = NamedCore(model, {**NO_ENCODER, **FRICTIONLESS}), 100.0  # N.m/rad
    host = Host(sum(default[name] for name in PARTS) + core.run(0.0)["armature"], euler,
                lambda time, angle, rate: -spring * angle)
    work = positive_work = power = 0.0
    for k in range(400):
        for j in range(1, 51):  # parts of a step, to integrate the motor's power
            out = core.run((k + 0.02 * j) * STEP, step_begin=k * STEP, hinge_angle=host.angle, hinge_rate=host.rate,
                           fin_command=radians(10.0) * (k > 20))
            before, power = power, out["motor_torque"] * out["motor_speed"]
            work += 1e-5 * (before + power)
            positive_work += 1e-5 * max(before + power, 0.0)
        host.step(k * STEP, out["actuator_torque"], STEP)
    assert degrees(host.angle) == pytest.approx(10.0, abs=0.05)
    assert positive_work > 5.0  # J
    assert work == pytest.approx(0.5 * spring * host.angle**2, abs=1e-3 * positive_work)


def test_host_and_fmu_have_no_algebraic_loop() -> None:
    """No output depends on the fin's motion at the same instant."""
    direct = codegen.direct_inputs(with_extension(NONLINEAR, TORQUE))
    assert {"actuator_torque", "armature", "fin_angle"}.isdisjoint(direct)
    assert {"hinge_angle", "hinge_rate"}.isdisjoint(name for names in direct.values() for name in names)


def test_an_impossible_model_and_gravity_are_refused() -> None:
    for model in set(NAMES) - {*RIGID}:
        with pytest.raises(EmcasError, match="torque needs a rigid drive line") as caught:
            get(with_extension(model, TORQUE))
        assert "\n" not in str(caught.value)
    with pytest.raises(EmcasError, match=r"leave \+faults out"):
        get(with_extension(f"{NONLINEAR}+faults", TORQUE))
    with pytest.raises(ParameterError, match="weight is the host's"):
        load_parameters(model=with_extension(NONLINEAR, TORQUE)).with_values({"loads.gravity": True})

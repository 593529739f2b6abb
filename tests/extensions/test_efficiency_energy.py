"""Energy balances of the screw, which never supplies energy."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.steppers.elastic import Pair, advance
from tests.marks import slow
from tests.runs import input_levels, run_within_stops
from tests.simulation import acting, nested

from .screw_values import ELASTIC, MODEL, NO_DRY, coulomb, efficiencies, ratio, values_of


@pytest.mark.parametrize("torque", [100.0, -100.0])
def test_energy_of_a_stroke(torque: float) -> None:
    """The work of load and bus is the losses of screw, friction and copper and the energy stored at the end."""
    v = values_of({"solver.max_tick": 1e-5})
    step = 2e-6
    run = simulate(v, 0.2, step, model=MODEL, fin_command=0.25, aero_torque=torque)
    speed, current = run["motor_speed"], run["motor_current"]
    way = [np.where(speed > 0.0, a, b) for a, b in (
        (coulomb(v, "positive", run["fin_angle"]), coulomb(v, "negative", run["fin_angle"])),
        (v["friction.viscous.positive"], v["friction.viscous.negative"]))]
    powers = {"load": run["hinge_torque"] * run["fin_rate"], "bus": run["supply_power"], "screw": run["screw_loss"],
              "friction": way[0] * np.abs(speed) + way[1] * speed**2,
              "copper": v["motor.resistance"] * current**2}
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}
    rotor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * v["screw.lead"]**2
    fin = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    stored = 0.5 * (rotor * speed[-1]**2 + fin * run["fin_rate"][-1]**2 + v["motor.inductance"] * current[-1]**2)
    # The voltage jumps with each sample's reference, where a trapezoid is off by up to half of the jump: the difference
    # is of first order in the step, 0.022 J at 1e-5 s and 0.004 J at 2e-6 s, of 45 J.
    assert work["load"] + work["bus"] == pytest.approx(
        work["screw"] + work["friction"] + work["copper"] + stored, abs=0.01)
    assert work["screw"] > 1.0
    returned = -np.trapezoid(np.minimum(run["supply_power"], 0.0), dx=step)
    assert (returned > 10.0) == (torque > 0.0)


# A load of one sign, a nut of 200 kg, whose inertia is half the rotor's, and damping with a measurable loss.
_LOADED = {**efficiencies(0.7, 0.4), "encoder.enabled": False, "friction.fin_coulomb": 5.0, "friction.fin_viscous": 1.0,
           "mass.nut": 200.0, "loads.gravity": False, "solver.max_tick": 1e-5}
_LINE = {"drive_line.backlash": 0.0, "drive_line.torsional_compliance": 0.0, "drive_line.axial_damping": 2e6}
_STRIBECK = {"stribeck.static_ratio": 2.0, "stribeck.speed": 30.0}


@pytest.mark.parametrize(("model", "overrides"), [
    (ELASTIC, _LINE), (ELASTIC, {**_LINE, "encoder.on_fin": True}),
    ("ristanovic+efficiency", {}), *slow(("elastic+stribeck+efficiency", {**_LINE, **_STRIBECK}),
                                         ("nonlinear+stribeck+efficiency", _STRIBECK))])
def test_energy_of_a_sine_in_every_model(model: str, overrides: Mapping[str, float]) -> None:
    """The work of motor, nut's inertial force and load is the losses of screw, friction, hinge and line and the energy
    stored."""
    v, step = values_of(_LOADED, overrides, model=model), 1e-5
    # The vehicle's acceleration acts on the nut, and reverses the load on the screw.
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.05 * sin(40.0 * t), "aero_torque": 60.0,
                              "acceleration.x": 10.0}
    run = simulate(v, 0.15, step, model=model, **inputs)
    speed, rate, fin = run["motor_speed"], run["fin_rate"], run["fin_angle"]
    reduction = v["kinematics.moment_arm"] / v["screw.lead"] if "ristanovic" in model else ratio(v, fin)
    excess = 1.0 + (v.get("stribeck.static_ratio", 1.0) - 1.0) * np.exp(-(speed / v.get("stribeck.speed", 1.0))**2)
    dry = np.where(speed > 0.0, coulomb(v, "positive", fin), coulomb(v, "negative", fin)) * excess
    viscous = np.where(speed > 0.0, v["friction.viscous.positive"], v["friction.viscous.negative"])
    driving = run["motor_torque"] - v["screw.lead"] * v["mass.nut"] * 10.0
    powers = {"work": driving * speed + run["hinge_torque"] * rate, "screw": run["screw_loss"],
              "friction": dry * np.abs(speed) + viscous * speed**2, "hinge": 5.0 * np.abs(rate) + rate**2}
    rotor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * v["screw.lead"]**2
    stored = 0.5 * (rotor * speed**2 + (v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]) * rate**2)
    if "elastic" in model:
        start = v["kinematics.initial_angle"]
        nut = v["kinematics.moment_arm"] * (np.tan(fin + start) - np.tan(start))
        stretch = v["screw.lead"] * run["motor_angle"] - nut
        stored = stored + 0.5 * stretch**2 / v["drive_line.axial_compliance"]
        powers["line"] = v["drive_line.axial_damping"] * v["screw.lead"]**2 * (speed - reduction * rate)**2
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}
    # Slopes of the torque and signs of speeds jump within a step: 8e-5 J at most, of 9 J.
    assert work.pop("work") == pytest.approx(sum(work.values()) + stored[-1] - stored[0], abs=2e-4)
    assert work["screw"] > 1.0


_OFF = acting(enabled=False)


@settings(derandomize=True, max_examples=15)
@given(forward=st.floats(0.05, 1.0), backward=st.floats(0.0, 1.0), gap=st.sampled_from([0.0, 1e-4, 1e-3]),
       speeds=st.tuples(st.floats(-300, 300), st.floats(-300, 300)), h=st.sampled_from([5e-6, 5e-5, 3e-4]))
def test_an_elastic_screw_creates_no_energy(forward: float, backward: float, gap: float, speeds: tuple[float, float],
                                            h: float) -> None:
    v = values_of(NO_DRY, efficiencies(forward, backward), {
        "drive_line.backlash": gap, "mass.nut": 0.0, "friction.viscous.positive": 0.0,
        "friction.viscous.negative": 0.0, "drive_line.axial_damping": 0.0, "drive_line.torsional_damping": 0.0,
        "drive_line.contact_damping": 0.0, "fin.stop_angle": radians(70.0)}, model=ELASTIC)
    p = nested(v, ELASTIC, constant_ratio=True)
    c = drive_line.line(FLOATS, p, 0.0)
    fin = drive_line.fin_side(FLOATS, p, 0.0).inertia

    def energy(s: Pair) -> float:
        deflection = s.motor_angle - s.fin_side_angle
        pressed, flank = drive_line.pressed(FLOATS, c, deflection, s.motor_speed - s.fin_side_speed)
        kinetic = mechanics.screw_inertia(p) * s.motor_speed**2 + fin * s.fin_side_speed**2
        return float(0.5 * (kinetic + (c.stiffness * (deflection - flank)**2 if pressed else 0.0)))

    s = Pair(0.0, speeds[0], 0.0, 0.0, 0.0, speeds[1])
    before = start = energy(s)
    for _ in range(200):
        s, _ = advance(FLOATS, p, s, _OFF, h)
        # The contact of a flank is found within 1e-6 of a tick, which changes the energy by far less than 1e-6.
        after = energy(s)
        assert after <= before + 1e-6 * start + 1e-15
        before = after


@pytest.mark.kernel(MODEL)
@settings(derandomize=True, max_examples=60)
@given(levels=input_levels(8), forward=st.floats(0.01, 1.0), backward=st.floats(-5.0, 1.0),
       dry=st.sampled_from([0.0, 5.0]), on_fin=st.booleans(),
       model=st.sampled_from([MODEL, ELASTIC, "ristanovic+efficiency"]))
def test_any_inputs_give_finite_outputs_and_a_loss(levels: list[Any], forward: float, backward: float, dry: float,
                                                   on_fin: bool, model: str) -> None:
    """The fin stays within its stops and does not jump; the screw's loss is never negative."""
    backward = max(backward, 0.0) if model == ELASTIC else backward
    v = values_of({**efficiencies(forward, backward), "friction.fin_coulomb": dry, "encoder.on_fin": on_fin},
                  model=model)
    run = run_within_stops(v, model, levels)
    assert run["screw_loss"].min() >= 0.0
    # 300 N.m and the motor's 6.6 N.m times 63 over 50 deg are 620 J, 32 rad/s of 1.2 kg.m2; a step is 1 ms.
    assert np.abs(np.diff(run["fin_angle"])).max() < 0.04



"""The screw's balance of energy, and that it never gives any."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators.two_inertias import Pair, advance
from emcas_fmu.integrate import Boundary
from emcas_fmu.kernels import compiled
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.tree import changed, tree

from .screw_values import DRY, ELASTIC, MODEL, coulomb, efficiencies, values


@pytest.mark.parametrize("torque", [100.0, -100.0])
def test_energy_of_a_stroke(torque: float) -> None:
    """Work of the load and of the bus = losses of screw, friction and copper + what is stored at the end."""
    v = values({"solver.max_tick": 1e-5})
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
    # The voltage jumps with each sample's reference, and the sum over a jump is off by up to half a step of it: the
    # difference is of first order in the step, 0.022 J at 1e-5 s and 0.004 J at 2e-6 s, of 45 J.
    assert work["load"] + work["bus"] == pytest.approx(
        work["screw"] + work["friction"] + work["copper"] + stored, abs=0.01)
    assert work["screw"] > 1.0
    returned = -np.trapezoid(np.minimum(run["supply_power"], 0.0), dx=step)
    assert (returned > 10.0) == (torque > 0.0)


_OFF = Boundary(0.0, 0.0, 0.0, 0.0, 39.0, False)


@settings(deadline=None, derandomize=True, max_examples=30)
@given(forward=st.floats(0.05, 1.0), backward=st.floats(0.0, 1.0), gap=st.sampled_from([0.0, 1e-4, 1e-3]),
       speeds=st.tuples(st.floats(-300, 300), st.floats(-300, 300)), h=st.sampled_from([5e-6, 5e-5, 3e-4]))
def test_elastic_screw_creates_no_energy(forward: float, backward: float, gap: float, speeds: tuple[float, float],
                                         h: float) -> None:
    v = values({**DRY, **efficiencies(forward, backward), "drive_line.backlash": gap, "mass.nut": 0.0,
                "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0,
                "drive_line.axial_damping": 0.0, "drive_line.torsional_damping": 0.0,
                "drive_line.contact_damping": 0.0, "fin.stop_angle": radians(70.0)}, ELASTIC)
    p = changed(tree(v), {"kinematics.constant_ratio": True})
    c = drive_line.line(FLOATS, p)
    fin = drive_line.fin_side(FLOATS, p, 0.0, 0.0, 0.0, 0.0).inertia

    def energy(s: Pair) -> float:
        deflection = s.angle - s.fin_angle
        pressed, flank = drive_line.pressed(FLOATS, c, deflection, s.speed - s.fin_speed)
        kinetic = mechanics.screw_inertia(p) * s.speed**2 + fin * s.fin_speed**2
        return float(0.5 * (kinetic + (c.stiffness * (deflection - flank)**2 if pressed else 0.0)))

    s = Pair(0.0, speeds[0], 0.0, 0.0, 0.0, speeds[1])
    before = start = energy(s)
    for _ in range(200):
        s, _ = advance(FLOATS, p, s, _OFF, h)
        # A flank is met within a share of 1e-6 of a tick: far below 1e-6 of the energy.
        now = energy(s)
        assert now <= before + 1e-6 * start + 1e-15
        before = now


_levels = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()), min_size=2, max_size=8)


@pytest.mark.skipif(not compiled.available(MODEL), reason="no C compiler")
@settings(deadline=None, derandomize=True, max_examples=120)
@given(levels=_levels, forward=st.floats(0.01, 1.0), backward=st.floats(-5.0, 1.0), dry=st.sampled_from([0.0, 5.0]),
       on_fin=st.booleans(), model=st.sampled_from([MODEL, ELASTIC, "ristanovic+efficiency"]))
def test_anything_goes(levels: list[Any], forward: float, backward: float, dry: float, on_fin: bool,
                       model: str) -> None:
    """Finite, within the stops and without jumps; the screw never gives power."""
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    backward = max(backward, 0.0) if model == ELASTIC else backward
    v = values({**efficiencies(forward, backward), "friction.fin_coulomb": dry, "encoder.on_fin": on_fin}, model)
    run = simulate(v, (len(commands) - 1) * 1e-3, model=model, fin_command=commands, aero_torque=torques,
                   enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert run["screw_loss"].min() >= 0.0
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)
    # 300 N.m and the motor's 6.6 N.m times 63 over 50 deg are 620 J, 32 rad/s of 1.2 kg.m2; a step is 1 ms.
    assert np.abs(np.diff(run["fin_angle"])).max() < 0.04



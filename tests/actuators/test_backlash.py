"""Contact of nut and fork: bounce, energy, free play, limit cycles, direct and indirect fin angle."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, exp, pi, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.namespace import with_values
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.steppers.elastic import Pair, advance
from tests.default_actuator import THESIS_LOOPS
from tests.marks import others_slow
from tests.simulation import acting, nested

from .line import MODEL, RIGID, SMOOTH, at_motor, run_of, through_motor, values_of


def _bare(overrides: Mapping[str, Any]) -> Any:
    """Parameters of two inertias with nothing but the line between them."""
    return nested(values_of({**SMOOTH, **overrides}), MODEL, constant_ratio=True)


_OFF = acting(enabled=False)


def _energy(p: Any, s: Pair) -> float:
    c = drive_line.line(FLOATS, p, s.fin_side_angle)
    deflection = s.motor_angle - s.fin_side_angle
    pressed, flank = drive_line.pressed(FLOATS, c, deflection, s.motor_speed - s.fin_side_speed)
    fin = drive_line.fin_side(FLOATS, p, s.fin_side_angle).inertia
    kinetic = mechanics.screw_inertia(p) * s.motor_speed**2 + fin * s.fin_side_speed**2
    return float(0.5 * (kinetic + (c.stiffness * (deflection - flank)**2 if pressed else 0.0)))


@pytest.mark.parametrize("ratio", others_slow([0.0, 0.05, 0.3, 0.8], lambda ratio: ratio == 0.3))
def test_bounce_is_its_closed_form(ratio: float) -> None:
    """A damped spring that never pulls returns exp(-zeta phi/q) of the speed.

    Its force ends at the phase tan(phi) = 2 zeta q/(2 zeta^2 - 1) of the motion, q^2 = 1 - zeta^2.
    """
    p = _bare({**RIGID, "drive_line.backlash": 1e-4})
    fin = drive_line.fin_side(FLOATS, p, 0.0).inertia
    mass = 1.0 / (1.0 / mechanics.screw_inertia(p) + 1.0 / fin) / p.screw.lead**2  # along the screw
    damping = 2.0 * ratio * sqrt(p.drive_line.contact_stiffness * mass)
    p = with_values(p, {"drive_line.contact_damping": damping})
    q = sqrt(1.0 - ratio**2)
    expected = exp(-ratio / q * atan2(2.0 * ratio * q, 2.0 * ratio**2 - 1.0)) if ratio else 1.0
    s, h = Pair(0.0, 20.0, 0.0, 0.0, 0.0, -5.0), 1e-6
    momentum = mechanics.screw_inertia(p) * s.motor_speed + fin * s.fin_side_speed
    while s.motor_speed - s.fin_side_speed > 0.0 or s.motor_angle - s.fin_side_angle > 0.0:
        s, _ = advance(FLOATS, p, s, _OFF, h)
    # Second order in the angle of a tick, w h = 4e-3; its end is placed better.
    assert (s.fin_side_speed - s.motor_speed) / 25.0 == pytest.approx(expected, rel=1e-4)
    assert mechanics.screw_inertia(p) * s.motor_speed + fin * s.fin_side_speed == pytest.approx(momentum, rel=1e-9)


_any_compliance = st.sampled_from([0.0, 1e-9, 1e-8, 1e-6])


@settings(derandomize=True, max_examples=12)
@given(axial=_any_compliance, torsional=st.sampled_from([0.0, 1e-3, 0.1]), gap=st.sampled_from([1e-5, 1e-4, 1e-3]),
       damping=st.sampled_from([0.0, 1e3, 1e5]), speeds=st.tuples(st.floats(-300, 300), st.floats(-300, 300)),
       offset=st.floats(-0.9, 0.9), h=st.sampled_from([5e-6, 5e-5, 3e-4]))
def test_contact_creates_no_energy(axial: float, torsional: float, gap: float, damping: float,
                                   speeds: tuple[float, float], offset: float, h: float) -> None:
    p = _bare({"drive_line.axial_compliance": axial, "drive_line.torsional_compliance": torsional,
               "drive_line.backlash": gap, "drive_line.contact_damping": damping, "drive_line.axial_damping": 0.0,
               "drive_line.torsional_damping": 0.0, "fin.stop_angle": radians(70.0)})
    half = 0.5 * gap / p.screw.lead
    s = Pair(offset * half, speeds[0], 0.0, 0.0, 0.0, speeds[1])
    most = start = _energy(p, s)
    for _ in range(300):
        s, _ = advance(FLOATS, p, s, _OFF, h)
        most = max(most, _energy(p, s))
    # A flank is met within a share of 1e-6 of a tick, and at least MET = 1e-9 rad, where a line of 1e3 N.m/rad
    # has 5e-16 J: far below 1e-6 of the energy.
    assert most <= start * (1.0 + 1e-6) + 1e-15


@pytest.mark.parametrize(("command", "overrides"), [
    (-0.2, {"friction.fin_viscous": 5.0}), (-0.3, {"friction.fin_viscous": 5.0}),
    (0.1, {"friction.fin_viscous": 20.0, "drive_line.backlash": 2e-5}), (0.05, {"drive_line.backlash": 1e-9}),
])
def test_a_flank_is_left_however_slowly(command: float, overrides: Mapping[str, Any]) -> None:
    """Held for 20 s, the limit cycle leaves its flanks at speeds that move less than the rounding of an angle."""
    run = run_of({"encoder.enabled": False, **overrides}, 20.0, fin_command=lambda t: command if t > 0.05 else 0.0)
    assert abs(run["tracking_error"][-1]) < radians(0.2)


def test_nut_is_before_the_gap() -> None:
    """Under a load the nut is behind the rotor by the deflection of shaft and screw, and before the flank's."""
    torque = -60.0
    run = run_of({"friction.fin_viscous": 20.0, "friction.fin_coulomb": 0.0}, 2.0, aero_torque=torque)
    p = nested(values_of(), MODEL)
    tangent = tan(run["fin_angle"][-1] + p.kinematics.initial_angle)
    at_screw = -torque / (p.kinematics.moment_arm / p.screw.lead * (1.0 + tangent * tangent))
    twist = at_screw * (p.drive_line.torsional_compliance + p.drive_line.axial_compliance / p.screw.lead**2)
    behind = run["motor_angle"][-1] - run["nut_position"][-1] / p.screw.lead
    assert twist > 1e-4
    assert behind == pytest.approx(twist, rel=1e-2)  # it still creeps, and friction of the rotor does not matter here


def test_free_play_by_a_small_torque_is_the_gap() -> None:
    """A torque that the motor's friction holds takes the fin from flank to flank; the rest is the line's give."""
    for gap in (2e-5, 5e-5, 2e-4):
        run = run_of({"drive_line.backlash": gap, "friction.fin_viscous": 5.0, "friction.fin_coulomb": 0.0}, 1.0,
                     enable=False, aero_torque=lambda t: 2.0 if t < 0.5 else -2.0)
        values = values_of({"drive_line.backlash": gap})
        p = nested(values, MODEL)
        play = np.ptp((run["motor_angle"] - at_motor(values, run["fin_angle"]))[[499, 999]])
        ratio = p.kinematics.moment_arm / p.screw.lead / cos(p.kinematics.initial_angle)**2
        give = 4.0 / ratio / drive_line.line(FLOATS, p, 0.0).stiffness
        # The ratio is not constant over the gap: a part in 300 of the give, itself 1 % to 10 % of the gap.
        assert play * p.screw.lead == pytest.approx(gap + give * p.screw.lead, rel=1e-3)
        assert run["motor_angle"][999] - run["motor_angle"][499] < 0.01 * play  # friction held it but for the impact


def test_limit_cycle_with_gap_and_gain_only() -> None:
    """With the loop closed over the gap, by the fin's encoder; amplitude follows the gap, as a describing function's.

    Without dry friction about the hinge an integral finds no rest in a gap, whatever the gain; a proportional loop does
    at a small one. With the default friction the integral does too.
    """
    gain = THESIS_LOOPS["controller.position.kp"]

    def width(gap: float, share: float, on_fin: bool = True, ki: float | None = None, dry: float = 0.0) -> float:
        run = run_of({**THESIS_LOOPS, "drive_line.backlash": gap, "controller.position.kp": share * gain,
                      "encoder.on_fin": on_fin,
                      "encoder.enabled": False, "friction.fin_viscous": 5.0, "friction.fin_coulomb": dry,
                      "controller.position.ki": THESIS_LOOPS["controller.position.ki"] if ki is None else ki}, 20.0,
                     fin_command=lambda t: 0.02 if t > 0.05 else 0.0)
        return float(np.degrees(np.ptp(run["fin_angle"][17000:])))

    assert width(0.0, 2.0) < 1e-3
    assert width(1e-4, 2.0, on_fin=False) < 1e-3
    assert width(1e-4, 1.0, ki=0.0) < 1e-3
    assert width(1e-4, 1.0, dry=values_of()["friction.fin_coulomb"]) < 1e-3
    assert width(1e-4, 1.0) > 2e-2
    small, large = width(1e-4, 2.0), width(2e-4, 2.0)
    assert small > np.degrees(1e-4 / 0.05)  # wider than the gap
    assert large == pytest.approx(2.0 * small, rel=0.25)  # friction does not grow with the gap


def test_encoder_on_the_fin_sees_the_fin() -> None:
    direct, indirect = (run_of({"encoder.on_fin": on, "drive_line.backlash": 2e-4}, 0.5, fin_command=0.05,
                             aero_torque=-40.0) for on in (True, False))
    count = 2.0 * pi / 8192
    for run, seen, through in ((direct, direct["fin_angle"], False), (indirect, indirect["motor_angle"], True)):
        # Results of a sample belong to the step that begins there.
        counted = np.floor(seen[:-1] / count) * count
        shown = through_motor(counted) if through else counted
        at_edge = np.abs(seen[:-1] / count - np.round(seen[:-1] / count)) < 1e-6
        assert run["measured_fin_angle"][1:][~at_edge] == pytest.approx(shown[~at_edge], abs=1e-12)
    lost = through_motor(indirect["motor_angle"][-1]) - indirect["fin_angle"][-1]
    assert lost > 1e-4 / 0.05 * 0.98  # half the gap, at an angle of the lever of 8 deg

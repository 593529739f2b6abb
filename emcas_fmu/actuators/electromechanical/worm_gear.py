"""The worm-gear actuator: motor and drive of the nonlinear actuator, with worm and wheel instead of screw and lever.

    J_r dw/dt = T_m - C_m sgn w - b_m w - e L           theta = N fin_angle
    L = (J_f/N^2) dw/dt + (C_f/N) sgn w + b_f w/N^2 - T_f/N        e = 1/eta_f where L w > 0, else eta_b

theta and w are angle and speed of motor and worm, J_r is their inertia, T_m the motor's torque, L the load torque at
the worm; C is dry and b viscous friction, at the motor (m) and about the hinge (f), T_f the external moment there, J_f
the inertia, N the gear ratio, eta_f and eta_b the efficiencies of the worm, forward and backward.
The wheel is on the fin shaft: the ratio is constant, and the losses of the loaded worm follow from its geometry and
friction (:mod:`emcas_fmu.physics.worm`, :mod:`emcas_fmu.physics.screw`). With eta_b <= 0 the worm is self-locking: no
load moves the fin or drives the motor. The worm turns with the motor and lies along body x.
"""

from __future__ import annotations

import sys
from math import radians
from typing import Any

from ...namespace import with_values
from ...ops.base import Ops, Value
from ...physics import drive, screw, screw_loss, worm
from ...physics.structure import Structure
from ...rules import rule, when
from ...variables import in_group, integer_parameter, parameter, real_output, tunable
from ..as_built import Deviation
from ..composition import Group, Output
from ..declaration import PlantFault, Values
from . import groups, interface, nonlinear, plausibility, rules
from .rules import MOST_JAMMING

WORM = Group((*in_group(
    "worm",
    integer_parameter("starts", 1, 12, "starts of the worm, z_1", sheet="gear: starts of the worm"),
    integer_parameter("teeth", 10, 1000, "teeth of the full wheel, z_2; the gear ratio is teeth/starts",
                      sheet="gear: teeth of the wheel, as if whole"),
    parameter("diameter_quotient", "1", 4.0, 40.0, "ratio of the worm's pitch diameter to its module, q",
              sheet="gear: diameter quotient q, ratio of the worm's pitch diameter to its module"),
    parameter("module", "m", 1e-4, 0.1, "module in the worm's axial section, m", sheet="gear: axial module"),
    parameter("pressure_angle", "rad", radians(5.0), radians(45.0), "pressure angle in the normal section",
              sheet="gear: pressure angle"),
    parameter("friction", "1", 0.0, 1.0, "friction coefficient of the flanks in motion, mu",
              sheet="gear: friction coefficient, or from the efficiency"),
    parameter("static_ratio", "1", 1.0, 10.0, "ratio of the friction coefficient at rest to that in motion, s (1: "
              "independent of the speed)"),
    parameter("stribeck_speed", "m/s", 1e-3, 100.0, "sliding speed of the flanks at which the excess of friction at "
              "rest has fallen to 37 %, v_s")),
    parameter("inertia.worm", "kg.m2", 0.0, 10.0, "inertia of worm and coupling about the motor's axis",
              sheet="gear: inertia of worm and coupling")),
    (Output(real_output("worm_loss", "W", "power that the loaded worm turns into heat", 100.0, minimum=0.0),
            lambda ops, p, m: screw_loss.loss(ops, p, m.x, m.u, {
                "motor_speed": m.x.motor_speed, "fin_angle": m.fin, "motor_torque": drive.torque(p, m.motor_current),
                "hinge_torque": m.hinge_torque})),),
    deviations=(Deviation(parameter("deviation.worm.friction", "1", -0.9, 10.0, "relative deviation as built of the "
                                    "flanks' friction coefficient")),))

COMPOSITION = interface.composed(nonlinear.moment, *groups.with_gear(WORM, "worm wheel"))
# Longest tick [s] with friction that falls with the speed. If its coefficient falls from 0.15 to 0.04, slews of 40 deg
# against and with 100 N.m are within 0.0001 deg of the independent integration.
_FALLING = 2.5e-4


def geared(_: Ops, p: Any) -> Any:
    """Return the parameters of an equivalent screw of ratio N without lever, with the flanks' friction as built.

    Applying it to its own result changes nothing.
    """
    return with_values(COMPOSITION.completed(p, (groups.LEVER, groups.SCREW)), {
        "kinematics.moment_arm": worm.ratio(p), "screw.lead": 1.0, "inertia.screw": p.inertia.worm,
        "worm.friction": p.worm.friction * (1.0 + p.deviation.worm.friction), "deviation.worm.friction": 0.0})


def _dry(ops: Ops, p: Any, amounts: Any) -> Values:
    """Return a higher friction coefficient, up to the largest with which a motor turns the loaded worm."""
    return {"worm.friction": ops.minimum(amounts.factor * p.worm.friction, _most(ops, p) / p.worm.static_ratio)}


FAULTS = (
    PlantFault.scaling("lost_lock", "vibration reduces the flanks' friction: a load may drive the worm",
                       tunable("share", "1", 0.01, 1.0, "share of the friction coefficient that is left"),
                       "worm.friction"),
    PlantFault("dry_flanks", "the flanks have permanently lost their oil: friction rises", _dry, (
        tunable("factor", "1", 1.0, 3.0, "factor by which friction rises"),), lasting=True),
)


def longest_tick(ops: Ops, p: Any) -> Value:
    """Return the largest tick [s] that resolves the current loop and friction that falls with the speed."""
    longest = nonlinear.longest_tick(ops, p)
    return ops.where(ops.equal(p.worm.static_ratio, 1.0), longest, ops.minimum(longest, _FALLING))


def _most(ops: Ops, p: Any) -> Value:
    """Return the largest friction coefficient [-] with which a motor still turns the loaded worm."""
    return 0.99 * ops.cos(p.worm.pressure_angle) / worm.lead_tangent(p)


@rule("the flanks' friction coefficient at rest, worm.friction times worm.static_ratio as built, is %.6g; above %.6g = "
      "0.99 cos(worm.pressure_angle) worm.diameter_quotient/worm.starts no motor turns the worm under load")
def _drives(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    p = geared(ops, p)
    mu, most = worm.coefficient(ops, p, 0.0), _most(ops, p)
    return when(ops, mu > most), mu, most


@rule("with the flanks' friction coefficient at rest of %.6g the backward efficiency is %.6g; it must not be below "
      f"minus {MOST_JAMMING:g} times the inertia of motor and worm over that of the load at the motor, %.6g over %.6g "
      "kg.m2; lower worm.friction or worm.static_ratio, or raise worm.starts")
def _jams(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    p = geared(ops, p)
    broken, backward, *rest = rules.jams(ops, p, screw.backward(ops, p), longest_tick(ops, p))
    return broken, worm.coefficient(ops, p, 0.0), backward, *rest


RULES = (*plausibility.of_screw(geared), _drives, _jams)
ACTUATOR = COMPOSITION.over(
    nonlinear.ACTUATOR, geared, RULES,
    name="worm-gear",
    title="electromechanical actuator with a worm gear: constant ratio, losses of the loaded worm",
    origin="Section 1.1.1.3 of Ü. Yerlikaya, Dynamic modeling and control of an electromechanical control actuation "
           "system, M.S. thesis, METU, 2016, describes the structure of this actuator, without numbers; motor, "
           "drive and loops are those of the thesis's actuator. Numbers are engineering estimates, marked as such.",
    descriptions={name: text.replace("screw", "worm") for name, text in interface.INPUT_DESCRIPTIONS.items()},
    structure=Structure(constant_ratio=True, screw_losses=True, worm=True),
    faults=FAULTS,
    equation_parameters=geared,
    longest_tick=longest_tick,
    reference="emcas_fmu.reference.worm_gear",
    modules=(sys.modules[__name__], worm, screw, screw_loss, *nonlinear.MODULES[1:]),
)

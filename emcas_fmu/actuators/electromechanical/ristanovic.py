"""The actuator after Ristanovic, Cojbasic and Lazic (2012): a brush DC motor under PWM, without a current loop.

"Intelligent control of DC motor driven electromechanical fin actuator", Control Engineering Practice 20 (6),
610-617. The amplifier puts a voltage on the winding in proportion to the controllers' reference, the speed reference
saturates, a torsion bar is the load (here in addition to the hinge moment), and the ratio is constant:

    L di/dt = clip(K_pwm u, +-V) - R i - K_e w        T = T_aero - k_bar fin_angle

u is the controllers' reference, V the supply, w the motor's speed. The published model has no back-EMF (thesis, section
1.1.1.1): the default of K_e is 0. The supply then delivers only the heat and the magnetic energy of the winding, not
the work on the shaft, and it does not limit the speed. With K_e = K_t the equations are those of a motor. Friction,
sampling, encoder and stops are the nonlinear actuator's. No friction is fed forward.
"""

from __future__ import annotations

import sys
from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import kinematics
from ...physics.structure import Structure
from ...variables import parameter
from .. import fin_port
from ..composition import Group
from ..declaration import PlantInputs, Values
from . import groups, interface, nonlinear, plausibility
from .nonlinear import as_built

PWM = Group((
    parameter("pwm.gain", "1", 1e-6, 1e4, "motor voltage per volt of reference, K_pwm",
              sheet="drive: motor voltage per volt of command"),))
BAR = Group((parameter("load.torsion_bar", "N.m/rad", 0.0, 1e6, "stiffness of the torsion bar, k_bar"),))


def _loaded(ops: Ops, p: Any, angle: Value, u: PlantInputs) -> PlantInputs:
    """Return the plant inputs with the torque of the bar at a motor angle [rad]."""
    fin = kinematics.fin_at(ops, as_built(ops, p), angle)
    return u.replace(aero_torque=u.aero_torque - p.load.torsion_bar * fin)


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states under the loads and the torsion bar's torque."""
    return nonlinear.derivatives(ops, p, x, _loaded(ops, p, x.motor_angle, u))


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the states after `h` [s] or at the first event, and the time [s] until then.

    The bar's torque is that of mid-step.
    """
    return nonlinear.step(ops, p, x, _loaded(ops, p, x.motor_angle + 0.5 * h * x.motor_speed, u), h)


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow, with the bar in hinge_torque."""
    return nonlinear.moment(ops, p, x, _loaded(ops, p, x.motor_angle, u))


COMPOSITION = interface.composed(
    moment, groups.LEVER, groups.COULOMB, groups.ENCODER, groups.SCREW, groups.LOSSLESS, *groups.LOOPS,
    groups.VISCOUS, groups.HINGE.reworded({"aerodynamic": "aerodynamic + torsion bar", "DAC, current or": "DAC or"}),
    groups.HINGE_FRICTION, groups.SHAFT, groups.MOTOR,
    groups.CURRENT.reworded({"motor current": "motor current (without a current loop)"}), groups.POWER,
    groups.VOLTAGE_LIMIT, groups.INDUCTANCE,
    groups.DELAY.reworded({"controller's DAC": "controller's DAC, which sets the PWM",
                           "DAC to current reference": "DAC to PWM"}), PWM, BAR)
ACTUATOR = COMPOSITION.over(
    nonlinear.ACTUATOR, lambda ops, p: COMPOSITION.completed(p, (groups.COMPENSATION,)),
    (plausibility.matched_inertia, plausibility.fine_counts, plausibility.WINDING_RULE),
    name="ristanovic",
    title="DC motor under PWM without current loop, torsion-bar load, constant ratio (after Ristanovic et al. 2012)",
    origin="The structure is that of Ristanovic, Cojbasic and Lazic, Intelligent control of DC motor driven "
           "electromechanical fin actuator, Control Engineering Practice 20 (6), 610-617, 2012; that it has no "
           "back-EMF is from section 1.1.1.1 of the thesis of Yerlikaya (2016). The paper's numbers are not used: "
           "motor, screw, fin, friction and encoder are those of the default actuator, the gains are set by trial. "
           "Entries are engineering estimates where their source says so.",
    supply_rules=plausibility.SUPPLY_RULES[:1],
    equal_parameters=(),
    structure=Structure(constant_ratio=True, current="pwm", torsion_bar=True),
    derivatives=derivatives,
    step=step,
    longest_tick=fin_port.max_tick,
    tick_remedy="raise solver.max_tick",
    modules=(sys.modules[__name__], *nonlinear.MODULES),
)

"""After Ristanovic, Cojbasic and Lazic (2012): a brush DC motor under PWM, with no current loop.

"Intelligent control of DC motor driven electromechanical fin actuator", Control Engineering Practice 20 (6),
610-617. The amplifier puts a voltage on the winding in proportion to the controllers' reference, the speed demanded
saturates, a torsion bar stands for the hinge moment, and the ratio is constant:

    L di/dt = clip(K_pwm u, +-V) - R i - K_e w        T = T_aero - k_bar fin_angle

Friction, sampling, encoder and stops are the nonlinear model's. No friction is fed forward.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from ..physics import kinematics
from ..tree import changed
from ..variables import Variable
from . import nonlinear
from .rewired import rewired

TITLE = "DC motor under PWM without current loop, torsion-bar load, constant ratio (after Ristanovic et al. 2012)"
PLANT = nonlinear.PLANT
OWN = (
    Variable("pwm.gain", "Real", "parameter", "fixed", "1", "motor voltage per volt of reference, K_pwm", 1e-6, 1e4),
    Variable("load.torsion_bar", "Real", "parameter", "fixed", "N.m/rad", "stiffness of the torsion bar, k_bar",
             0.0, 1e6),
)
DESCRIPTIONS = {
    "drive_reference": "analogue reference held by the controller's DAC, which sets the PWM",
    "hinge_torque": "total external moment about the hinge (aerodynamic + torsion bar + gravity + inertial)",
    "motor_current": "motor current, which no loop controls",
}
# V/A. The amplifier is a current controller of so little gain that the current does not matter: at 100 A a ten-
# thousandth of a volt. So the equations, limits and events of the voltage are the ones there are.
_LEAST_GAIN = 1e-6
_UNLIMITED = 1e12


def _pwm(_: Ops, p: Any) -> Any:
    return changed(p, {
        "kinematics.constant_ratio": True, "compensation.gain": 0.0, "drive.kp": _LEAST_GAIN, "drive.ki": 0.0,
        "drive.current_gain": p.pwm.gain / _LEAST_GAIN, "drive.current_offset": 0.0, "drive.current_limit": _UNLIMITED})


def _loaded(ops: Ops, p: Any, angle: Value, aero_torque: Value) -> Value:
    fin = kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, angle))
    return aero_torque - p.load.torsion_bar * fin


initial = rewired(nonlinear.initial, _pwm)
sample = rewired(nonlinear.sample, _pwm)
forces = nonlinear.forces


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, reference: Value,
         aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value, h: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.nonlinear`; the bar is taken at mid-step, as the mechanics are."""
    q = _pwm(ops, p)
    torque = _loaded(ops, q, angle + 0.5 * h * speed, aero_torque)
    return nonlinear.step(ops, q, angle, speed, current, integral, reference, torque, f_x, f_z, supply, enable, h)


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, active: Value,
            reference: Value, measured: Value, limited: Value, command: Value, aero_torque: Value, f_x: Value,
            f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """See :mod:`emcas_fmu.actuators.nonlinear`; hinge_torque has the bar's."""
    q = _pwm(ops, p)
    torque = _loaded(ops, q, angle, aero_torque)
    return nonlinear.outputs(ops, q, angle, speed, current, integral, active, reference, measured, limited, command,
                             torque, f_x, f_z, supply, enable)

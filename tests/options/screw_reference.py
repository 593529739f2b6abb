"""An actuator with screw losses, independently written: forces along the screw, the fin's own angle, SciPy's Radau.

Dry friction, of the screw too, is softened: sgn w -> tanh(w/1e-3 rad/s).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, radians, tan, tanh
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp


def _felt(force: float, v: Mapping[str, Any], way: float) -> float:
    """Axial force times what of it the rotor feels, between the lines of either efficiency for |way| < 1."""
    pushing, pushed = 1.0 / v["efficiency.forward"], v["efficiency.backward"]
    return float(0.5 * (pushing + pushed) * force + 0.5 * (pushing - pushed) * abs(force) * way)


def _dry(v: Mapping[str, Any], fin: float, w: float) -> float:
    side = "positive" if w > 0.0 else "negative"
    return float(sum(v[f"friction.coulomb.{side}[{n}]"] * (fin / radians(20.0))**n for n in range(7)))


def _winding(v: Mapping[str, Any], w: float, i: float, xi: float, i_ref: float) -> list[float]:
    demand = v["drive.kp"] * (i_ref - i) + xi
    volts = max(-v["drive.supply_voltage"], min(v["drive.supply_voltage"], demand))
    return [(volts - v["motor.resistance"] * i - v["motor.back_emf_constant"] * w) / v["motor.inductance"],
            v["drive.ki"] * (i_ref - i) if abs(demand) < v["drive.supply_voltage"] else 0.0]


def _motor(v: Mapping[str, Any], fin: float, w: float, i: float, way: float) -> float:
    side = "positive" if w > 0.0 else "negative"
    return float(v["motor.torque_constant"] * i - v[f"friction.viscous.{side}"] * w - _dry(v, fin, w) * way)


def rigid(_: float, y: Any, v: Mapping[str, Any], i_ref: float, torque: float) -> list[float]:
    """Slopes of fin angle, fin rate, current, drive integral."""
    fin, rate, i, xi = y
    arm, lead, tangent = v["kinematics.moment_arm"], v["screw.lead"], tan(fin + v["kinematics.initial_angle"])
    lever = arm * (1.0 + tangent**2)  # of the fork: nut speed over fin rate
    w = lever * rate / lead
    way = tanh(w / 1e-3)
    rotor, inertia = v["inertia.motor"] + v["inertia.screw"], v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    swing = 2.0 * lever * tangent * rate**2  # nut acceleration at a constant fin rate
    resisting = v["friction.fin_viscous"] * rate + v["friction.fin_coulomb"] * way - torque
    drive = _motor(v, fin, w, i, way)

    def left(rate_of_rate: float) -> Any:
        nut = lever * rate_of_rate + swing
        force = (inertia * rate_of_rate + resisting) / lever + v["mass.nut"] * nut
        return drive - rotor * nut / lead - lead * _felt(force, v, way)

    # Linear on either side of the force's zero: where it is, and the slope on the side where the answer lies.
    kink = -(resisting / lever + v["mass.nut"] * swing) / (inertia / lever + v["mass.nut"] * lever)
    at_kink = left(kink)
    sign = 1.0 if at_kink > 0.0 else -1.0
    slope = (left(kink + sign) - at_kink) / sign
    return [rate, kink - at_kink / slope, *_winding(v, w, i, xi, i_ref)]


def elastic(_: float, y: Any, v: Mapping[str, Any], i_ref: float, torque: float) -> list[float]:
    """Slopes of fin angle, fin rate, current, integral, motor angle, motor speed; a screw that stretches, no gap.

    The nut's mass is on the load side, though it moves with the screw.
    """
    fin, rate, i, xi, theta, w = y
    arm, lead, start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
    lever = arm / cos(fin + start)**2
    way = tanh(w / 1e-3)
    stretch = lead * theta - arm * (tan(fin + start) - tan(start))
    compliance = v["drive_line.axial_compliance"]
    force = stretch / compliance + v["drive_line.axial_damping"] * (lead * w - lever * rate)
    rotor, nut = v["inertia.motor"] + v["inertia.screw"], v["mass.nut"] * lead
    drive = _motor(v, fin, w, i, way)
    kink = -force / nut
    at_kink = drive - rotor * kink
    sign = 1.0 if at_kink > 0.0 else -1.0
    slope = -rotor - sign * lead * _felt(sign * nut, v, way)
    inertia = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    return [rate, (lever * force + torque) / inertia, *_winding(v, w, i, xi, i_ref), w, kink - at_kink / slope]


def fin_angle(v: Mapping[str, Any], stop: float, command: float, torque: float, line: bool = False) -> Any:
    """Fin angle [rad] at the samples, encoder and compensation off, the delay whole samples."""
    arm, lead, start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
    y, integral, period, found = np.zeros(6 if line else 4), 0.0, v["controller.sample_time"], [0.0]
    delayed = [0.0] * round(v["drive.transport_delay"] / period)
    for _ in range(round(stop / period)):
        theta = y[4] if line else arm / lead * (tan(y[0] + start) - tan(start))
        w = y[5] if line else arm / lead / cos(y[0] + start)**2 * y[1]
        error = arm / lead * (tan(command + start) - tan(start)) - theta
        raw = v["controller.position.kp"] * error + integral
        speed = float(np.clip(raw, -v["controller.speed_limit"], v["controller.speed_limit"]))
        integral += period * (v["controller.position.ki"] * error + v["controller.antiwindup"] * (speed - raw))
        delayed.append(float(np.clip(v["controller.velocity.kp"] * (speed - w), -10.0, 10.0)))
        i_ref = float(np.clip(v["drive.current_gain"] * delayed.pop(0) + v["drive.current_offset"], -60.0, 60.0))
        y = solve_ivp(elastic if line else rigid, (0.0, period), y, "Radau", args=(v, i_ref, torque), rtol=1e-8,
                      atol=1e-9).y[:, -1]
        found.append(y[0])
    return np.array(found)

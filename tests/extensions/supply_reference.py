"""An independent integration of the nonlinear actuator behind a DC link, without controller, dry friction and stops.

The drive's current reference is drive.current_offset. DOP853 integrates the kinks of voltage limit, diode and chopper
in steps of 10 us at most.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, tan
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp


def angle_and_voltage(v: Mapping[str, Any], torques: list[float], interval: float) -> Any:
    """Return fin angle [rad] and link voltage [V] at the ends of intervals [s], each under a moment [N.m] on the fin.
    """
    arm, lead, start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
    rotor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * lead**2
    fin_inertia = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    source, reference = v["drive.supply_voltage"], v["drive.current_offset"]

    def slope(_: float, y: Any, torque: float) -> list[float]:
        fin, rate, i, link = y.tolist()  # floats take half the time of NumPy's numbers
        ratio = arm / lead / cos(fin + start)**2
        bend = 2.0 * ratio * tan(fin + start)
        w = ratio * rate
        viscous = v[f"friction.viscous.{'positive' if rate > 0.0 else 'negative'}"]
        volts = max(-link, min(link, v["drive.kp"] * (reference - i)))
        turning = ratio * (v["motor.torque_constant"] * i - viscous * w - rotor * bend * rate**2) + torque
        drive_current = (volts * i + v["supply.device_voltage"] * abs(i) + v["supply.device_resistance"] * i**2
                 + v["supply.quiescent_power"]) / link
        source_current = (source - link) / v["supply.source_resistance"]
        source_current = max(source_current, 0.0) if v["supply.one_way"] else source_current
        chopper_current = max(link - v["supply.chopper_voltage"], 0.0) / v["supply.chopper_resistance"]
        return [rate, turning / (fin_inertia + rotor * ratio**2),
                (volts - v["motor.resistance"] * i - v["motor.back_emf_constant"] * w) / v["motor.inductance"],
                (source_current - chopper_current - drive_current) / v["supply.capacitance"]]

    y = np.array([v["fin.start_angle"], 0.0, 0.0, source])
    rows = [(y[0], y[3])]
    for torque in torques:
        solution = solve_ivp(slope, (0.0, interval), y, "DOP853", args=(torque,), rtol=1e-10, atol=1e-10, max_step=1e-5)
        y = solution.y[:, -1]
        rows.append((y[0], y[3]))
    return np.array(rows)

"""Sampled controllers and the vehicle's motion of the electrohydrostatic reference, written again from its page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from .plant import clip
from .simulate import INPUTS, Array


class Loop:
    """PI on the piston that the fin's transducer stands for, P on the motor's speed."""

    def __init__(self, p: Mapping[str, float], angle: float):
        self.p = p
        self._reset(self._read(angle))

    @staticmethod
    def columns(p: Mapping[str, float], inputs: Mapping[str, Array]) -> dict[str, list[float]]:
        """Return every input at the rows. Raises ValueError for one there is not."""
        if unknown := sorted(set(inputs) - set(INPUTS) - {"time"}):
            raise ValueError(f"unknown inputs {unknown}")
        starts = {**INPUTS, "supply_voltage": p.get("drive.supply_voltage", INPUTS["supply_voltage"])}
        shape = np.shape(inputs["time"])
        return {name: np.broadcast_to(inputs.get(name, start), shape).tolist() for name, start in starts.items()}

    def _read(self, angle: float) -> float:
        """Return the piston [m] that the transducer reads at a fin angle [rad]."""
        step = self.p["transducer.resolution"]
        return self._piston(step * math.floor(angle / step + 0.5) if step else angle)

    def _piston(self, angle: float) -> float:
        arm, start = self.p["kinematics.moment_arm"], self.p["kinematics.initial_angle"]
        return arm * (math.tan(angle + start) - math.tan(start))

    def _reset(self, read: float) -> None:
        weight = self.p["controller.position.setpoint_weight"]
        self.integral = self.p["controller.position.kp"] * (1.0 - weight) * read  # m/s

    def sample(self, angle: float, speed: float, command: float, enable: bool) -> float:
        """Return the drive's reference [V] of one sample."""
        p, read = self.p, self._read(angle)
        if not enable:
            self._reset(read)
            return 0.0
        target = self._piston(clip(command, p["command.limit"]))
        turns = p["cylinder.area"] / p["pump.displacement"]  # of the motor, for the piston's travel
        fastest = p["controller.speed_limit"] / turns
        asked = (p["controller.position.kp"] * (p["controller.position.setpoint_weight"] * target - read)
                 + self.integral)
        raw = p["controller.velocity.kp"] * (turns * clip(asked, fastest) - speed)
        sent = clip(raw, p["drive.reference_limit"])
        gain, offset = p["drive.current_gain"], p["drive.current_offset"]
        possible = (clip(gain * sent + offset, p["drive.current_limit"]) - offset) / gain
        change = p["controller.sample_time"] * p["controller.position.ki"] * (target - read)
        beyond_speed = abs(asked) > fastest and asked * change > 0.0
        beyond_drive = abs(raw - possible) > 1e-9 and (raw - possible) * change > 0.0
        if not (beyond_speed or beyond_drive):
            self.integral += change
        return sent


def moment_of_vehicle(p: Mapping[str, float], row: Mapping[str, float]) -> tuple[Callable[[float], float], float]:
    """Return the moment [N.m] about the hinge of gravity and the vehicle's motion, as a function of the fin angle
    [rad], and the specific force [m/s2] along the piston.

    The fin with its shaft and fork: point masses for the force, a plate along its chord for the rotation.
    """
    given, rate, faster = (np.array([row[f"{kind}.{axis}"] for axis in "xyz"])
                           for kind in ("acceleration", "angular_rate", "angular_acceleration"))
    roll, pitch = row["attitude.roll"], row["attitude.pitch"]
    down = np.array([-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch)])
    place = np.array([p["mounting.station"], 0.0, 0.0])
    hinge = given + np.cross(faster, place) + np.cross(rate, np.cross(rate, place))
    c, s = math.cos(p["mounting.azimuth"]), math.sin(p["mounting.azimuth"])
    turned = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    force = turned @ ((9.80665 * down if p["loads.gravity"] else 0.0 * down) - hinge)
    (x_rate, _, z_rate), about = turned @ rate, float((turned @ faster)[1])
    parts = ("fin", "shaft", "fork")
    x, z = (sum(p[f"mass.{part}"] * p[f"center_of_mass.{part}.{axis}"] for part in parts) for axis in "xz")
    inertia = sum(p[f"inertia.{part}"] for part in parts)
    along, across = float(force[0]), float(force[2])

    def moment(angle: float) -> float:
        cosine, sine = math.cos(angle), math.sin(angle)
        weight = (z * cosine - x * sine) * along - (x * cosine + z * sine) * across
        plate = (x_rate**2 - z_rate**2) * sine * cosine + x_rate * z_rate * (cosine**2 - sine**2)
        return float(weight + inertia * (plate - about))

    return moment, along

"""Surroundings of an actuator between two discrete instants: its inputs and the vehicle's motion (2.27 - 2.45)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

Triple = tuple[float, float, float]

STANDARD_GRAVITY = 9.80665  # m/s2
_AXES = "xyz"
VEHICLE_MOTION = tuple(f"{vector}.{axis}" for vector in ("acceleration", "angular_rate", "angular_acceleration")
                       for axis in _AXES)
INPUTS_AT_REST = dict.fromkeys(
    ("fin_command", "aero_torque", *VEHICLE_MOTION, "attitude.roll", "attitude.pitch", "attitude.yaw"), 0.0)
# Parameters of friction about the hinge [N.m] and [N.m.s/rad], and of friction in cylinder and pump.
_HINGE_FRICTION = {"coulomb": ("friction.fin_coulomb",), "viscous": ("friction.fin_viscous",)}
_FLUID_FRICTION = {
    "coulomb": ("cylinder.coulomb_friction", "pump.coulomb_friction", "pump.pressure_friction"),
    "viscous": ("cylinder.viscous_friction", "pump.viscous_friction")}


class Surroundings(NamedTuple):
    """Quantities that are constant between two discrete instants."""

    reference: float  # current reference [A], valve command [1] or duty cycle [1], limited
    supply: float  # V or Pa
    aero_torque: float  # N.m, positive along +delta
    force: Triple  # m/s2, gravity minus acceleration, g_b - a_b, at the hinge in the fin's axes
    turning: Triple  # rad/s, the vehicle's rate in the fin's axes
    faster: Triple  # rad/s2, the vehicle's angular acceleration in the fin's axes
    enable: bool


def clip(value: float, limit: float) -> float:
    """Return `value` limited to the range -limit to limit, in any unit."""
    return max(-limit, min(limit, value))


def sign(value: float) -> int:
    """Return the sign of a number: -1, 0 or 1."""
    return (value > 0.0) - (value < 0.0)


def cross(a: Triple, b: Triple) -> Triple:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def surroundings(p: Mapping[str, float], row: Mapping[str, float], reference: float, supply: str) -> Surroundings:
    """Return the surroundings for a `row` of inputs, SI by name, and a `reference` as in `Surroundings`.

    `supply` is the name of the supply's input, `p` are the parameters.
    """
    gravity = STANDARD_GRAVITY if p["loads.gravity"] else 0.0
    roll, pitch = row["attitude.roll"], row["attitude.pitch"]  # yaw turns about g, without effect
    acceleration, rate, faster = ((row[f"{kind}.x"], row[f"{kind}.y"], row[f"{kind}.z"])
                                  for kind in ("acceleration", "angular_rate", "angular_acceleration"))
    hinge = (p["mounting.station"], 0.0, 0.0)
    at_hinge = [sum(parts) for parts in
                zip(acceleration, cross(faster, hinge), cross(rate, cross(rate, hinge)), strict=True)]
    x = -gravity * math.sin(pitch) - at_hinge[0]
    y = gravity * math.sin(roll) * math.cos(pitch) - at_hinge[1]
    z = gravity * math.cos(roll) * math.cos(pitch) - at_hinge[2]
    c, s = math.cos(p["mounting.azimuth"]), math.sin(p["mounting.azimuth"])

    def in_fin_axes(v: Triple) -> Triple:
        return v[0], c * v[1] + s * v[2], -s * v[1] + c * v[2]

    return Surroundings(reference, row[supply], row["aero_torque"], in_fin_axes((x, y, z)), in_fin_axes(rate),
                        in_fin_axes(faster), bool(row["enable"]))


def hinge_moment(masses: Iterable[Triple], inertia: float, delta: float, around: Surroundings) -> float:
    """Return the external moment T_f [N.m] about the hinge at a fin angle [rad], positive along +delta.

    `masses` are mass [kg], x and z [m] of each part's centre of mass. `inertia` [kg.m2] is about the hinge.
    """
    fx, _, fz = around.force
    c, s = math.cos(delta), math.sin(delta)
    moment = around.aero_torque
    for mass, x, z in masses:  # y . (r x m f), r turned right-handed about +y by delta
        moment += mass * ((-x * s + z * c) * fx - (x * c + z * s) * fz)

    def angular_momentum(w: Triple) -> Triple:
        # A plate with its masses along (c, 0, -s); products of inertia with y are neglected.
        x, z = s * s * w[0] + s * c * w[2], c * c * w[2] + s * c * w[0]
        return inertia * x, inertia * w[1], inertia * z

    # Euler's equation about the hinge: subtract the moment that turns the plate with the vehicle.
    return moment - (angular_momentum(around.faster)[1] + cross(around.turning, angular_momentum(around.turning))[1])


def masses_of(p: Mapping[str, float]) -> list[Triple]:
    """Return mass [kg], x and z [m] of the centres of mass of fin, shaft and fork at fin angle 0."""
    return [(p[f"mass.{part}"], p[f"center_of_mass.{part}.x"], p[f"center_of_mass.{part}.z"])
            for part in ("fin", "shaft", "fork")]


def hinge_friction(p: Mapping[str, float]) -> tuple[float, float]:
    """Return dry friction [N.m] and viscous friction [N.m.s/rad] about the hinge."""
    dry, viscous = (sum(p.get(name, 0.0) for name in names) for names in _HINGE_FRICTION.values())
    return dry, viscous


def as_built(p: Mapping[str, float]) -> dict[str, float]:
    """Return the plant's parameters: the nominal ones, which the controllers use, changed by ``deviation.*``.

    A deviation is relative to its parameter; that of the assembly angle is a difference [rad].
    """
    deviations = {name.removeprefix("deviation."): value for name, value in p.items() if name.startswith("deviation.")}
    deviation_of = {name: name for name in deviations if name in p}
    deviation_of |= {"inertia.fin": "mass.fin", "motor.back_emf_constant": "motor.torque_constant"}  # one flux
    for kind in ("coulomb", "viscous"):
        for name in p:
            if name.startswith(f"friction.{kind}.") or name in (*_HINGE_FRICTION[kind], *_FLUID_FRICTION[kind]):
                deviation_of[name] = f"friction.{kind}"
    angle = deviation_of.pop("kinematics.initial_angle", "")
    built = {name: p[name] * (1.0 + deviations[other]) for name, other in deviation_of.items()
             if name in p and other in deviations}
    return {**p, **built, **({angle: p[angle] + deviations[angle]} if angle else {})}

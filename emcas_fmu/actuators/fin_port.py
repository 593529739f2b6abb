"""The fin port: the interface of every actuator to a flight simulation, so that actuators are interchangeable.

Inputs are command, hinge moment, vehicle motion and enable; outputs are angle, rate, moment, error and flags; the
parameters are limits of command and travel, masses and inertias, mounting, delay of the command, sampling and tick.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians
from typing import Any

from ..control import command_bus
from ..control.controllers import clipped_command as clipped_command
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import loads
from ..rules import ANGLE, SLACK, Rule, in_degrees, rule, when
from ..variables import Terminal, Variable, boolean_input, boolean_output, parameter, real_input, real_output, switch

Equation = Callable[[Ops, Any, Record], Value]

# -- inputs ------------------------------------------------------------------------

VEHICLE_MOTION = (
    real_input("acceleration.x", "m/s2",
               "vehicle acceleration along body x (forward), at the point from which mounting.station is measured",
               nominal=10.0),
    real_input("acceleration.y", "m/s2", "vehicle acceleration along body y, at the point of acceleration.x",
               nominal=10.0),
    real_input("acceleration.z", "m/s2", "vehicle acceleration along body z (down), at the point of acceleration.x",
               nominal=10.0),
    real_input("attitude.roll", "rad", "vehicle roll angle, for gravity"),
    real_input("attitude.pitch", "rad", "vehicle pitch angle, for gravity"),
    real_input("attitude.yaw", "rad", "vehicle yaw angle (gravity does not depend on it)"),
    *(real_input(f"angular_rate.{axis}", "rad/s", f"vehicle angular rate about body {axis} ({name})")
      for axis, name in (("x", "roll rate p"), ("y", "pitch rate q"), ("z", "yaw rate r"))),
    *(real_input(f"angular_acceleration.{axis}", "rad/s2",
                 f"vehicle angular acceleration about body {axis}, d/dt of angular_rate.{axis}", nominal=10.0)
      for axis in "xyz"),
)
COMMAND = real_input("fin_command", "rad", "commanded fin angle; clipped to +-command.limit", nominal=0.1)
AERO_TORQUE = real_input(
    "aero_torque", "N.m", "aerodynamic hinge moment on the fin, positive along positive fin_angle "
    "(a restoring moment is negative at positive angle)", nominal=100.0)
ENABLE = boolean_input("enable", "false disables the actuator: the fin does not follow the command", True)
STEP_BEGIN = real_input("step_begin", "s", "start time of the host's step; set by the FMU, not by the host")

# -- outputs -----------------------------------------------------------------------

FIN_ANGLE = real_output("fin_angle", "rad", "fin angle", 0.1, limited_by=("fin.stop_angle",))
FIN_RATE = real_output("fin_rate", "rad/s", "fin angular rate", 1.0)
HINGE_TORQUE = real_output(
    "hinge_torque", "N.m", "total external moment about the hinge (aerodynamic + gravity + inertial)", 100.0)
TRACKING_ERROR = real_output("tracking_error", "rad", "clipped command minus fin angle", 0.1,
                             limited_by=("command.limit", "fin.stop_angle"))
MEASURED_FIN_ANGLE = real_output(
    "measured_fin_angle", "rad", "fin angle that the controllers read at the last sample", 0.1)
SATURATED = boolean_output("saturated", "a limit is active")
AT_STOP = boolean_output("at_stop", "the fin is at a mechanical stop")
OUTPUTS = (FIN_ANGLE, FIN_RATE, HINGE_TORQUE, TRACKING_ERROR, MEASURED_FIN_ANGLE, SATURATED, AT_STOP)


def described(descriptions: Mapping[str, str], outputs: tuple[Variable, ...] = OUTPUTS) -> tuple[Variable, ...]:
    """Return `outputs`, by default the port's, with `descriptions` by name instead of their own."""
    return tuple(replace(v, description=descriptions.get(v.name, v.description)) for v in outputs)


# -- parameters --------------------------------------------------------------------

_PARTS = (("fin", "fin"), ("shaft", "fin shaft"), ("fork", "fork"))
TURNING = (
    *(parameter(f"inertia.{part}", "kg.m2", 1e-9 if part == "fin" else 0.0, 1e3, f"{name} inertia about the hinge",
                sheet=f"drawing: inertia of the {name} about the hinge") for part, name in _PARTS),
    *(parameter(f"mass.{part}", "kg", 0.0, 1e3, f"{name} mass", sheet=f"drawing: mass of the {name}")
      for part, name in _PARTS),
    *(parameter(f"center_of_mass.{part}.{axis}", "m", -5.0, 5.0,
                f"{axis} coordinate of the {name}'s centre of mass, from the hinge at fin_angle 0",
                sheet=f"drawing: centre of mass of the {part} from the hinge")
      for part, name in _PARTS for axis in ("x", "z")),
)
"""Parameters of the parts that turn about the hinge; in a user's actuator all but inertia.fin default to 0."""
SAMPLE_TIME = parameter("controller.sample_time", "s", 5e-5, 0.1, "sample time of the digital controllers",
                        sheet="controller: sample time (cycle time)", display="ms")
PARAMETERS = (
    *TURNING,
    SAMPLE_TIME,
    parameter("command.limit", "rad", radians(0.1), radians(80), "largest fin command, to each side",
              sheet="specification: operating range of the fin, to each side"),
    parameter("fin.stop_angle", "rad", radians(0.1), radians(80), "fin angle of the inelastic stops, to each side",
              sheet="drawing: mechanical stop, to each side"),
    parameter("fin.start_angle", "rad", radians(-80), radians(80), "fin angle at the start, at rest"),
    switch("loads.gravity", "true: gravity acts on the moving parts (connect the attitude inputs)"),
    parameter("mounting.azimuth", "rad", radians(-360), radians(360), "roll angle of the fin's frame about body x"),
    parameter("mounting.station", "m", -100.0, 100.0,
              "position of the hinge along body x, from the point of the acceleration inputs"),
    parameter("command.latency", "s", 0.0, 2.0, "delay of the command before the controllers, rounded to whole sample "
              f"times, at most {command_bus.LONGEST_LATENCY} of them",
              sheet="specification: delay of the command on the data bus", display="ms"),
    parameter("command.resolution", "rad", 0.0, radians(10), "resolution to which the command is rounded (0: not "
              "rounded)"),
    parameter("command.update_time", "s", 0.0, 10.0, "interval at which the controllers read "
              "the command from the bus, rounded to whole sample times (0: at every sample)",
              sheet="specification: interval between commands on the data bus", display="ms"),
    parameter("solver.max_tick", "s", 1e-7, 1e-3, "longest internal tick", display="ms"),
)

TERMINALS = (
    Terminal("command", "commands from the flight computer, and its feedback",
             ("fin_command", "enable", "measured_fin_angle", "tracking_error", "saturated", "at_stop")),
    Terminal("hinge", "the fin's shaft: moment in, motion out",
             ("aero_torque", "hinge_angle", "hinge_rate", "fin_angle", "fin_rate", "hinge_torque", "actuator_torque",
              "armature")),
    Terminal("vehicle", "motion of the vehicle, for gravity and inertia", tuple(v.name for v in VEHICLE_MOTION)),
)

AT_LIMIT = 1.0 - 1e-12  # share of a limit from which a value is at the limit, despite rounding
LONGEST_DELAY = 64  # longest transport delay in sample times
MOST_TICKS = 20_000  # largest number of ticks in a sample time; more would take seconds to compute


def max_tick(ops: Ops, p: Any) -> Value:
    """Return solver.max_tick [s], the default of an actuator's `longest_tick`."""
    return p.solver.max_tick


def transport_delay(ops: Ops, p: Any) -> Value:
    """Return drive.transport_delay [s], the delay from a sample to the drive."""
    return p.drive.transport_delay


def inputs(supply: Variable | None = None, further: tuple[Variable, ...] = ()) -> tuple[Variable, ...]:
    """Return the inputs of an actuator: the port's, its `supply`, if any, and its `further` inputs."""
    return (COMMAND, AERO_TORQUE, *VEHICLE_MOTION, *(() if supply is None else (supply,)), ENABLE, *further)


# -- equations ---------------------------------------------------------------------


EQUATIONS: Mapping[str, Equation] = {
    "fin_angle": lambda ops, p, m: m.fin,
    "fin_rate": lambda ops, p, m: m.rate,
    "hinge_torque": lambda ops, p, m: m.hinge_torque,
    "tracking_error": lambda ops, p, m: clipped_command(ops, p, m.u.command) - m.fin,
    "measured_fin_angle": lambda ops, p, m: m.u.measured_fin_angle,
    "saturated": lambda ops, p, m: m.limited,
    "at_stop": lambda ops, p, m: ops.fabs(m.fin) >= stop_edge(p),
}
"""The equations of OUTPUTS, from a moment: `fin` [rad], `rate` [rad/s], `hinge_torque` [N.m], `limited`, inputs `u`."""


def at_fin(ops: Ops, p: Any, x: Record, u: Record, limited: Value, **further: Value) -> Record:
    """Return the moment of an actuator with the states fin_angle and fin_rate, and its `further` values.

    `limited` says whether a limit is active.
    """
    return Record(x=x, u=u, fin=x.fin_angle, rate=x.fin_rate, hinge_torque=hinge_torque(ops, p, x.fin_angle, u),
                  limited=limited, **further)


def completed(ops: Ops, p: Any, x: Record, u: Record, limited: Value, values: Mapping[str, Value]
              ) -> Mapping[str, Value]:
    """Return output `values`, completed by those of the port; the actuator has the states fin_angle and fin_rate."""
    if not (missing := [name for name in EQUATIONS if name not in values]):
        return values
    now = at_fin(ops, p, x, u, limited)
    return {**{name: EQUATIONS[name](ops, p, now) for name in missing}, **values}


def mixed_command(ops: Ops, p: Any, command: Value, roll: Value, pitch: Value, yaw: Value) -> Value:
    """Return the command [rad] of one of several fins, with its share of the mixing inputs.

    A positive deflection of a panel at mounting.azimuth turns its leading edge up, seen with the hinge pointing to the
    right. Behind the centre of mass its lift causes negative moments about the body axes x, y and z: the lift times its
    arm and 1, cos(azimuth), sin(azimuth). Positive mixing inputs therefore command positive moments.
    """
    azimuth = p.mounting.azimuth
    return command - (roll + pitch * ops.cos(azimuth) + yaw * ops.sin(azimuth))


def stop_edge(p: Any) -> Value:
    """Return the absolute fin angle [rad] from which the fin is at a mechanical stop."""
    return p.fin.stop_angle * AT_LIMIT


def hinge_inertia(p: Any) -> Value:
    """Return the inertia [kg.m2] of fin, shaft and fork about the hinge."""
    return loads.fin_inertia(p)


def hinge_torque(ops: Ops, p: Any, fin_angle: Value, u: Any) -> Value:
    """Return the external moment about the hinge [N.m] at a fin angle [rad] under plant inputs `u`."""
    return u.aero_torque + loads.hinge_moment_at(ops, p, fin_angle, u)


# -- rules -------------------------------------------------------------------------


@rule(f"fin.stop_angle = {ANGLE} must be at least command.limit = {ANGLE}")
def _travel(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    stop, limit = p.fin.stop_angle, p.command.limit
    return when(ops, limit > stop * (1.0 + SLACK)), stop, in_degrees(stop), limit, in_degrees(limit)


# Smallest distance of the stop from command.limit, as a share of command.limit: accuracy over range in the thesis's
# Table 2. A nearer stop hides an overshoot that matters.
LEAST_ROOM = 0.01


@rule(f"fin.stop_angle = {ANGLE} exceeds command.limit = {ANGLE} by less than {LEAST_ROOM:g} of that limit: the stop "
      "hides an overshoot of a step to the limit; lower command.limit", warning=True)
def _room(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    stop, limit = p.fin.stop_angle, p.command.limit
    tight = ops.both(limit <= stop * (1.0 + SLACK), stop < limit * (1.0 + LEAST_ROOM) * (1.0 - SLACK))
    return when(ops, tight), stop, in_degrees(stop), limit, in_degrees(limit)


@rule(f"fin.start_angle = {ANGLE} must lie within +-fin.stop_angle = {ANGLE}")
def _start(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    start, stop = p.fin.start_angle, p.fin.stop_angle
    return when(ops, ops.fabs(start) > stop * (1.0 + SLACK)), start, in_degrees(start), stop, in_degrees(stop)


@rule(f"command.latency = %.6g s must be at most {command_bus.LONGEST_LATENCY} times controller.sample_time = %.6g s")
def _latency(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    latency, period = p.command.latency, p.controller.sample_time
    return when(ops, latency > command_bus.LONGEST_LATENCY * period * (1.0 + SLACK)), latency, period


RULES = (_travel, _room, _start, _latency)


def schedule_rules(tick: Any, delay: Any, tick_remedy: str) -> tuple[Rule, ...]:
    """Return the rules for delay and ticks in a sample time; `tick` and `delay` return longest tick and delay [s].

    `delay` is None for an actuator without a delay; `tick_remedy` says how a user makes the tick longer.
    """
    name = "drive.transport_delay" if delay is transport_delay else "transport_delay(ops, p)"

    @rule(f"{name} = %.6g s must be at least 0, and at most {LONGEST_DELAY} times controller.sample_time = %.6g s")
    def delayed(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        duration, period = delay(ops, p), p.controller.sample_time
        fits = ops.both(duration >= 0.0, duration <= LONGEST_DELAY * period * (1.0 + SLACK))
        return when(ops, ops.negate(fits)), duration, period

    @rule(f"controller.sample_time = %.6g s needs more than {MOST_TICKS} ticks of %.6g s; {tick_remedy}, or lower "
          "controller.sample_time")
    def ticks(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        longest, period = tick(ops, p), p.controller.sample_time
        fits = ops.both(period <= MOST_TICKS * longest, longest <= sys.float_info.max)
        return when(ops, ops.negate(fits)), period, longest  # a NaN does not fit

    return (ticks,) if delay is None else (delayed, ticks)

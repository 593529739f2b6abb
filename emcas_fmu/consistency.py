"""What a set of parameter values must fulfil. Standard library only: it is embedded in the FMU."""

from __future__ import annotations

from math import degrees, isfinite, radians
from typing import TYPE_CHECKING

from .kernels.core import longest_tick
from .physics.friction import coulomb_polynomial

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

# The lever's tangent grows without bound towards 90 deg.
LARGEST_LEVER_ANGLE = radians(85.0)
# Of the drive's transport delay, in sample times.
LONGEST_DELAY = 128
# Beyond it a sample time would cost seconds and the schedule megabytes.
MOST_TICKS = 20_000
_POWERS = range(7)
_SCAN = 100  # points on each side of zero
# Relative. Equal limits may differ in the last digit when they were given in different units.
_SLACK = 1e-12
_INERTIAS = ("inertia.motor", "inertia.screw", "inertia.fin", "inertia.shaft", "inertia.fork")


def check_ranges(values: Mapping[str, float], table: Iterable[tuple[str, float, float]]) -> list[str]:
    """Problems of single values: not finite, or outside the inclusive limits of (name, minimum, maximum).

    Values and limits are in the variable table's units. Raises KeyError where `values` lacks a name.
    """
    problems = []
    for name, minimum, maximum in table:
        value = values[name]
        if not isfinite(value):
            problems.append(_not_finite(name, value))
        elif value < minimum:
            problems.append(f"{name} = {value!r} is below its minimum {minimum!r}")
        elif value > maximum:
            problems.append(f"{name} = {value!r} is above its maximum {maximum!r}")
    return problems


def check_consistency(values: Mapping[str, float]) -> list[str]:
    """Combinations of parameters without physical sense, one message each; none if all is well.

    `values` are in the variable table's units, within their ranges. Non-finite ones are reported alone,
    since nothing can be said of a combination with them.
    """
    problems = [_not_finite(name, value) for name, value in values.items() if not isfinite(value)]
    if problems:
        return problems
    stop, limit = values["fin.stop_angle"], values["command.limit"]
    if limit > stop * (1.0 + _SLACK):
        problems.append(f"fin.stop_angle = {_angle(stop)} must be at least command.limit = {_angle(limit)}")
    start = values["fin.start_angle"]
    if abs(start) > stop * (1.0 + _SLACK):
        problems.append(f"fin.start_angle = {_angle(start)} must lie within "
                        f"+-fin.stop_angle = {_angle(stop)}")
    initial = values["kinematics.initial_angle"]
    if abs(initial) + stop >= LARGEST_LEVER_ANGLE * (1.0 - _SLACK):
        problems.append(f"|kinematics.initial_angle| = {_angle(abs(initial))} and "
                        f"fin.stop_angle = {_angle(stop)} add up to {_angle(abs(initial) + stop)}; "
                        f"the sum must be below {_angle(LARGEST_LEVER_ANGLE)}")
    problems += [problem for direction in ("positive", "negative")
                 if (problem := _negative_friction(values, direction, stop))]
    delay, sample_time = values["drive.transport_delay"], values["controller.sample_time"]
    if delay > LONGEST_DELAY * sample_time * (1.0 + _SLACK):
        problems.append(f"drive.transport_delay = {delay:.6g} s must be at most {LONGEST_DELAY} times "
                        f"controller.sample_time = {sample_time:.6g} s")
    tick = longest_tick(values)
    if sample_time > MOST_TICKS * tick:
        problems.append(f"controller.sample_time = {sample_time:.6g} s needs over {MOST_TICKS} ticks of {tick:.6g} s; "
                        "raise solver.max_tick or motor.inductance, or lower drive.ki or controller.sample_time")
    if values["encoder.multiplier"] not in (1, 2, 4):
        problems.append(f"encoder.multiplier = {values['encoder.multiplier']} must be 1, 2 or 4")
    if sum(values[name] for name in _INERTIAS) <= 0.0:
        problems.append(f"{' + '.join(_INERTIAS)} = {sum(values[name] for name in _INERTIAS):.6g} kg.m2 "
                        "must be above 0")
    return problems


def _negative_friction(values: Mapping[str, float], direction: str, stop: float) -> str:
    """The message if the Coulomb polynomial of a direction is negative anywhere within the stops, or ''."""
    name = f"friction.coulomb.{direction}"
    coefficients = [values[f"{name}[{power}]"] for power in _POWERS]
    lowest, where = min((coulomb_polynomial(coefficients, angle), angle)
                        for angle in (stop * i / _SCAN for i in range(-_SCAN, _SCAN + 1)))
    largest = coulomb_polynomial([abs(c) for c in coefficients], stop)
    if lowest >= -_SLACK * largest:
        return ""
    written = ", ".join(f"{c:.6g}" for c in coefficients)
    return (f"{name} = [{written}] N.m gives a friction of {lowest:.6g} N.m at fin_angle = {_angle(where)}; "
            f"it must not be below 0 within +-fin.stop_angle = {_angle(stop)}")


def _not_finite(name: str, value: float) -> str:
    return f"{name} = {value} is not a finite number"


def _angle(value: float) -> str:
    return f"{value:.6g} rad ({degrees(value):.6g} deg)"

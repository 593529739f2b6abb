"""Dry friction, stops, backlash and limits, which an actuator lists beside smooth equations.

Each has a name, under which the equations read its value from the plant inputs ``u``:

    Coulomb("friction", "fin_rate", torque)   u.friction, the torque [N.m] that opposes the rate; at rest it is what
                                              holds the body, at most `torque` times breakaway (outputs only)
    Stop("fin_angle", "fin_rate", limit)      no value: the angle stays within +-limit, and an impact is inelastic
    Backlash("mesh", deflection, half_gap)    u.mesh, the deflection beyond the gap; u.mesh_closed, 1 in contact, else 0
    Limit("voltage", value, high, low)        u.voltage, the value between low (default -high) and high

A torque, deflection, gap, value or limit is a number, the name of a parameter, or a function of (ops, p, x, u), where
``u`` has the values of limits and gaps (for these: of those listed before), but not of frictions. The equations are
stepped from event to event (:mod:`emcas_fmu.steppers.events`): a body starts, comes to rest or meets its stop; a
contact closes or opens; a limit is met or left. Linear analysis has no friction, and a backlash in contact.

A body that rests is one whose rate the friction would reverse: no inertia is needed to find that, but the derivative of
the rate must be linear in the friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import inf, isclose, isinf
from typing import Any, NamedTuple

from ..errors import EmcasError, hint
from ..namespace import Record, value_of
from ..ops.base import Ops, Value
from ..physics import stick
from .events import Switched, Values
from .smooth import Derivatives

Equation = Callable[[Ops, Any, Record, Record], Value] | str | float
# Share of one plus a limit by which its margin is wider: a value exactly at the limit is on neither side.
_WIDER = 1e-12
_LINEAR = 1e-6  # of a change: rounding of derivatives whose other terms are large


def _wider(ops: Ops, limit: Value) -> Value:
    return 0.0 if isinstance(limit, float) and isinf(limit) else _WIDER * (1.0 + ops.fabs(limit))


def _value(equation: Equation, ops: Ops, p: Any, x: Record, u: Record) -> Value:
    if callable(equation):
        return equation(ops, p, x, u)
    return value_of(p, equation) if isinstance(equation, str) else equation


@dataclass(frozen=True)
class Coulomb:
    """Dry friction of the body with a `rate` [rad/s]: it opposes motion with `torque`, which is 0 or above.

    A body at rest starts beyond `breakaway` times that torque, 1 or above. The derivative of the rate must be linear in
    the value; no other derivative may depend on it. Where a body starts and turns back within a step, its angle is kept
    if it has a Stop.
    """

    name: str
    rate: str
    torque: Equation
    breakaway: Equation = 1.0


@dataclass(frozen=True)
class Stop:
    """Mechanical stops at +-`limit` of an `angle` [rad], whose derivative is `rate`; an impact is inelastic."""

    angle: str
    rate: str
    limit: Equation


@dataclass(frozen=True)
class Limit:
    """A `value` that is limited to `low`, by default -`high`, and `high`; the output saturated says so if it
    `saturates`."""

    name: str
    value: Equation
    high: Equation
    low: Equation | None = None
    saturates: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the values."""
        return (self.name,)

    def range(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Value, Value]:
        """Return low and high."""
        high = _value(self.high, ops, p, x, u)
        return -high if self.low is None else _value(self.low, ops, p, x, u), high

    def values(self, ops: Ops, value: Value, side: Value, low: Value, high: Value) -> Values:
        """Return the values that the equations read, of a `value` at a limit or between them (`side` 1, -1, 0)."""
        return {self.name: ops.where(side > 0.0, high, ops.where(side < 0.0, low, value))}

    def smooth(self, ops: Ops, value: Value, low: Value, high: Value) -> Values:
        """Return the values for linear analysis: a limit limits there, too."""
        return {self.name: ops.clip(value, low, high)}


@dataclass(frozen=True)
class Backlash(Limit):
    """A gap of +-`high` in a `value`, the deflection between two bodies: a force acts on what is beyond it."""

    saturates: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        return self.name, f"{self.name}_closed"

    def values(self, ops: Ops, value: Value, side: Value, low: Value, high: Value) -> Values:
        closed = ops.where(ops.equal(side, 0.0), 0.0, 1.0)
        return {self.name: closed * (value - ops.where(side > 0.0, high, low)), f"{self.name}_closed": closed}

    def smooth(self, ops: Ops, value: Value, low: Value, high: Value) -> Values:
        return {self.name: value, f"{self.name}_closed": 1.0}


Discontinuity = Coulomb | Stop | Limit


class _At(NamedTuple):
    """A limit or gap at one moment: its value, its range, and the side that it is limited to (1, -1; 0 between)."""

    value: Value
    low: Value
    high: Value
    side: Value


class _Body(NamedTuple):
    """The dry friction and the stop of one rate."""

    rate: str
    friction: Coulomb | None
    stop: Stop | None

    def place(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Value, Value]:
        """Return angle and stop [rad]."""
        return (0.0, inf) if self.stop is None else (getattr(x, self.stop.angle), _value(self.stop.limit, ops, p, x, u))


class System:
    """Smooth `derivatives`, which return d/dt of every state, with discontinuities.

    Raises EmcasError if two of these act on one rate, or if a state that one names is not among `states`.
    """

    def __init__(self, derivatives: Derivatives, discontinuities: Sequence[Discontinuity], states: Sequence[str]
                 ) -> None:
        self._derivatives = derivatives
        for each in discontinuities:
            named = () if isinstance(each, Limit) else (each.rate, *([each.angle] if isinstance(each, Stop) else []))
            if missing := [name for name in named if name not in states]:
                raise EmcasError(f"{type(each).__name__}: there is no state {missing[0]}{hint(missing[0], states)}; "
                                 f"there is {', '.join(states)}")
        self._limits = [each for each in discontinuities if isinstance(each, Limit)]
        frictions = _by_rate(each for each in discontinuities if isinstance(each, Coulomb))
        stops = _by_rate(each for each in discontinuities if isinstance(each, Stop))
        self._bodies = [_Body(rate, frictions.get(rate), stops.get(rate)) for rate in {**frictions, **stops}]
        self._still = {friction.name: 0.0 for friction in frictions.values()}
        self.names = (*self._still, *(name for limit in self._limits for name in limit.names))
        system = Switched(self._mode, self._rates, self._margins, self._landed, check=self._check)
        self.step = system.step(lambda ops, p: p)

    # -- what the equations read ------------------------------------------------

    def smooth(self, ops: Ops, p: Any, x: Record, u: Record) -> Values:
        """Return d/dt of the states without friction, and in contact."""
        for limit in self._limits:
            u = _with(u, limit.smooth(ops, _value(limit.value, ops, p, x, u), *limit.range(ops, p, x, u)))
        return self._free(ops, p, x, u)

    def present(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Any, Value]:
        """Return the plant inputs with every value, and whether a limit is active; friction holds a body at rest."""
        u, limits = self._limited(ops, p, x, u)
        active = reduce(ops.either, (ops.negate(ops.equal(limits[each.name].side, 0.0)) for each in self._limits
                                     if each.saturates), False)
        rates, frictions = self._free(ops, p, x, u), {}
        for body in self._bodies:
            if body.friction is not None:
                free = rates[body.rate]
                dry, torque, breakaway = self._friction(ops, p, x, u, body.rate, body.friction, free)
                most = torque * breakaway
                holding = ops.clip(torque * free / ops.where(dry > 0.0, dry, 1.0), -most, most)
                speed = getattr(x, body.rate)
                frictions[body.friction.name] = ops.where(
                    ops.equal(speed, 0.0), holding, ops.where(speed > 0.0, torque, -torque))
        return _with(u, frictions), active

    def _limited(self, ops: Ops, p: Any, x: Record, u: Record, mode: Record | None = None
                 ) -> tuple[Record, dict[str, _At]]:
        """Return the plant inputs with the values of limits and gaps, and each of these: on the side of a mode, or of
        now."""
        limits = {}
        for each in self._limits:
            value, (low, high) = _value(each.value, ops, p, x, u), each.range(ops, p, x, u)
            side = ops.where(value > high, 1.0, ops.where(value < low, -1.0, 0.0)) if mode is None else mode.sides[
                each.name]
            limits[each.name] = _At(value, low, high, side)
            u = _with(u, each.values(ops, value, side, low, high))
        return u, limits

    def _free(self, ops: Ops, p: Any, x: Record, u: Record) -> Values:
        """Return d/dt of the states without friction."""
        return self._derivatives(ops, p, x, _with(u, self._still))

    def _friction(self, ops: Ops, p: Any, x: Record, u: Record, rate: str, friction: Coulomb, free: Value
                  ) -> tuple[Value, Value, Value]:
        """Return deceleration by a friction, its torque, and breakaway ratio; `free` is d/dt of `rate` without it."""
        torque = _value(friction.torque, ops, p, x, u)
        rubbed = self._derivatives(ops, p, x, _with(u, {**self._still, friction.name: torque}))[rate]
        return free - rubbed, torque, _value(friction.breakaway, ops, p, x, u)

    def _check(self, ops: Ops, p: Any, x: Record, u: Record) -> None:
        """Raise EmcasError for limits in the wrong order, negative ones, and equations that misuse a value."""
        u, read = _reading(u)
        u, limits = self._limited(ops, p, x, u)
        rates = self._free(ops, p, x, u)
        for each in self._limits:
            at = limits[each.name]
            if at.low > at.high:
                raise EmcasError(f"{type(each).__name__} {each.name}: its low limit {at.low:.4g} is above the high "
                                 f"one, {at.high:.4g}")
            if not read.intersection(each.names):
                raise EmcasError(f"{type(each).__name__} {each.name}: no derivative depends on u.{each.name}")
        for body in self._bodies:
            _, limit = body.place(ops, p, x, u)
            if body.stop is not None and not limit > 0.0:
                raise EmcasError(f"Stop of {body.stop.angle}: its limit is {limit:.4g}; it must be above 0")
            if body.stop is not None and not isclose(rates[body.stop.angle], getattr(x, body.rate), rel_tol=_LINEAR):
                raise EmcasError(f"Stop of {body.stop.angle}: the derivative of that state must be {body.rate}")
            if body.friction is not None:
                self._check_friction(ops, p, x, u, body.rate, body.friction)

    def _check_friction(self, ops: Ops, p: Any, x: Record, u: Record, rate: str, friction: Coulomb) -> None:
        name = friction.name
        if (torque := _value(friction.torque, ops, p, x, u)) < 0.0:
            raise EmcasError(f"Coulomb {name}: its torque is {torque:.4g}; it must be 0 or above")
        if (ratio := _value(friction.breakaway, ops, p, x, u)) < 1.0:
            raise EmcasError(f"Coulomb {name}: its breakaway is {ratio:.4g}; it must be 1 or above, a ratio to torque")
        probe = 1.0 + torque  # a torque near 0 would be lost in rounding
        free, above, below = (self._derivatives(ops, p, x, _with(u, {**self._still, name: value}))
                              for value in (0.0, probe, -probe))
        change = above[rate] - free[rate]
        if change >= 0.0:
            raise EmcasError(f"Coulomb {name}: the derivative of {rate} must fall with u.{name}, which opposes "
                             "positive motion: subtract it there")
        if abs(above[rate] + below[rate] - 2.0 * free[rate]) > _LINEAR * abs(change):
            raise EmcasError(f"Coulomb {name}: the derivative of {rate} must be linear in u.{name}")
        if other := [each for each in free if each != rate and above[each] != free[each]]:
            raise EmcasError(f"Coulomb {name}: the derivative of {other[0]} depends on u.{name}, too; friction of "
                             "bodies that are rigidly coupled needs a step")

    # -- a mode, which holds for a step -----------------------------------------

    def _mode(self, ops: Ops, p: Any, x: Record, u: Record, h: Value) -> Record:
        u, limits = self._limited(ops, p, x, u)
        rates, bodies = self._free(ops, p, x, u), {}
        for body in self._bodies:
            free = rates[body.rate]
            dry, _, breakaway = (0.0, 0.0, 1.0) if body.friction is None else self._friction(
                ops, p, x, u, body.rate, body.friction, free)
            angle, limit = body.place(ops, p, x, u)
            slide = stick.slide(ops, getattr(x, body.rate), free, dry * breakaway, angle, limit)
            # Without friction nothing but a stop holds a body.
            holds = ops.either(dry > 0.0, ops.fabs(angle) >= limit)
            bodies[body.rate] = slide, ops.both(ops.equal(slide.direction, 0.0), holds)
        return Record(sides={name: at.side for name, at in limits.items()}, bodies=bodies)

    def _acting(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Any:
        """Return the plant inputs with every value in a mode."""
        u, _ = self._limited(ops, p, x, u, m)
        directions = {rate: slide.direction for rate, (slide, _) in m.bodies.items()}
        return _with(u, {body.friction.name: directions[body.rate] * _value(body.friction.torque, ops, p, x, u)
                         for body in self._bodies if body.friction is not None})

    def _rates(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Values:
        rates = self._derivatives(ops, p, x, self._acting(ops, p, x, u, m))
        return {**rates, **{rate: ops.where(held, 0.0, rates[rate]) for rate, (_, held) in m.bodies.items()}}

    def _margins(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Values:
        u, limits = self._limited(ops, p, x, u, m)
        margins = {}
        for name, (value, low, high, side) in limits.items():
            margins[f"{name} high"] = ops.where(side > 0.0, value - high, high - value) + _wider(ops, high)
            margins[f"{name} low"] = ops.where(side < 0.0, low - value, value - low) + _wider(ops, low)
        rates = self._free(ops, p, x, u)
        for body in self._bodies:
            slide, held = m.bodies[body.rate]
            # A body that slides comes to rest; one that started at rest in this step has a speed of 0 at its start.
            slides = 1.0 if body.friction is None else ops.where(
                ops.equal(slide.direction, 0.0), 1.0, slide.direction * getattr(x, body.rate))
            if body.friction is not None and callable(body.friction.torque):  # what holds may change within a step
                dry, _, breakaway = self._friction(ops, p, x, u, body.rate, body.friction, rates[body.rate])
                high, low = stick.holding(ops, dry * breakaway, *body.place(ops, p, x, u))
                slide = slide._replace(high=high, low=low)
            margins[body.rate] = ops.where(held, stick.reserve(ops, slide, rates[body.rate]), slides)
            if body.stop is not None:
                angle, limit = body.place(ops, p, x, u)
                margins[body.stop.angle] = ops.where(held, 1.0, limit - ops.fabs(angle))
        return margins

    def _landed(self, ops: Ops, p: Any, begin: Record, x: Record, u: Record, m: Record, events: Values) -> Values:
        if any(body.stop is not None and callable(body.stop.limit) for body in self._bodies):
            u, _ = self._limited(ops, p, x, u, m)  # a stop's limit may read the values of limits and gaps
        landed = {}
        for body in self._bodies:
            slide, held = m.bodies[body.rate]
            speed, moves, back = getattr(x, body.rate), ops.negate(held), False
            if body.friction is not None:
                started = ops.both(moves, ops.negate(ops.equal(slide.direction, 0.0)))
                back = ops.both(started, stick.nowhere(ops, slide, getattr(begin, body.rate), speed))
                speed = ops.where(ops.either(back, ops.both(moves, events[body.rate])), 0.0, speed)
            if body.stop is not None:
                angle, limit = body.place(ops, p, x, u)
                beyond = ops.both(ops.fabs(angle) >= limit, angle * speed > 0.0)
                met = ops.both(moves, ops.either(events[body.stop.angle], beyond))
                inside = ops.where(met, ops.where(angle > 0.0, limit, -limit), ops.clip(angle, -limit, limit))
                landed[body.stop.angle] = ops.where(back, getattr(begin, body.stop.angle), inside)
                speed = ops.where(met, 0.0, speed)
            landed[body.rate] = speed
        return landed


def _reading(u: Any) -> tuple[Any, set[str]]:
    """Return inputs that record the names that are read of them, and these names."""
    read: set[str] = set()

    class Reading(type(u)):  # type: ignore[misc]
        def __getattribute__(self, name: str) -> Any:
            read.add(name)
            return super().__getattribute__(name)

    return Reading(**vars(u)), read


def _by_rate(discontinuities: Any) -> dict[str, Any]:
    by_rate: dict[str, Any] = {}
    for each in discontinuities:
        if each.rate in by_rate:
            remedy = "the narrower" if isinstance(each, Stop) else "one with the sum"
            raise EmcasError(f"{type(each).__name__} of {each.rate} is listed twice; list {remedy}")
        by_rate[each.rate] = each
    return by_rate


def _with(u: Any, values: Mapping[str, Value]) -> Any:
    return type(u)(**{**vars(u), **values})

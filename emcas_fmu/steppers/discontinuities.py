"""Dry friction, stops, backlash and limits, which an actuator lists beside smooth equations.

The equations read the effect of a discontinuity, other than a stop, from the plant inputs ``u``:

    Coulomb("friction", "fin_rate", torque)   u.friction [N.m], positive against a positive rate. At rest derivatives
                                              read 0, and outputs the holding torque, up to breakaway times `torque`
    Stop("fin_angle", "fin_rate", limit)      nothing: the angle stays within +-limit, and an impact is inelastic
    Backlash("mesh", deflection, half_gap)    u.mesh, the deflection beyond the gap; u.mesh_closed, 1 in contact, else 0
    Limit("voltage", value, high, low)        u.voltage, the value between low (default -high) and high

A torque, breakaway, deflection, gap, value or limit is a number, the name of a parameter, or a function of (ops, p, x,
u). The function of a friction or stop may read the values of all limits and gaps in ``u``; the function of a limit or
gap may read those listed before it. No function may read a friction. The equations are stepped from event to event
(:mod:`emcas_fmu.steppers.events`): a body starts, comes to rest or meets its stop; a contact closes or opens; a value
meets or leaves its limit. Linear analysis leaves out frictions and stops, and treats a gap as closed and of no width.

A body at rest stays there while its deceleration by breakaway friction exceeds its acceleration without friction. This
needs no inertia, but the derivative of the rate must be linear in the friction.
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

Expression = Callable[[Ops, Any, Record, Record], Value] | str | float
# The event margins of a limit are larger by this share of 1 + |limit|: they stay positive exactly at the limit.
_WIDER = 1e-12
_LINEAR = 1e-6  # relative tolerance of checked derivatives, for the rounding of their larger terms


def _widening(ops: Ops, limit: Value) -> Value:
    return 0.0 if isinstance(limit, float) and isinf(limit) else _WIDER * (1.0 + ops.fabs(limit))


def _value(equation: Expression, ops: Ops, p: Any, x: Record, u: Record) -> Value:
    if callable(equation):
        return equation(ops, p, x, u)
    return value_of(p, equation) if isinstance(equation, str) else equation


@dataclass(frozen=True)
class Coulomb:
    """Dry friction of a body: a torque of the size `torque` [N.m] opposes the state `rate` [rad/s].

    The torque must not be negative. A body at rest starts beyond `breakaway` times the torque; `breakaway` is a ratio
    [-] of at least 1. The derivative of the rate must be linear in the friction; no other derivative may depend on the
    friction. A body that starts and turns back within a step ends the step at rest. If it has a Stop, it also returns
    to its angle at the start of the step.
    """

    name: str
    rate: str
    torque: Expression
    breakaway: Expression = 1.0


@dataclass(frozen=True)
class Stop:
    """Mechanical stops at +-`limit` [rad] of the state `angle`, whose derivative is the state `rate` [rad/s]."""

    angle: str
    rate: str
    limit: Expression


@dataclass(frozen=True)
class Limit:
    """A `value` limited to the range from `low` to `high`, in the unit of the value; `low` is -`high` by default.

    If the limit `saturates`, the output ``saturated`` is true at `low` and `high`.
    """

    name: str
    value: Expression
    high: Expression
    low: Expression | None = None
    saturates: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """The names in ``u`` of the values that equations read."""
        return (self.name,)

    def range(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Value, Value]:
        """Return the low and the high limit, in the unit of the value."""
        high = _value(self.high, ops, p, x, u)
        return -high if self.low is None else _value(self.low, ops, p, x, u), high

    def values(self, ops: Ops, value: Value, side: Value, low: Value, high: Value) -> Values:
        """Return the values that equations read, by name; `side` is 1 at the high limit, -1 at the low one, else 0."""
        return {self.name: ops.where(side > 0.0, high, ops.where(side < 0.0, low, value))}

    def smooth(self, ops: Ops, value: Value, low: Value, high: Value) -> Values:
        """Return the values that linear analysis reads, by name; it also limits the value."""
        return {self.name: ops.clip(value, low, high)}


@dataclass(frozen=True)
class Backlash(Limit):
    """A gap of half width `high` in the deflection `value` [rad]; equations read the deflection beyond the gap."""

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
    """A limit or gap at an instant: its value and range, and the limit that is reached (1 high, -1 low, 0 neither)."""

    value: Value
    low: Value
    high: Value
    side: Value


class _Body(NamedTuple):
    """A body: the name of its rate, and the dry friction and the stop with that rate, if any."""

    rate: str
    friction: Coulomb | None
    stop: Stop | None

    def angle_and_limit(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Value, Value]:
        """Return the angle and the stop's limit [rad]; without a stop 0 and infinity."""
        return (0.0, inf) if self.stop is None else (getattr(x, self.stop.angle), _value(self.stop.limit, ops, p, x, u))


class System:
    """A plant with discontinuities; its smooth `derivatives` return d/dt of every state.

    Raises EmcasError if two frictions or two stops have the same rate, or if a friction or stop names a state that is
    not among `states`. The first simulation raises EmcasError if limits, torques or derivatives do not fit.
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
        self._no_friction = {friction.name: 0.0 for friction in frictions.values()}
        self.names = (*self._no_friction, *(name for limit in self._limits for name in limit.names))
        system = Switched(self._mode, self._rates, self._margins, self._landed, check=self._check)
        self.step = system.step(lambda ops, p: p)

    def smooth(self, ops: Ops, p: Any, x: Record, u: Record) -> Values:
        """Return d/dt of the states for linear analysis, without frictions, stops and gaps."""
        for limit in self._limits:
            u = _with(u, limit.smooth(ops, _value(limit.value, ops, p, x, u), *limit.range(ops, p, x, u)))
        return self._free(ops, p, x, u)

    def present(self, ops: Ops, p: Any, x: Record, u: Record) -> tuple[Any, Value]:
        """Return the plant inputs with the values that outputs read, and whether a limit that saturates is reached."""
        u, limits = self._limited(ops, p, x, u)
        active = reduce(ops.either, (ops.negate(ops.equal(limits[each.name].side, 0.0)) for each in self._limits
                                     if each.saturates), False)
        rates, frictions = self._free(ops, p, x, u), {}
        for body in self._bodies:
            if body.friction is not None:
                acceleration = rates[body.rate]
                deceleration, torque, breakaway = self._friction(ops, p, x, u, body, acceleration)
                most = torque * breakaway
                divisor = ops.where(deceleration > 0.0, deceleration, 1.0)
                holding = ops.clip(torque * acceleration / divisor, -most, most)
                speed = getattr(x, body.rate)
                frictions[body.friction.name] = ops.where(
                    ops.equal(speed, 0.0), holding, ops.where(speed > 0.0, torque, -torque))
        return _with(u, frictions), active

    def _limited(self, ops: Ops, p: Any, x: Record, u: Record, mode: Record | None = None
                 ) -> tuple[Record, dict[str, _At]]:
        """Return the plant inputs with the values of limits and gaps, and the limits and gaps themselves by name.

        Which side of a limit is reached follows from `mode` or, without a mode, from the present value.
        """
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
        return self._derivatives(ops, p, x, _with(u, self._no_friction))

    def _friction(self, ops: Ops, p: Any, x: Record, u: Record, body: _Body, acceleration: Value
                  ) -> tuple[Value, Value, Value]:
        """Return a body's deceleration [rad/s2] by friction, the torque [N.m] and the breakaway ratio [-] of its
        friction; `acceleration` is that without friction [rad/s2]."""
        if body.friction is None:
            return 0.0, 0.0, 1.0
        torque = _value(body.friction.torque, ops, p, x, u)
        rates = self._derivatives(ops, p, x, _with(u, {**self._no_friction, body.friction.name: torque}))
        return acceleration - rates[body.rate], torque, _value(body.friction.breakaway, ops, p, x, u)

    def _check(self, ops: Ops, p: Any, x: Record, u: Record) -> None:
        """Raise EmcasError for a limit or gap that no derivative reads or whose low limit is above its high limit, for
        a stop that is not above 0 or whose rate is not the angle's derivative, and for a friction that does not fit."""
        u, read = _reading(u)
        u, limits = self._limited(ops, p, x, u)
        rates = self._free(ops, p, x, u)
        for each in self._limits:
            at = limits[each.name]
            if at.low > at.high:
                raise EmcasError(f"{type(each).__name__} {each.name}: its low limit {at.low:.4g} is above the high "
                                 f"one, {at.high:.4g}")
            if not read.intersection(each.names):
                raise EmcasError(f"{type(each).__name__} {each.name}: no derivative depends on u.{each.name}; use it "
                                 "in a derivative, or remove the discontinuity")
        for body in self._bodies:
            _, limit = body.angle_and_limit(ops, p, x, u)
            if body.stop is not None and not limit > 0.0:
                raise EmcasError(f"Stop of {body.stop.angle}: its limit is {limit:.4g}; it must be above 0")
            if body.stop is not None and not isclose(rates[body.stop.angle], getattr(x, body.rate), rel_tol=_LINEAR):
                raise EmcasError(f"Stop of {body.stop.angle}: the derivative of that state must be {body.rate}")
            if body.friction is not None:
                self._check_friction(ops, p, x, u, body.rate, body.friction)

    def _check_friction(self, ops: Ops, p: Any, x: Record, u: Record, rate: str, friction: Coulomb) -> None:
        """Raise EmcasError for a torque below 0, a breakaway ratio below 1, and derivatives that are not linear in the
        friction, do not fall with it, or depend on it although they are not those of `rate`."""
        name = friction.name
        if (torque := _value(friction.torque, ops, p, x, u)) < 0.0:
            raise EmcasError(f"Coulomb {name}: its torque is {torque:.4g}; it must be 0 or above")
        if (ratio := _value(friction.breakaway, ops, p, x, u)) < 1.0:
            raise EmcasError(f"Coulomb {name}: its breakaway is {ratio:.4g}; it must be 1 or above, a ratio to torque")
        probe = 1.0 + torque  # the effect of a torque near 0 would be lost in rounding
        free, above, below = (self._derivatives(ops, p, x, _with(u, {**self._no_friction, name: value}))
                              for value in (0.0, probe, -probe))
        change = above[rate] - free[rate]
        if change >= 0.0:
            raise EmcasError(f"Coulomb {name}: the derivative of {rate} must fall with u.{name}, which opposes "
                             "positive motion: subtract it there")
        if abs(above[rate] + below[rate] - 2.0 * free[rate]) > _LINEAR * abs(change):
            raise EmcasError(f"Coulomb {name}: the derivative of {rate} must be linear in u.{name}")
        if other := [each for each in free if each != rate and above[each] != free[each]]:
            raise EmcasError(f"Coulomb {name}: the derivative of {other[0]} also depends on u.{name}; for "
                             "friction of rigidly coupled bodies declare a step function instead of discontinuities")

    def _mode(self, ops: Ops, p: Any, x: Record, u: Record, h: Value) -> Record:
        u, limits = self._limited(ops, p, x, u)
        rates, bodies = self._free(ops, p, x, u), {}
        for body in self._bodies:
            acceleration = rates[body.rate]
            deceleration, _, breakaway = self._friction(ops, p, x, u, body, acceleration)
            angle, limit = body.angle_and_limit(ops, p, x, u)
            slide = stick.slide(ops, getattr(x, body.rate), acceleration, deceleration * breakaway, angle, limit)
            # Without friction only a stop holds a body.
            holds = ops.either(deceleration > 0.0, ops.fabs(angle) >= limit)
            bodies[body.rate] = slide, ops.both(ops.equal(slide.direction, 0.0), holds)
        return Record(sides={name: at.side for name, at in limits.items()}, bodies=bodies)

    def _acting(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Any:
        """Return the plant inputs with all values that derivatives read in a mode."""
        u, _ = self._limited(ops, p, x, u, m)
        directions = {rate: slide.direction for rate, (slide, _) in m.bodies.items()}
        return _with(u, {body.friction.name: directions[body.rate] * _value(body.friction.torque, ops, p, x, u)
                         for body in self._bodies if body.friction is not None})

    def _rates(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Values:
        rates = self._derivatives(ops, p, x, self._acting(ops, p, x, u, m))
        return {**rates, **{rate: ops.where(rests, 0.0, rates[rate]) for rate, (_, rests) in m.bodies.items()}}

    def _margins(self, ops: Ops, p: Any, x: Record, u: Record, m: Record) -> Values:
        u, limits = self._limited(ops, p, x, u, m)
        margins = {}
        for name, (value, low, high, side) in limits.items():
            margins[f"{name} high"] = ops.where(side > 0.0, value - high, high - value) + _widening(ops, high)
            margins[f"{name} low"] = ops.where(side < 0.0, low - value, value - low) + _widening(ops, low)
        rates = self._free(ops, p, x, u)
        for body in self._bodies:
            slide, rests = m.bodies[body.rate]
            # A sliding body comes to rest where this margin is 0; for a body that starts in this step it begins at 0.
            slides = 1.0 if body.friction is None else ops.where(
                ops.equal(slide.direction, 0.0), 1.0, slide.direction * getattr(x, body.rate))
            if body.friction is not None and callable(body.friction.torque):  # the holding torque may change in a step
                deceleration, _, breakaway = self._friction(ops, p, x, u, body, rates[body.rate])
                high, low = stick.holding(ops, deceleration * breakaway, *body.angle_and_limit(ops, p, x, u))
                slide = slide._replace(high=high, low=low)
            margins[body.rate] = ops.where(rests, stick.reserve(ops, slide, rates[body.rate]), slides)
            if body.stop is not None:
                angle, limit = body.angle_and_limit(ops, p, x, u)
                margins[body.stop.angle] = ops.where(rests, 1.0, limit - ops.fabs(angle))
        return margins

    def _landed(self, ops: Ops, p: Any, begin: Record, x: Record, u: Record, m: Record, events: Values) -> Values:
        if any(body.stop is not None and callable(body.stop.limit) for body in self._bodies):
            u, _ = self._limited(ops, p, x, u, m)  # a stop's limit may read the values of limits and gaps
        landed = {}
        for body in self._bodies:
            slide, rests = m.bodies[body.rate]
            speed, moves, back = getattr(x, body.rate), ops.negate(rests), False
            if body.friction is not None:
                started = ops.both(moves, ops.negate(ops.equal(slide.direction, 0.0)))
                back = ops.both(started, stick.nowhere(ops, slide, getattr(begin, body.rate), speed))
                speed = ops.where(ops.either(back, ops.both(moves, events[body.rate])), 0.0, speed)
            if body.stop is not None:
                angle, limit = body.angle_and_limit(ops, p, x, u)
                beyond = ops.both(ops.fabs(angle) >= limit, angle * speed > 0.0)
                met = ops.both(moves, ops.either(events[body.stop.angle], beyond))
                inside = ops.where(met, ops.where(angle > 0.0, limit, -limit), ops.clip(angle, -limit, limit))
                landed[body.stop.angle] = ops.where(back, getattr(begin, body.stop.angle), inside)
                speed = ops.where(met, 0.0, speed)
            landed[body.rate] = speed
        return landed


def _reading(u: Any) -> tuple[Any, set[str]]:
    """Return inputs that record which of their names are read, and the set of these names."""
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
            remedy = "only the narrower stop" if isinstance(each, Stop) else "one friction with the sum of the torques"
            raise EmcasError(f"{type(each).__name__} of {each.rate} is listed twice; list {remedy}")
        by_rate[each.rate] = each
    return by_rate


def _with(u: Any, values: Mapping[str, Value]) -> Any:
    return type(u)(**{**vars(u), **values})

"""One flight: rocket, autopilot and actuators, stepped together.

In each communication step H from t to t + H:
  1. at multiples of 4 ms the autopilot reads the state at t and sets the commands until its next sample;
  2. the actuators step by H with the commands, and with hinge moments and vehicle motion at t held;
  3. JSBSim steps by H and evaluates its forces with the fin angles at t + H.
Hinge moments and motion are up to H old at the fins, an error of first order in H; JSBSim's integration has an error of
second order. convergence.py measures their sum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from emcas_fmu.errors import EmcasError

from .actuators import Actuators, Demand
from .autopilot import PERIOD, Autopilot, Gains
from .vehicle import FINS, Array, Launch, Rocket

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Turn:
    """A change of the wanted roll, pitch, yaw by `change` [deg], from `start` [s] over `duration` [s] (0: at once)."""

    start: float
    change: tuple[float, float, float]
    duration: float = 0.0


@dataclass(frozen=True)
class Gust:
    """Wind in the shape of 1 - cosine, from `start` [s] for `duration` [s], up to `peak` [m/s] north, east, down."""

    start: float
    duration: float
    peak: tuple[float, float, float]


@dataclass(frozen=True)
class Manoeuvre:
    """A flight's launch, `duration` [s], wanted turns, gusts and autopilot gains."""

    name: str
    title: str
    duration: float
    turns: tuple[Turn, ...]
    gusts: tuple[Gust, ...] = ()
    gains: Gains = Gains()  # noqa: RUF009 - frozen
    launch: Launch = Launch()  # noqa: RUF009 - frozen

    def hinged(self, hinge: float) -> Manoeuvre:
        """Return the manoeuvre with the fins' hinges at a share of the chord."""
        if hinge == self.launch.hinge:
            return self
        return replace(self, title=f"{self.title}; hinges at {100.0 * hinge:g} % of the chord",
                       launch=replace(self.launch, hinge=hinge))

    def wanted(self, time: float, begin: Array) -> Array:
        """Return the wanted roll, pitch, yaw [rad] at a time [s], for `begin` at launch; shape (3,)."""
        wanted: Array = begin.copy()
        for turn in self.turns:
            if time >= turn.start - 1e-9:
                done = min((time - turn.start) / turn.duration, 1.0) if turn.duration else 1.0
                wanted += np.radians(turn.change) * 0.5 * (1.0 - np.cos(pi * done))
        return wanted

    def wind(self, time: float) -> Array:
        """Return the wind [m/s] north, east, down at a time [s]; shape (3,)."""
        wind = np.zeros(3)
        for gust in self.gusts:
            share = (time - gust.start) / gust.duration
            if 0.0 < share < 1.0:
                wind += np.array(gust.peak) * 0.5 * (1.0 - np.cos(2.0 * pi * share))
        return wind


GENTLE = Manoeuvre(
    "gentle", "Gentle: smooth turns of 2 deg in pitch and yaw, 10 deg in roll, a gust of 6 m/s", 6.0,
    (Turn(0.5, (0, 2, 0), 0.8), Turn(1.8, (0, 0, 2), 0.8), Turn(3.0, (10, 0, 0), 0.8)),
    (Gust(4.2, 0.8, (6.0, 0.0, 0.0)),))
AGGRESSIVE = Manoeuvre(
    "aggressive", "Aggressive: steps of up to 20 deg in pitch and yaw with 60 deg of roll, a gust of 30 m/s", 6.0,
    (Turn(0.5, (0, 15, 0)), Turn(1.5, (60, 0, 12)), Turn(3.0, (-60, -20, -20)), Turn(5.0, (0, 5, 8))),
    (Gust(4.2, 0.3, (30.0, 0.0, 0.0)),))
TIGHT = replace(AGGRESSIVE, name="tight",
                title="Aggressive, with higher autopilot gains, which are stable with ideal fins",
                gains=Gains((180.0, 350.0, 350.0), (21.0, 28.0, 28.0), (50.0, 2000.0, 2000.0)))
MANOEUVRES = {m.name: m for m in (GENTLE, AGGRESSIVE, TIGHT)}

NAMES = (*(f"{n}_rad" for n in ("roll", "pitch", "yaw")), *(f"wanted_{n}_rad" for n in ("roll", "pitch", "yaw")),
         *(f"{n}_rad_s" for n in "pqr"), *(f"command{k}_rad" for k in FINS), *(f"fin{k}_rad" for k in FINS),
         *(f"fin_rate{k}_rad_s" for k in FINS), *(f"hinge{k}_n_m" for k in FINS),
         *(f"saturated{k}" for k in FINS), "power_w", "mach", "dynamic_pressure_pa", "altitude_m", "speed_m_s",
         "incidence_rad", *(f"acceleration_{n}_m_s2" for n in "xyz"), "bus_voltage_v", "bus_current_a",
         "line_pressure_pa", "line_flow_m3_s")


def fly(actuators: Actuators, manoeuvre: Manoeuvre, step: float,
        progress: Progress | None = None) -> Mapping[str, Array]:
    """Return the columns `time` [s] and NAMES of a flight, with a row for each communication point after the first.

    Columns of bus and pressure line are left out if the actuators have none. Raises EmcasError if the step [s] does not
    divide the autopilot's period.
    """
    ratio = PERIOD / step if step > 0.0 else 0.0
    every = round(ratio)
    if every < 1 or abs(ratio - every) > 1e-9 * every:
        raise EmcasError(f"a communication step of {step * 1e3:g} ms does not divide the autopilot's "
                         f"{PERIOD * 1e3:g} ms; choose 4, 2, 1, 0.5 ms ...")
    rocket, autopilot = Rocket(step, manoeuvre.launch), Autopilot(manoeuvre.gains)
    state = rocket.state()
    begin = state.attitude
    rows = round(manoeuvre.duration / step)
    table = np.empty((rows, len(NAMES)))
    for row in range(rows):
        time = row * step
        if row % every == 0:
            wanted = manoeuvre.wanted(time, begin)
            command = autopilot.update(state, wanted)
            if progress:
                progress(time)
        moved = actuators.step(time, step, Demand(
            command.fins, state.hinge_moments, state.acceleration, state.attitude, state.body_rates,
            state.angular_acceleration, command.axes))
        state = rocket.advance(moved.angles, manoeuvre.wind(time + step))
        table[row] = np.concatenate([
            state.attitude, wanted, state.body_rates, command.fins, moved.angles, moved.rates, state.hinge_moments,
            moved.saturated, [moved.power, state.mach, state.dynamic_pressure, state.altitude, state.speed,
                              state.incidence], state.acceleration,
            [moved.bus_voltage, moved.bus_current, moved.line_pressure, moved.line_flow]])
    columns = dict(zip(NAMES, table.T, strict=True))
    return {"time": np.arange(1, rows + 1) * step, **{n: c for n, c in columns.items() if not np.isnan(c).all()}}

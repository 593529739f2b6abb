"""One flight: rocket, autopilot and actuators stepped together.

Coupling, in each communication step H from t to t + H:
  1. at multiples of 4 ms the autopilot reads the state at t and sets commands, held until its next sample;
  2. the actuators do a step H with the commands, and with hinge moments and the vehicle's motion of time t held;
  3. JSBSim does a step H and evaluates its forces with the fin angles of t + H.
Hinge moment and motion that the fins feel are thus up to H old: an error of first order in H, beside JSBSim's own
of second order. convergence.py measures both.
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
    """From `start` [s] the wanted roll, pitch, yaw change by `change` [deg] over `duration` [s] (0: at once)."""

    start: float
    change: tuple[float, float, float]
    duration: float = 0.0


@dataclass(frozen=True)
class Gust:
    """Wind from `start` [s] for `duration` [s] up to `peak` [m/s] north, east, down, as 1 - cosine."""

    start: float
    duration: float
    peak: tuple[float, float, float]


@dataclass(frozen=True)
class Manoeuvre:
    """What is flown."""

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
        """Roll, pitch, yaw [rad] wanted at a time [s], shape (3,)."""
        wanted: Array = begin.copy()
        for turn in self.turns:
            if time >= turn.start - 1e-9:
                done = min((time - turn.start) / turn.duration, 1.0) if turn.duration else 1.0
                wanted += np.radians(turn.change) * 0.5 * (1.0 - np.cos(pi * done))
        return wanted

    def wind(self, time: float) -> Array:
        """North, east, down [m/s], shape (3,)."""
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
                title="Aggressive, with an autopilot of higher gains, good if the fins stood at their commands",
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
    """Columns `time` [s] and NAMES, one row for each communication point after the first; shape (duration / step,).

    Those of bus and pressure line are left out where the actuators have none.
    Raises EmcasError where the step [s] does not divide the autopilot's period.
    """
    ratio = PERIOD / step if step > 0.0 else 0.0
    every = round(ratio)
    if every < 1 or abs(ratio - every) > 1e-9 * every:
        raise EmcasError(f"a communication step of {step * 1e3:g} ms does not divide the autopilot's "
                         f"{PERIOD * 1e3:g} ms; take 4, 2, 1, 0.5 ms ...")
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

"""Convergence of the trajectory with the communication step, against a flight with a much finer step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .actuators import Actuators
from .autopilot import PERIOD
from .flight import Manoeuvre, fly
from .vehicle import FINS, Array

STEPS = (4e-3, 2e-3, 1e-3, 0.5e-3, 0.25e-3)  # s
REFERENCE = 0.0625e-3  # s, a quarter of the finest step: a first-order error of the finest is too small by a quarter
_ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")


@dataclass(frozen=True)
class Convergence:
    """Largest differences from the flight with REFERENCE at the autopilot's samples, by `steps` [s].

    `attitude` [deg] is that of roll, pitch and yaw, `fins` [deg] that of the four fin angles; arrays [steps].
    """

    steps: Array
    attitude: Array
    fins: Array

    def order(self, errors: Array) -> float | None:
        """Return the exponent p of errors ~ steps^p - REFERENCE^p, by least squares of logarithms.

        Returns None if errors do not decrease with the step. REFERENCE^p is the error of the reference itself: without
        it the slope would be steeper than the order.
        """
        if np.any(np.diff(errors) >= 0.0):
            return None
        trials = np.linspace(0.3, 3.0, 2701)
        shapes = np.log(self.steps[:, None]**trials - REFERENCE**trials)
        return float(trials[np.argmin(np.var(np.log(errors)[:, None] - shapes, axis=0))])


def measure(make: Callable[[], Actuators], manoeuvre: Manoeuvre, steps: Sequence[float] = STEPS,
            progress: Callable[[float], None] | None = None) -> Convergence:
    """Fly with each step [s] and with REFERENCE; `progress` is called with the share of the work that is done."""
    work = np.cumsum([1.0 / h for h in (*steps, REFERENCE)])
    flights = []
    for k, step in enumerate((*steps, REFERENCE)):
        actuators = make()
        try:
            flight = fly(actuators, manoeuvre, step)
        finally:
            actuators.close()
        rows = slice(round(PERIOD / step) - 1, None, round(PERIOD / step))
        flights.append([np.degrees([flight[name][rows] for name in names])
                        for names in (_ATTITUDE, [f"fin{n}_rad" for n in FINS])])
        if progress:
            progress(float(work[k] / work[-1]))
    attitude, fins = (np.array([np.max(np.abs(flown[n] - flights[-1][n])) for flown in flights[:-1]]) for n in (0, 1))
    return Convergence(np.array(steps), attitude, fins)

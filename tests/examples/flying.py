"""Short flights for tests. `python flying.py SSP MASTER` prints a flight in a master as CSV.

The exit code is 77 if the master is not installed.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from examples.jsbsim.actuators import Actuators
from examples.jsbsim.flight import Gust, Manoeuvre, Turn, fly
from examples.jsbsim.masters import MASTERS, VARIANT, InMaster
from examples.jsbsim.results import fins
from examples.jsbsim.vehicle import Array

ABSENT = 77
SHORT = Manoeuvre("short", "Steps in three axes and a gust", 0.6, (Turn(0.02, (20, 8, -8)),),
                  (Gust(0.3, 0.2, (20.0, 0.0, 0.0)),))


def flown(actuators: Actuators, manoeuvre: Manoeuvre = SHORT, step: float = 1e-3) -> Mapping[str, Array]:
    """Return a flight with a communication step [s], and close the actuators."""
    try:
        return fly(actuators, manoeuvre, step)
    finally:
        actuators.close()


def apart(first: Mapping[str, Array], second: Mapping[str, Array]) -> float:
    """Return the largest difference [rad] between the fin angles of two flights."""
    return float(np.abs(fins(first, "fin{}_rad") - fins(second, "fin{}_rad")).max())


def main(ssp: str, master: str) -> None:
    """Print the flight as CSV."""
    try:
        __import__(MASTERS[master])
    except (ImportError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    flight = flown(InMaster(Path(ssp), master, 1e-3, VARIANT))
    print(",".join(flight))
    for row in zip(*flight.values(), strict=True):
        print(",".join(repr(float(value)) for value in row))


if __name__ == "__main__":
    main(*sys.argv[1:])

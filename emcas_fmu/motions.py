"""The kinds of excitation: their fields, with units, limits and defaults, and their command and torque.

Files, the explorer and the reference cases use these names, units and limits. Campaigns accept every kind that moves
the command, baselines those that jump or sweep. Requirements accept those that jump, and tests with fields of their own
(``TESTS`` in bench/measure.py). A new kind is an entry of EXCITATIONS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import log, pi, radians
from typing import Annotated, Any, NamedTuple

import numpy as np

from .parameters.schema import In, kind_of
from .simulation import Array

STEP = 1e-3  # s, time between rows of inputs and outputs
LEAD_IN = 0.05  # s, time at rest before a motion
SETTLE = 1.0  # s, time without load before a slew: ten times the settling time of the default actuator at 20 deg
LOAD_RISE = 0.02  # s, time in which the torque rises; a jump would be an impact
RATED = 100.0  # N.m, the load of the thesis's Table 2
SWEEP = 0.5, 30.0  # Hz, first and last frequency
FASTEST = 0.5 / STEP  # Hz, the highest frequency that rows can represent
LONGEST_MOTION = 300.0  # s, longest motion in a file; its rows need half a gigabyte in a campaign
OLD_WORDS: Mapping[str, str] = {"chirp": "sweep"}
"""Names of kinds in older files, with the present names."""


@dataclass(frozen=True)
class Field(In):
    """A field of an excitation: its unit, limits, title and default value, and whether 0 is refused."""

    title: str = ""
    default: float | None = None
    nonzero: bool = False

    def limited(self, written: Any) -> float:
        """Return the value of an entry [unit].

        Raises ValueError beyond the limits, for 0 if it is refused, and for a time that is not a whole number of ms.
        """
        value = float(super().limited(written))
        if self.nonzero and not value:
            raise ValueError(f"must not be 0; give another {self.title.lower()}")
        if self.unit == "s" and abs(value / STEP - round(value / STEP)) > 1e-9:
            raise ValueError("must be a whole number of milliseconds")
        return value

    @property
    def definition(self) -> tuple[Any, Any]:
        """The field in pydantic's model of a table: its type, and its default value if it has one."""
        return Annotated[float, self], ... if self.nonzero or self.default is None else self.default

    def within(self, longest: float) -> Field:
        """Return the field with times of at most `longest` [s]."""
        return replace(self, maximum=min(longest, self.maximum)) if self.unit == "s" else self


FIELDS: Mapping[str, Field] = {
    "amplitude": Field("rad", -pi, pi, title="Amplitude of the command"),
    "frequency": Field("Hz", 1e-3, FASTEST, title="Frequency", default=5.0),
    "low": Field("Hz", 1e-3, FASTEST, title="Lowest frequency", default=SWEEP[0]),
    "high": Field("Hz", 1e-3, FASTEST, title="Highest frequency", default=SWEEP[1]),
    "torque": Field("N.m", -1e6, 1e6, title="Torque on the hinge", default=0.0),
    "duration": Field("s", 0.01, LONGEST_MOTION, title="Duration"),
    "settle": Field("s", STEP, LONGEST_MOTION, title="Time at the starting end", default=SETTLE)}
"""The fields of excitations. The amplitude is a fin angle; the duration counts from the beginning of the motion."""


class ExcitationKind(NamedTuple):
    """A kind of excitation: its title, and a format of its description for the command's `size` [deg] and its fields.

    `share` computes the ratio of command to amplitude from times [s] since the beginning of the motion (negative before
    it) and fields by name. A campaign requires the fields in `shape`; `options` are optional. The torque rises within
    `rise` [s] after the beginning; with None it is constant. Responses to a kind that `jumps` have figures such as rise
    time and overshoot, those to a kind that `sweeps` have bandwidths. A kind whose `moves` is false has no amplitude.
    `usual` contains the fields' values with which a page shows the kind.
    """

    title: str
    description: str
    share: Callable[..., Array]
    shape: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    rise: float | None = None
    usual: Mapping[str, float] | None = None
    jumps: bool = False
    sweeps: bool = False
    moves: bool = True

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of all fields, in their order in files."""
        return (*(("amplitude",) if self.moves else ()), *self.shape, "duration", *self.options)

    @property
    def runs(self) -> tuple[str, ...]:
        """The kinds of run in bench/metrics.py whose figures a response has."""
        return ("jump",) * self.jumps + ("sweep",) * self.sweeps + ("rest",) * (not self.moves) + ("usage",)

    @property
    def defaults(self) -> dict[str, float]:
        """The default values of the fields in `shape`."""
        return {name: FIELDS[name].default or 0.0 for name in self.shape}

    def command(self, since: Array, amplitude: float, **fields: float) -> Array:
        """Return the command [rad] at times [s] since the beginning of the motion."""
        return amplitude * self.share(since, **{**self.defaults, **fields}) + 0.0  # no -0.0 for a negative amplitude

    def torque(self, since: Array, torque: float) -> Array:
        """Return the torque [N.m] at times [s] since the beginning of the motion."""
        if self.rise is None:
            return np.full_like(since, torque)
        return torque * (np.clip(since / self.rise, 0.0, 1.0) if self.rise else _begun(since)) + 0.0


def _begun(since: Array, step: float = STEP, **_: float) -> Array:
    """Return 1 from the beginning on, 0 before it; a row within half a step before it counts as the beginning."""
    return np.where(since > -step / 2, 1.0, 0.0)


def _side(since: Array, **_: float) -> Array:
    return 2.0 * _begun(since) - 1.0


def _sine(since: Array, frequency: float, **_: float) -> Array:
    share: Array = np.sin(2.0 * pi * frequency * np.maximum(since, 0.0))
    return share


def _sweep(since: Array, duration: float, low: float, high: float, **_: float) -> Array:
    growth = log(high / low) / duration
    share: Array = np.sin(2.0 * pi * low * np.expm1(growth * np.maximum(since, 0.0)) / growth)
    return share


EXCITATIONS: Mapping[str, ExcitationKind] = {
    "step": ExcitationKind("Step", "step to {size:+.6g} deg", _begun, options=("torque",), rise=LOAD_RISE,
                           usual={"amplitude": radians(10.0), "duration": 0.5}, jumps=True),
    "slew": ExcitationKind(
        "Slew, from − to +", "slew from {back:+.6g} to {size:+.6g} deg", _side, options=("torque", "settle"),
        rise=LOAD_RISE, usual={"amplitude": radians(20.0), "duration": 0.5}, jumps=True),
    "load": ExcitationKind(
        "Load step", "fin held at 0", lambda since, **_: np.zeros_like(since), options=("torque",), rise=0.0,
        usual={"torque": -RATED, "duration": 0.5}, moves=False),
    "sine": ExcitationKind("Sine", "sine of {size:.6g} deg at {frequency:g} Hz", _sine, shape=("frequency",),
                           usual={"amplitude": radians(1.0), "duration": 1.0}),
    "sweep": ExcitationKind("Sweep", "sine sweep of {size:.6g} deg", _sweep, shape=("low", "high"),
                            usual={"amplitude": radians(1.0), "duration": 12.0}, sweeps=True),
    "hold": ExcitationKind("Hold", "hold at {size:+.6g} deg", lambda since, **_: np.ones_like(since)),
}
MOTIONS: Mapping[str, ExcitationKind] = {name: kind for name, kind in EXCITATIONS.items() if kind.moves}
"""The kinds that move the command."""


def motion_in(table: Any) -> str:
    """Return the kind of motion that a file's table names. Raises ValueError or ValidationError for another kind."""
    if isinstance(table, Mapping) and table.get("kind") in tuple(OLD_WORDS):
        return OLD_WORDS[table["kind"]]
    return kind_of(table, MOTIONS)

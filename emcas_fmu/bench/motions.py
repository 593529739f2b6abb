"""The kinds of motion that files name: the fields of each with their units, and the excitation that it is.

Campaigns accept every kind of KINDS, baselines and requirements those that jump or sweep: a further kind is one entry.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pydantic import create_model

from ..parameters.schema import Table, kind_of
from ..reference.cases import LEAD_IN, SWEEP
from .excitation import SETTLE, Excitation, sine_from_rest, slew_to, staircase, step_to, sweep

UNITS: Mapping[str, str] = {"amplitude": "rad", "duration": "s", "frequency": "Hz", "low": "Hz", "high": "Hz",
                            "torque": "N.m", "settle": "s"}
"""The unit of each field; angles are those of the fin, torques are about its hinge."""
OLD_WORDS: Mapping[str, str] = {"chirp": "sweep"}
"""Kinds by the words that older files have for them."""


class Kind(NamedTuple):
    """A kind of motion.

    `make` returns the excitation for `amplitude` [rad], `duration` [s] after the command, and the fields in `shape`,
    which a campaign needs, and in `options`. Its command must be proportional to the amplitude. A kind that `jumps` is
    measured by rise time, overshoot and the like, one that `sweeps` by bandwidths.
    """

    make: Callable[..., Excitation]
    shape: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    jumps: bool = False
    sweeps: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        """All fields, in the order in which files have them."""
        return ("amplitude", *self.shape, "duration", *self.options)


def _step(amplitude: float, duration: float, torque: float = 0.0) -> Excitation:
    return step_to(amplitude, duration, torque)


def _slew(amplitude: float, duration: float, torque: float = 0.0, settle: float = SETTLE) -> Excitation:
    return slew_to(amplitude, duration, torque, settle)


def _hold(amplitude: float, duration: float) -> Excitation:
    return staircase((amplitude, amplitude), (LEAD_IN, duration))


def _sine(amplitude: float, duration: float, frequency: float) -> Excitation:
    return sine_from_rest(amplitude, frequency, duration)


def _sweep(amplitude: float, duration: float, low: float = SWEEP[0], high: float = SWEEP[1]) -> Excitation:
    return sweep(amplitude, duration, low, high)


KINDS: Mapping[str, Kind] = {
    "step": Kind(_step, options=("torque",), jumps=True),
    "slew": Kind(_slew, options=("torque", "settle"), jumps=True),
    "sine": Kind(_sine, shape=("frequency",)),
    "sweep": Kind(_sweep, shape=("low", "high"), sweeps=True),
    "hold": Kind(_hold),
}


def motion(kind: str, amplitude: float, duration: float, **fields: float) -> Excitation:
    """Return the excitation of a kind of motion, its fields in SI."""
    return KINDS[kind].make(amplitude, duration, **fields)


def kind_in(table: Any) -> str:
    """Return the kind of motion that a table of a file names. Raises ValueError or ValidationError."""
    if isinstance(table, Mapping) and table.get("kind") in tuple(OLD_WORDS):
        return OLD_WORDS[table["kind"]]
    return kind_of(table, KINDS)


def schema(kind: str, types: Mapping[str, Any], base: type[Table] = Table, **more: Any) -> type[Any]:
    """Return the model of a table for a kind of motion.

    `types` are the pydantic definitions, type and default, of those fields that a study reads; `more` are those of
    further entries.
    """
    fields = {name: types[name] for name in KINDS[kind].fields if name in types}
    return create_model(kind, __base__=base, kind=(str, ...), **fields, **more)

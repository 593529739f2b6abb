"""A baseline's cases: what is commanded, as rows of inputs 1 ms apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees, log, pi, radians
from pathlib import Path
from typing import Any

import numpy as np

from ..bench.excitation import SETTLE, Excitation, csv_file, reference_case
from ..errors import EmcasError
from ..reference.cases import LEAD_IN, LOAD_RISE, SWEEP

STEP = 1e-3  # s
LONGEST = 60.0  # s: fmpy's time for a run grows with the square of its length
# Entries of each kind of case, with the unit they are kept in; all but those of OPTIONAL have to be there.
KINDS: Mapping[str, Mapping[str, str]] = {
    "step": {"command": "deg", "torque": "N.m", "duration": "s"},
    "slew": {"command": "deg", "torque": "N.m", "duration": "s"},
    "sweep": {"command": "deg", "duration": "s"},
    "reference": {},
    "file": {},
}
OPTIONAL: Mapping[str, float] = {"torque": 0.0}
SOURCE = {"reference": "case", "file": "file"}
"""The entry that says where the inputs of such a case come from."""


@dataclass(frozen=True)
class Case:
    """One excitation. `entries` are those of its kind, in the units of KINDS; `source` a reference case or a CSV file.

    `start` are values of parameters that differ in this case, in the variable table's units.
    """

    name: str
    kind: str
    entries: Mapping[str, float]
    source: str = ""
    start: Mapping[str, float] = field(default_factory=dict)

    def excitation(self, folder: Path) -> Excitation:
        """Inputs, SI; a CSV file is looked for beside the baseline in `folder`. Raises EmcasError."""
        if self.kind == "reference":
            try:
                found = reference_case(self.source, exact=False)
            except EmcasError as error:
                raise EmcasError(f"{folder / 'baseline.toml'}: case.{self.name}.case: {error}") from error
            return self._made(found.columns, found.step, {**found.start_values, **self.start})
        if self.kind == "file":
            path = Path(self.source)
            found = csv_file(path if path.is_absolute() else folder / path)
            if found.stop > LONGEST:
                raise EmcasError(f"{path}: lasts {found.stop:g} s; a baseline's case may last {LONGEST:g} s")
            return self._made(found.columns, found.step, self.start)
        build = {"step": _step, "slew": _slew, "sweep": _sweep}[self.kind]
        return self._made(build(**self.entries), STEP, self.start)

    def _made(self, columns: Mapping[str, Any], step: float, start: Mapping[str, Any]) -> Excitation:
        return Excitation(self.title, columns, self.begin, step, start)

    @property
    def title(self) -> str:
        """What is done, in a few words."""
        of = self.entries
        load = f" with {of['torque']:+g} N.m" if of.get("torque") else ""
        what = {"step": lambda: f"step to {of['command']:+g} deg{load}",
                "slew": lambda: f"slew from {-of['command']:+g} to {of['command']:+g} deg{load}",
                "sweep": lambda: f"sine sweep of {of['command']:g} deg",
                "reference": lambda: f"reference case {self.source}",
                "file": lambda: f"inputs of {self.source}"}[self.kind]()
        return what + "".join(f", {name} {value:g}" for name, value in self.start.items())

    @property
    def begin(self) -> float:
        """When the motion that is judged begins [s]."""
        return SETTLE if self.kind == "slew" else LEAD_IN


def _time(duration: float) -> Any:
    return np.arange(round(duration / STEP) + 1) * STEP


def _step(command: float, duration: float, torque: float = 0.0) -> dict[str, Any]:
    """From rest to `command` [deg], `torque` [N.m] with it."""
    after = _time(LEAD_IN + duration) > LEAD_IN - STEP / 2
    return {"fin_command": np.where(after, radians(command), 0.0), "aero_torque": np.where(after, torque, 0.0)}


def _slew(command: float, duration: float, torque: float = 0.0) -> dict[str, Any]:
    """From -`command` to `command` [deg] while `torque` [N.m] comes on."""
    time = _time(SETTLE + duration)
    sign = np.where(time > SETTLE - STEP / 2, 1.0, -1.0)
    sign[0] = 0.0
    return {"fin_command": sign * radians(command),
            "aero_torque": torque * np.clip((time - SETTLE) / LOAD_RISE, 0.0, 1.0)}


def _sweep(command: float, duration: float) -> dict[str, Any]:
    """Logarithmic sine sweep of amplitude `command` [deg]."""
    first, last = SWEEP
    growth = log(last / first) / duration
    since = np.maximum(_time(LEAD_IN + duration) - LEAD_IN, 0.0)
    return {"fin_command": radians(command) * np.sin(2.0 * pi * first * np.expm1(growth * since) / growth)}


def level(excitation: Excitation) -> float:
    """The last command [deg]."""
    return degrees(float(excitation.columns["fin_command"][-1]))

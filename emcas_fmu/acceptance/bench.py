"""The bench every test is run on: the article, what it is rated for, and runs that several tests share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees, radians

import numpy as np

from ..errors import EmcasError
from ..excitation import Excitation
from ..reference.cases import CASES, LOAD
from ..validation import requirements
from ..validation.results import Series
from ..validation.runs import Columns, Run
from .article import Article
from .outcome import Array

STEP = 1e-3  # s
STEP_AT = requirements.STEP_AT  # s
HOLD = requirements.HOLD  # s
_TINY = 1e-9  # deg, of a size that is the limit but for rounding


class StoppedError(EmcasError):
    """The article did not run to the end."""


@dataclass(frozen=True)
class Bench:
    """`load` is the rated hinge moment [N.m]; `mission` replaces the synthetic mission profile."""

    article: Article
    load: float = LOAD
    mission: Excitation | None = None

    @property
    def limit(self) -> float:
        """Largest command [deg]."""
        return degrees(self.article.values["command.limit"])

    @property
    def count(self) -> float:
        """Angle at the fin [deg] of one count of the encoder, the larger over the range of commands."""
        values = self.article.values
        count = 2.0 * np.pi / (values["encoder.pulses"] * values["encoder.multiplier"])
        if values["encoder.on_fin"]:
            return degrees(count)
        # Least reduction ratio d/(l cos^2): where the lever stands upright, or at an end of the range.
        limit, start = values["command.limit"], values["kinematics.initial_angle"]
        lever = 0.0 if abs(start) <= limit else abs(start) - limit
        return degrees(count * values["screw.lead"] / values["kinematics.moment_arm"] * np.cos(lever) ** 2)

    def sizes(self, wanted: tuple[float, ...]) -> list[float]:
        """Those of `wanted` [deg] the range of commands allows, and its end."""
        limit = round(self.limit, 9)
        return [size for size in wanted if size < limit - _TINY] + [limit]

    def run(self, inputs: Columns, step: float = STEP) -> Columns:
        """The response's columns. Raises StoppedError where it ends early."""
        return finished(self.article.run(inputs, step))

    @cached_property
    def table2(self) -> Mapping[str, Series]:
        """The runs the requirements of Table 2 are measured from, with the parameters as they are."""
        wanted = sorted({name for r in requirements.REQUIREMENTS for name in r.needs})
        cases = {case.name: case for case in CASES}
        runs = {}
        for name in wanted:
            if name in requirements.HOLDS:
                inputs, step = step_inputs(*requirements.HOLDS[name]), STEP
            else:
                inputs, step = cases[name].inputs(), cases[name].step
            run = self.article.run(inputs, step)
            runs[name] = Series(inputs, run, {}, run)
        return runs


def finished(run: Run) -> Columns:
    """The columns of a run. Raises StoppedError, saying why, where it ended early."""
    if run.stopped is not None:
        last = run.messages[-1] if run.messages else "it gave no reason"
        raise StoppedError(f"the article went no further than {run.stopped:.6g} s: {last}")
    return run.columns


def step_inputs(command: float, moment: float = 0.0, hold: float = HOLD) -> dict[str, Array]:
    """A step to `command` [deg] against a hinge moment [N.m] that comes with it, held for `hold` [s]."""
    time = np.round(np.arange(round((STEP_AT + hold) / STEP) + 1) * STEP, 9)
    after = time > STEP_AT - STEP / 2
    return {"time": time, "fin_command": np.where(after, radians(command), 0.0),
            "aero_torque": np.where(after, moment, 0.0)}

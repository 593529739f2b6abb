"""The rig: the subject, its rated load and mission, and how every test runs it."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

from ...bench.excitation import Excitation
from ...bench.runs import Run
from ...bench.subject import Subject
from ...reference.cases import LOAD

RECORDED = ("fin_angle", "fin_rate", "motor_current", "supply_power", "saturated", "at_stop")


@dataclass(frozen=True)
class Rig:
    """`load` is the rated hinge torque [N.m]; `mission` replaces the synthetic mission profile."""

    subject: Subject
    load: float = LOAD
    mission: Excitation | None = None

    @property
    def limit(self) -> float:
        """Largest command [deg]."""
        return degrees(self.subject.command_limit)

    def run(self, excitation: Excitation) -> Run:
        """Return the response. Raises StoppedError where it ends early."""
        run = self.subject.run(excitation, outputs=[name for name in RECORDED if name in self.subject.outputs])
        run.finished()
        return run

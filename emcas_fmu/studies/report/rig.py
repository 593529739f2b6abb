"""What every test is run on: the subject, what it is rated for, and runs that several tests share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, degrees, pi

from ...bench.excitation import Excitation
from ...bench.metrics import ACCURACY
from ...bench.runs import Run
from ...bench.subject import Subject
from ...reference.cases import LOAD

RECORDED = ("fin_angle", "fin_rate", "motor_current", "supply_power", "saturated", "at_stop")
_TINY = 1e-9  # deg, of a size that is the limit but for rounding


@dataclass(frozen=True)
class Rig:
    """`load` is the rated hinge moment [N.m]; `mission` replaces the synthetic mission profile."""

    subject: Subject
    load: float = LOAD
    mission: Excitation | None = None

    @property
    def limit(self) -> float:
        """Largest command [deg]."""
        return degrees(self.subject.command_limit)

    @cached_property
    def count(self) -> float:
        """The smallest motion that counts [rad]: a count of the encoder at the fin, the larger over the commands.

        Of an actuator without encoder and screw a hundredth of the accuracy of Table 2.
        """
        values = self.subject.values
        if not {"encoder.pulses", "encoder.multiplier", "encoder.on_fin"} <= values.keys():
            return ACCURACY / 100.0
        count = float(2.0 * pi / (values["encoder.pulses"] * values["encoder.multiplier"]))
        if values["encoder.on_fin"]:
            return count
        if not {"screw.lead", "kinematics.moment_arm", "kinematics.initial_angle"} <= values.keys():
            return ACCURACY / 100.0
        # Least reduction ratio d/(l cos^2): where the lever stands upright, or at an end of the range.
        limit, start = self.subject.command_limit, values["kinematics.initial_angle"]
        lever = 0.0 if abs(start) <= limit else abs(start) - limit
        return float(count * values["screw.lead"] / values["kinematics.moment_arm"] * cos(lever) ** 2)

    def sizes(self, sizes: tuple[float, ...]) -> list[float]:
        """Return those of the `sizes` [deg] that the range of commands allows, and its end."""
        limit = round(self.limit, 9)
        return [size for size in sizes if size < limit - _TINY] + [limit]

    def run(self, excitation: Excitation) -> Run:
        """Return the response. Raises StoppedError where it ends early."""
        run = self.subject.run(excitation, outputs=[name for name in RECORDED if name in self.subject.outputs])
        run.finished()
        return run

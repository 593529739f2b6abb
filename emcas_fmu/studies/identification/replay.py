"""Replay records: simulate an actuator with measured inputs, and compare its outputs with the measured outputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import product
from math import degrees, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from ...bench.excitation import Excitation
from ...bench.subject import ParameterSubject
from ...errors import EmcasError, hint
from ...fmi.units import display
from ...parameters import ParameterSet
from ...units import factor
from ...variables import Variable
from .estimation import Stretches
from .records import Array, RecordFile, read_records, require
from .unknowns import Unknown, nuisance

_ANGLE, _START = "fin_angle", "fin.start_angle"
_LATEST = 0.02  # [s] largest delay of a measured output
_FAILED = 1e3  # error of a simulation that fails, in standard deviations of the measurement
_SMOOTH: Mapping[str, Any] = {"encoder.enabled": False, "transducer.resolution": 0.0}  # switch quantisation off
_ALIKE = 0.8  # similarity (difflib) from which a name may be a misspelling of another
_MOST = 20_000_000  # most output values simulated at once: 160 MB
_FIRST = 10  # rows from which the initial fin rate is estimated
_CERTAIN, _MOVING = 6.0, 0.1  # smallest reported initial rate: in sigmas, and as a share of the fastest rate
_COPIES, _SPREAD = 8, 1e-4  # initial angles whose mean response is compared: number; range as a share of command.limit


@dataclass(frozen=True)
class ReplayedOutput:
    """An output of a record, measured and simulated [display unit], and whether the record was held out."""

    record: RecordFile
    variable: Variable
    held_out: bool
    measured: Array
    simulated: Array

    @property
    def unit(self) -> str:
        """Unit of the arrays and figures."""
        return display(self.variable) or self.variable.unit

    @property
    def use(self) -> str:
        """The use of the record: fitted or held out."""
        return "held out" if self.held_out else "fitted"

    @property
    def constant(self) -> bool:
        """Whether all measured values are equal."""
        return not np.ptp(self.measured)

    @property
    def unexplained(self) -> float:
        """Ratio of rms error without white noise (from neighbours' differences) to measured deviation; constant: 0."""
        error = self.simulated - self.measured
        power = float(np.mean(error**2) - 0.5 * np.mean(np.diff(error) ** 2))
        return 0.0 if self.constant else sqrt(max(power, 0.0)) / float(np.std(self.measured))

    @property
    def figures(self) -> dict[str, float | None]:
        """Root mean square, mean magnitude and largest magnitude of the error [`unit`], and the fit [%].

        The fit is 100 (1 - |y - y_m| / |y - mean y|) as in Ljung (1999), section 16.4; None if y is constant.
        """
        error = self.simulated - self.measured
        spread = float(np.linalg.norm(self.measured - self.measured.mean()))
        return {"rms": float(np.sqrt(np.mean(error**2))), "mean_abs": float(np.mean(np.abs(error))),
                "largest": float(np.abs(error).max()),
                "fit_percent": 100.0 * (1.0 - float(np.linalg.norm(error)) / spread) if not self.constant else None}

    @property
    def fit(self) -> str:
        """The fit [%] as text, or the word constant."""
        return "constant" if self.constant else f"{self.figures['fit_percent']:.1f}"


def read(paths: Sequence[Path], base: ParameterSet,
         compare: Sequence[str] = ()) -> tuple[list[RecordFile], list[Variable]]:
    """Return records of the actuator's inputs and outputs, and the outputs to compare (default: those in all records).

    Raises RecordError for an unusable record and for one without an input or compared output, EmcasError for an unknown
    output.
    """
    actuator = base.actuator
    known = {v.name: v for v in actuator.outputs if v.kind == "Real"}
    for name in compare:
        if name not in known:
            raise EmcasError(f"{actuator.name} has no output {name}{hint(name, known)}")
    quantities = {v.name: (v.unit or "1", v.description) for v in (*actuator.inputs, *known.values())}
    records = read_records(paths, compare, list(quantities), {"time": ("s", "time of the sample"), **quantities})
    hints = "".join(f"; {line}" for line in misspelt(records, base))
    for record in records:
        record.require(any(v.name in record.columns for v in actuator.inputs), "has no column for an input, such as "
                       f"fin_command [deg]; the inputs are {', '.join(v.name for v in actuator.inputs)}{hints}")
    outputs = [v for v in known.values() if (v.name in compare if compare else
                                             all(v.name in record.columns for record in records))]
    require(outputs, f"{records[0].path}: no output is in every record; the outputs of {actuator.name} are "
            f"{', '.join(known)}{hints}")
    return records, outputs


def misspelt(records: Iterable[RecordFile], base: ParameterSet) -> Iterator[str]:
    """Yield a message for each unused column whose name resembles an input or output that the record lacks."""
    for record in records:
        missing = [v.name for v in (*base.actuator.inputs, *base.actuator.outputs) if v.name not in record.columns]
        for name in record.unused:
            if close := get_close_matches(name, missing, 1, _ALIKE) if name not in missing else []:
                yield f"{record.name}: column {name} is not used; did you mean {close[0]}? Rename it, or leave it out"


def columns_used(records: Iterable[RecordFile], base: ParameterSet, outputs: Sequence[Variable]) -> Iterator[str]:
    """Yield a line on the use of columns (input, compared, not used) for all records with the same columns."""
    compared = [v.name for v in outputs]
    lines: dict[str, list[str]] = {}
    for record in records:
        inputs = [v.name for v in base.actuator.inputs if v.name in record.columns]
        others = [name for name in (*record.columns, *record.unused) if name not in ("time", *inputs, *compared)]
        lines.setdefault(f"inputs {', '.join(inputs)}; compared {', '.join(compared)}; not used "
                         f"{', '.join(others) or 'none'}.", []).append(record.name)
    for line, names in lines.items():
        yield f"Columns of {', '.join(names)}: {line}"


class Replay:
    """Simulates records for many values of the `unknowns` [SI] side by side.

    The unknowns are the free parameters, the initial fin angle of each record if fin angles are compared, and with
    `delays` the delay of each output. If fin angles are not compared, the initial angle is the first measured fin angle
    or, without one, fin.start_angle. `owners` are the indices of record and output of each array of residuals. `rough`
    says that residuals are rough functions of the parameters, because the actuator quantises measured angles.
    """

    def __init__(self, base: ParameterSet, free: Sequence[Unknown], records: Sequence[RecordFile],
                 outputs: Sequence[Variable], delays: bool) -> None:
        self.records, self.outputs, self._delays = records, outputs, delays
        self.free = len(free)
        starts = records if any(v.name == _ANGLE for v in outputs) else ()
        self.unknowns = [*free, *(nuisance(f"start of {r.name}", "rad", float(r[_ANGLE][0]), 0.01, pi) for r in starts),
                         *(nuisance(f"delay of {v.name}", "s", 0.0, 1e-3, _LATEST) for v in outputs if delays)]
        self.owners = list(product(range(len(records)), range(len(outputs))))
        self._free_start = {r.sha256: self.free + i for i, r in enumerate(starts)}
        self._subject, self._smooth = ParameterSubject(base), base.having(_SMOOTH)
        self.rough = any(base.values[name] != value for name, value in self._smooth.items())
        self._offsets = (_SPREAD * float(base.values["command.limit"]) * np.linspace(-0.5, 0.5, _COPIES) if self.rough
                         else np.zeros(1))

    def residuals(self, points: Array, smooth: bool = False) -> list[Stretches]:
        """Return at each of `points` the simulated minus measured outputs [SI]: arrays [rows] in the order of `owners`.

        If residuals are `rough`, the simulated outputs are means over responses from close initial angles, or with
        `smooth` the response without quantisation.
        """
        names, columns = [v.name for v in self.outputs], []
        for record in self.records:
            for name, simulated in zip(names, self._simulated(record, points, names, smooth, not smooth), strict=True):
                errors = simulated - record[name]
                errors[~np.isfinite(errors)] = _FAILED * (np.std(record[name]) or 1.0)
                columns.append(errors)
        return list(zip(*columns, strict=True))

    def _simulated(self, record: RecordFile, points: Array, names: Sequence[str], smooth: bool = False,
                   mean: bool = False) -> list[Array]:
        """Return each output [points, rows] for a record; with `mean` it is the mean over several initial angles."""
        start = np.full(len(points), record[_ANGLE][0] if _ANGLE in record.columns else self._subject.values[_START])
        if record.sha256 in self._free_start:
            start = points[:, self._free_start[record.sha256]]
        # Points that differ only in delays and in other records' initial angles share a run of this record.
        different, run_of = np.unique(np.column_stack([points[:, :self.free], start]), axis=0, return_inverse=True)
        offsets = self._offsets if mean else np.zeros(1)
        most = max(_MOST // (len(offsets) * len(record) * len(names)), 1)  # points at once
        parts = [self._mean_outputs(record, part, names, self._smooth if smooth else {}, offsets)
                 for part in np.split(different, range(most, len(different), most))]
        simulated = [np.concatenate(of_name)[run_of.ravel()] for of_name in zip(*parts, strict=True)]
        if self._delays:
            delays = dict(zip((v.name for v in self.outputs), points[:, -len(self.outputs):].T, strict=True))
            simulated = [np.array([record.late(y, delay) for y, delay in zip(of_name, delays[name], strict=True)])
                         if name in delays else of_name for name, of_name in zip(names, simulated, strict=True)]
        return simulated

    def _mean_outputs(self, record: RecordFile, points: Array, names: Sequence[str], fixed: Mapping[str, Any],
                      offsets: Array) -> list[Array]:
        """Return outputs [points, rows] as means over `offsets` [rad] of the initial angle, a point's last value."""
        columns = np.repeat(points, len(offsets), axis=0).T
        changes = {name: column for u, column in zip(self.unknowns, columns[:-1], strict=False)
                   for name in (u.name, u.follower) if name}
        inputs = {v.name: record[v.name] for v in self._subject.inputs.values() if v.name in record.columns}
        runs = self._subject.run_all(Excitation(record.name, inputs, step=record.step), {
            **changes, _START: columns[-1] + np.tile(offsets, len(points)), **fixed}, names)
        return [runs.columns[name].reshape(-1, len(offsets), len(record)).mean(axis=1) for name in names]

    def comparisons(self, values: Array, others: Sequence[RecordFile]) -> Iterator[ReplayedOutput]:
        """Yield the comparisons of all records, then of the records held out, `others`, at the unknowns' `values`.

        Simulations of `others` start at the first measured fin angle, if measured. Raises RecordError for a simulation
        that fails.
        """
        for record in (*self.records, *others):
            simulated = self._simulated(record, values[None], [v.name for v in self.outputs])
            for v, (of_output,) in zip(self.outputs, simulated, strict=True):
                record.require(np.isfinite(of_output).all(), f"cannot be simulated to its end with the fitted values: "
                               f"{v.name} is not finite; give narrower bounds")
                scale = factor(v.unit, display(v)) if display(v) else 1.0
                yield ReplayedOutput(record, v, record in others, record[v.name] * scale, of_output * scale)

    def moving(self, values: Array, others: Sequence[RecordFile]) -> Iterator[str]:
        """Yield a message for each record with a fin angle that does not begin at rest, as the simulation does.

        The initial fin rate is estimated over the first rows. It is reported if the error also has a large slope: a
        start at rest does not explain the motion.
        """
        for record in (*self.records, *others):
            if _ANGLE in record.columns:
                ((simulated,),) = self._simulated(record, values[None], [_ANGLE])
                measured, time = record[_ANGLE], record.step * np.arange(_FIRST)
                rate = float(np.polyfit(time, measured[:_FIRST], 1)[0])
                (error, _), covariance = np.polyfit(time, (measured - simulated)[:_FIRST], 1, cov=True)
                fastest = float(np.abs(np.diff(simulated)).max()) / record.step
                if min(abs(rate), abs(error)) > max(_CERTAIN * sqrt(covariance[0, 0]), _MOVING * fastest):
                    yield (f"{record.name}: does not begin at rest, as the simulation does: the fin moves at "
                           f"{degrees(rate):.3g} deg/s; cut the file so that it begins at rest")

"""Speed of many actuators moved at once by vectors, as ratios to the loop over one at a time, within one run.

    python benchmarks/batch.py [--lanes 4] [--scaling] [--rounds 5] [--json FILE]

Both take the same steps of 1 ms in turn, round after round, so that a machine that changes its speed hurts both alike,
and every output must be the same to the bit. `own`: every actuator has its own parameters, those of VARIED within 5 %
of the default; `shared`: one set. They follow sines of 1 to 8 deg under loads of 20 N.m, in `hard` squares of 20 deg
under 100 N.m, out of step with each other. `--lanes` is the width of the vectors, unless the processor's longest;
`--scaling` goes from 1 to 1,000,000 actuators, and through the processor's cores. Exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.compiled import Array, parameter_row
from emcas_fmu.runtime.library import loaded

STEP = 1e-3
# Case: actuators, whether each has its own parameters, whether it is the hard case, target.
CASES = {"own.1000": (1000, True, False, 0.40), "own.100000": (100_000, True, False, 0.40),
         "shared.1000": (1000, False, False, 0.32), "shared.100000": (100_000, False, False, 0.45),
         "hard.1000": (1000, True, True, 0.50)}
VARIED = ("motor.torque_constant", "motor.back_emf_constant", "motor.resistance", "motor.inductance", "inertia.motor",
          "inertia.fin", "deviation.friction.coulomb", "deviation.friction.viscous", "mass.fin", "screw.lead")
SPREAD, SETTLE = 0.05, 10  # steps that are not timed
WORK = 200_000  # steps of all actuators together in a round
LEAST, MOST = 8, 2000  # steps of each in a round


class Signals:
    """Commands and loads of `count` actuators, out of step with each other."""

    def __init__(self, count: int, hard: bool) -> None:
        rng = np.random.default_rng(1)
        self._phase, self._frequency = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(5.0, 12.0, count)
        self._amplitude = np.radians(rng.uniform(1.0, 8.0, count))
        self._hard = hard

    def at(self, time: float) -> tuple[Array, Array]:
        """Return commands [rad] and loads [N.m]."""
        command = np.sin(2.0 * np.pi * self._frequency * time + self._phase)
        load = np.sin(2.6 * np.pi * self._frequency * time + 2.0 * self._phase)
        if self._hard:
            return np.radians(20.0) * np.sign(command), 100.0 * np.sign(load)
        return self._amplitude * command, 20.0 * load


def parameters(count: int, own: bool) -> Array:
    """Return the sets of `count` actuators, [count, parameters], or the one of all."""
    row = parameter_row(load_parameters().values)
    if not own:
        return row[np.newaxis]
    sets, rng = np.tile(row, (count, 1)), np.random.default_rng(2)
    names = [v.name for v in get(NONLINEAR).parameters]
    for name in VARIED:
        share, column = rng.uniform(-SPREAD, SPREAD, count), sets[:, names.index(name)]
        column += share if name.startswith("deviation.") else column * share
    return sets


def started(sets: Array, count: int, **options: Any) -> Batch:
    """Return a batch whose inputs are at their start."""
    batch = Batch(sets, count, **options)
    for place, variable in enumerate(get(NONLINEAR).inputs):
        batch.hold(place, float(variable.initial(load_parameters().values)))
    return batch


def compared(count: int, own: bool, hard: bool, rounds: int, lanes: int | None) -> dict[str, float]:
    """Return CPU [ns] of an actuator's step by loop and by vectors, and the median of the rounds' ratios."""
    sets, signals = parameters(count, own), Signals(count, hard)
    batches = [started(sets, count, lanes=1), started(sets, count, lanes=lanes)]
    steps, k = min(max(WORK // count, LEAST), MOST), 0
    times: list[list[float]] = []
    largest = 0.0
    for n in range(rounds + 1):
        spent = [0.0, 0.0]
        for _ in range(SETTLE if n == 0 else steps):
            driven = signals.at(k * STEP)
            k += 1
            for which in ((0, 1) if k % 2 else (1, 0)):
                begin = process_time()
                for place, values in enumerate(driven):
                    batches[which].hold(place, values)
                batches[which].run(k * STEP)
                spent[which] += process_time() - begin
            if not np.array_equal(batches[0].outputs, batches[1].outputs):
                raise RuntimeError(f"vectors and loop differ after {k} steps")
        times.append([1e9 * t / (steps * count) for t in spent])
        largest = max(largest, float(np.abs(batches[0].outputs[0]).max()))
    if largest < 1e-3:  # rad
        raise RuntimeError("the batch did not move")
    return {"loop_ns": statistics.median(t[0] for t in times[1:]),
            "vectors_ns": statistics.median(t[1] for t in times[1:]),
            "ratio": statistics.median(t[1] / t[0] for t in times[1:])}


def scaling(sizes: Sequence[int], rounds: int, lanes: int | None) -> list[dict[str, float]]:
    """Return what :func:`compared` says of so many actuators, with parameters of their own and with one set."""
    return [{"actuators": count, "own": own, **compared(count, own, False, rounds, lanes)}
            for count in sizes for own in (True, False)]


def threaded(count: int, threads: Sequence[int], rounds: int, lanes: int | None) -> list[dict[str, float]]:
    """Return wall time and CPU [ns] of an actuator's step, the least of all, with one set for all, by threads in turn.

    The clock shows what threads gain where the cores are free, CPU what they cost where others use them.
    """
    signals, least = Signals(count, False), np.full((len(threads), 2), np.inf)
    batches = [started(parameters(count, False), count, threads=workers, lanes=lanes) for workers in threads]
    for k in range(SETTLE * rounds):
        driven = signals.at(k * STEP)
        for batch, times in zip(batches, least, strict=True):
            begin = np.array([perf_counter(), process_time()])
            for place, values in enumerate(driven):
                batch.hold(place, values)
            batch.run((k + 1) * STEP)
            np.minimum(times, np.array([perf_counter(), process_time()]) - begin, out=times)
    return [{"actuators": count, "threads": workers, "wall_ns": wall, "cpu_ns": cpu}
            for workers, (wall, cpu) in zip(threads, (1e9 * least / count).tolist(), strict=True)]


def main() -> int:
    """Compare, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, choices=(4, 8), help="actuators in a vector (the processor's most)")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each case")
    parser.add_argument("--scaling", action="store_true", help="1 to 1,000,000 actuators, and threads, too")
    parser.add_argument("--json", type=Path, help="file for the figures")
    arguments = parser.parse_args()
    if arguments.json:
        arguments.json.touch()  # nothing is measured for minutes that cannot be written
    figures: dict[str, Any] = {}
    print(f"{'case':<16}{'loop':>10}{'vectors':>10}{'ratio':>8}{'target':>8}")
    for name, (count, own, hard, target) in CASES.items():
        case = compared(count, own, hard, arguments.rounds, arguments.lanes)
        figures[name] = case["ratio"]
        figures[f"{name}.ns"] = case
        print(f"{name:<16}{case['loop_ns']:>7.0f} ns{case['vectors_ns']:>7.0f} ns{case['ratio']:>8.3f}{target:>8.2f}")
    if arguments.scaling:
        figures["lanes"] = arguments.lanes or loaded(NONLINEAR).actuator_lanes()
        figures["scaling"] = scaling([10**n for n in range(7)], arguments.rounds, arguments.lanes)
        figures["threads"] = threaded(100_000, sorted({1, 2, os.cpu_count() or 1}), arguments.rounds, arguments.lanes)
        for line in figures["scaling"]:
            print(f"{line['actuators']:>9.0f} actuators, {'own' if line['own'] else 'shared'}: loop "
                  f"{line['loop_ns']:.0f} ns, vectors {line['vectors_ns']:.0f} ns, ratio {line['ratio']:.3f}")
        for line in figures["threads"]:
            print(f"{line['actuators']:>9.0f} actuators, {line['threads']:.0f} threads: {line['wall_ns']:.0f} ns, CPU "
                  f"{line['cpu_ns']:.0f} ns")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    missed = [f"{name} {figures[name]:.3f} (target: at most {case[-1]:g})" for name, case in CASES.items()
              if figures[name] > case[-1]]
    print("\n" + ("; ".join(f"missed: {line}" for line in missed) if missed else "all targets met"))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

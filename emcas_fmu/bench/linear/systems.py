"""Linear systems of python-control: connection, sampling and delay, their poles, and their hidden modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, matrix_balance, null_space

Array = NDArray[Any]
System = Any
"""A control.StateSpace with named inputs and outputs."""
# Smallest decay of a mode in a sample. Poles are accurate to 1e-14; a mode that decays less needs 1e10 samples, months.
ROUNDING = 1e-10
# Largest singular value of a hidden mode, over the norm of the balanced A. Rounding gives a hidden mode 2e-15; the
# weakest other mode of the shipped actuators has 6e-9 (electrohydrostatic at 10 deg).
_HIDDEN = 1e-12
_FAST = 0.5  # smallest pole magnitude of a tested mode: faster ones affect no figure and resemble hidden modes


def measured(state: str) -> str:
    """Return the label of a state at the samples, which differs from that of an output with the state's name."""
    return f"x_{state}"


def delay_line(samples: int, period: float) -> System:
    """Return a delay of whole samples, at least 1, from ``sent`` to ``arrived``, for a sample time `period` [s]."""
    return ct.ss(np.eye(samples, k=-1), np.eye(samples, 1), np.eye(1, samples, k=samples - 1), 0.0, period,
                 inputs=["sent"], outputs=["arrived"])


def wire(blocks: Sequence[System], links: Sequence[tuple[str, str]], inputs: Sequence[str],
         outputs: Sequence[str]) -> System:
    """Return the system from `inputs` to `outputs` of connected blocks, which have the same sample time.

    `links` are pairs of an output and the input that it feeds, by name.
    """
    whole = ct.append(*blocks)
    ins = [label for one in blocks for label in one.input_labels]
    outs = [label for one in blocks for label in one.output_labels]
    connection = np.zeros((len(ins), len(outs)))
    for out, into in links:
        connection[ins.index(into), outs.index(out)] = 1.0
    closed = whole.feedback(connection, 1)
    columns, rows = [ins.index(name) for name in inputs], [outs.index(name) for name in outputs]
    return ct.ss(closed.A, closed.B[:, columns], closed.C[rows], closed.D[np.ix_(rows, columns)], whole.dt,
                 inputs=list(inputs), outputs=list(outputs))


def moving(a: Array, b: Array, c: Array, d: Array, period: float, inputs: Sequence[str],
           outputs: Sequence[str]) -> System:
    """Return a system of sample time `period` [s] without its constant states, such as an integral with gain 0.

    `a`, `b`, `c` and `d` are its matrices in SI.
    """
    moves = np.any(a != np.eye(len(a)), axis=1) | np.any(b != 0.0, axis=1)
    return ct.ss(a[np.ix_(moves, moves)], b[moves], c[:, moves], d, period, inputs=inputs, outputs=outputs)


def sampled(plant: System, period: float, whole: int, rest: float) -> System:
    """Return the plant at the sample times, `period` [s] apart, with held inputs.

    The first input is delayed by `whole` periods and `rest` [s]. The states are those of the plant, then the delayed
    values of this input, from new to old.
    """
    n, ins, late = len(plant.A), plant.ninputs, whole + (rest > 0.0)
    joined = np.block([[plant.A, plant.B], [np.zeros((ins, n + ins))]])
    before, after = expm(joined * rest), expm(joined * (period - rest))
    free = after[:n, :n] @ before[:n, :n]
    held = after[:n, :n] @ before[:n, n:] + after[:n, n:]
    line = np.zeros((n, whole + 2))  # effect of the first input's values, by their age in samples
    line[:, whole], line[:, whole + 1] = after[:n, n], after[:n, :n] @ before[:n, n]
    a = np.block([[free, line[:, 1:1 + late]], [np.zeros((late, n)), np.eye(late, k=-1)]])
    b = np.block([[line[:, :1], held[:, 1:]], [np.eye(late, 1), np.zeros((late, ins - 1))]])
    c = np.hstack([plant.C, np.zeros((len(plant.C), late))])
    return ct.ss(a, b, c, plant.D, period, inputs=plant.input_labels, outputs=plant.output_labels)


def reaches(system: System, inputs: Sequence[str], outputs: Sequence[str]) -> bool:
    """Return whether one of the inputs affects one of the outputs, directly or through states."""
    columns, rows = ([labels.index(name) for name in names] for labels, names in (
        (system.input_labels, inputs), (system.output_labels, outputs)))
    read = np.any(system.C[rows] != 0.0, axis=0)
    for _ in range(system.nstates):
        read = read | np.any(system.A[read] != 0.0, axis=0)
    return bool(np.any(system.D[np.ix_(rows, columns)]) or np.any(system.B[np.ix_(read, columns)]))


def cleared(value: float, rounding: float) -> float:
    """Return the value, or 0 if its magnitude is at most `rounding`, in the same unit."""
    return 0.0 if abs(value) <= rounding else value


def largest_pole(system: System) -> float:
    """Return the largest magnitude [-] of a sampled system's poles z."""
    return float(np.max(np.abs(system.poles()), initial=0.0))


def decays(system: System) -> bool:
    """Return whether every mode of a sampled system decays by more than the rounding of a pole at 1."""
    return largest_pole(system) < 1.0 - ROUNDING


def shown(system: System) -> tuple[System, Array]:
    """Return a square system without its hidden modes, and the poles of these modes (z, or s [rad/s]).

    A hidden mode is not controllable or not observable, by the Popov-Belevitch-Hautus test on the balanced system
    (Kailath, "Linear Systems", section 2.4). Fast modes of a sampled system are kept; a system without other hidden
    modes is returned unchanged.
    """
    count, sampled = len(system.A), bool(system.dt)
    joined = np.block([[system.A, system.B], [system.C, np.eye(system.noutputs)]])
    balanced, (scale, _) = matrix_balance(joined, permute=False, separate=True)
    a, b, c = balanced[:count, :count], _even(balanced[:count, count:].T).T, _even(balanced[count:, :count])
    least, basis, hidden = _HIDDEN * np.linalg.norm(a, 2), np.eye(count), []
    poles = list(np.linalg.eigvals(a))
    while poles:
        pole = poles.pop()
        if pole.imag < 0.0 or (sampled and abs(pole) < _FAST):
            continue
        shifted = a - pole * np.eye(len(a))
        for pencil in (np.vstack([shifted, c]), np.vstack([shifted.T, b.T])):
            _, sizes, modes = np.linalg.svd(pencil)
            if sizes[-1] <= least:
                mode = modes[-1].conj()
                others = null_space(np.vstack([mode.real, mode.imag]), rcond=1e-6)
                hidden += [pole, pole.conjugate()][:len(a) - others.shape[1]]
                a, b, c, basis = others.T @ a @ others, others.T @ b, c @ others, basis @ others
                poles = list(np.linalg.eigvals(a))
                break
    if not hidden:
        return system, np.array([])
    into = scale[:count, None] * basis
    back = basis.T / scale[:count]
    return ct.ss(a, back @ system.B, system.C @ into, system.D, system.dt,
                 inputs=system.input_labels, outputs=system.output_labels), np.array(hidden)


def _even(rows: Array) -> Array:
    """Return the rows scaled to length 1; rows of zeros are unchanged."""
    lengths: Array = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.maximum(lengths, 1e-300)

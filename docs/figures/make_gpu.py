"""The tables of docs/develop/gpu.md: operations and bytes of a 1 ms step, counted, and what a GPU would take for them.

    python docs/figures/make_gpu.py           # writes the tables
    python docs/figures/make_gpu.py --check   # exit code 1 where one is stale

The default actuator's Python equations run on numbers that count what is done with them, under the signals of
benchmarks/batch.py. Each block of the code is a place of its own, so that the operations that threads have in common
when they step together are those of every block that any of them enters.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache, reduce
from math import sqrt
from operator import or_
from runpy import run_path
from typing import Any, NamedTuple

import numpy as np
from make_tables import DOCS, main, markdown

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.core import Core

BENCHMARK = run_path(str(DOCS.parent / "benchmarks" / "batch.py"))
# That step together: one alone, those in a processor's vectors, a GPU's threads.
WIDTHS = (1, 4, 8, 32)
WARP = WIDTHS[-1]
STEP = 1e-3  # s
BEGUN, COUNTED = 10, 20  # steps: until the delay line is full, and those that are counted then
KINDS = ("add, subtract, multiply", "compare", "divide", "square root")
# Double-precision instructions of each kind: a division and a root begin with a guess that is refined.
COST = (1, 1, 10, 10)


class Gpu(NamedTuple):
    """Published figures: double-precision instructions and bytes in a second, and those of its bus one way."""

    name: str
    instructions: float
    bytes: float
    bus: float


# A fused multiply-add counts as two in published figures, and is not used here: half of them.
GPUS = (Gpu("data centre: H100 SXM", 0.5 * 34e12, 3.35e12, 64e9),
        Gpu("consumer: RTX 4090", 0.5 * 82.6e12 / 64, 1.008e12, 32e9))


class _Tally:
    """Where the program is, (tick, event in it, block), and what it has done there by kind."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        self.tick = self.event = self.block = 0
        self.done: Counter[tuple[int, int, int, str]] = Counter()

    def at(self, block: int) -> None:
        self.block = block

    def add(self, kind: str) -> None:
        self.done[self.tick, self.event, self.block, kind] += 1


TALLY = _Tally()


def _operator(name: str, kind: str) -> Callable[..., Any]:
    plain = getattr(float, name)

    def operation(self: Number, other: float) -> Any:
        TALLY.add(kind)
        result = plain(self, other)
        return result if isinstance(result, bool) else Number(result)

    return operation


class Number(float):
    """A number that counts; signs and sizes are free, as they are to an instruction."""

    __hash__ = float.__hash__

    def __neg__(self) -> Number:
        return Number(float.__neg__(self))


for _kind, _names in ((KINDS[0], "add radd sub rsub mul rmul"), (KINDS[1], "lt le gt ge eq"),
                      (KINDS[2], "truediv rtruediv")):
    for _name in _names.split():
        setattr(Number, f"__{_name}__", _operator(f"__{_name}__", _kind))


def _square_root(x: float) -> Number:
    TALLY.add(KINDS[3])
    return Number(sqrt(x))


def _with_blocks(source: str) -> Iterator[str]:
    """Yield the lines of the equations with a call of `at` where a block begins and where one goes on after another."""
    blocks: list[tuple[int, int]] = []  # that are open: how far they are indented, their numbers
    for number, line in enumerate(source.splitlines(), 1):
        text = line.lstrip()
        indent = len(line) - len(text)
        inside = bool(text) and (indent > 4 or (indent == 4 and text.startswith("def ")))
        ended = False
        while inside and blocks and blocks[-1][0] > indent:
            blocks.pop()
            ended = True
        if inside and ended and blocks and text != "else:":
            yield f"{' ' * indent}at({blocks[-1][1]})"
        yield line
        if inside and text.endswith(":"):
            blocks.append((indent + 4, number))
            yield f"{' ' * (indent + 4)}at({number})"


@cache
def _source() -> str:
    return codegen.source(model=NONLINEAR)


def _functions() -> Any:
    """Return the equations of the default actuator, which count."""
    program: dict[str, Any] = {"at": TALLY.at}
    exec(compile("\n".join(_with_blocks(_source())), "<equations>", "exec"), program)
    plain = {name: program[name] for name in ("fabs", "floor", "ldexp")}
    program.update({name: lambda *x, of=function: Number(of(*x)) for name, function in plain.items()},
                   sqrt=_square_root, float=Number)
    values = {key: Number(value) if isinstance(value, float) else value
              for key, value in load_parameters().values.items()}
    *others, step, outputs = program["make"](values)

    def counted(*arguments: float) -> tuple[float, ...]:
        moved: tuple[float, ...] = step(*arguments)
        whole = float(moved[-1]) >= float(arguments[-1])
        TALLY.tick, TALLY.event = (TALLY.tick + 1, 0) if whole else (TALLY.tick, TALLY.event + 1)
        return moved

    return *others, counted, outputs


class Counts(NamedTuple):
    """Operations by kind and the share of ticks with an event, of so many that step together."""

    operations: Mapping[int, Any]
    events: Mapping[int, float]


@cache
def counts(hard: bool) -> Counts:
    """Count a step of 1 ms of WARP actuators that move out of step with each other."""
    signals, functions = BENCHMARK["Signals"](WARP, hard), _functions()
    cores = [Core(functions, codegen.sizes(get(NONLINEAR))) for _ in range(WARP)]
    supply = load_parameters().values["drive.supply_voltage"]
    operations, events, ticks = {width: np.zeros(len(KINDS)) for width in WIDTHS}, dict.fromkeys(WIDTHS, 0), 0
    for k in range(BEGUN + COUNTED):
        done = []
        for core, *driven in zip(cores, *(column.tolist() for column in signals.at(k * STEP)), strict=True):
            TALLY.clear()
            core.run((k + 1) * STEP, tuple(map(Number, codegen.inputs_at_rest(*driven, supply))))
            done.append(TALLY.done)
            ticks += TALLY.tick if k >= BEGUN else 0
        for width in WIDTHS if k >= BEGUN else ():
            for first in range(0, WARP, width):
                together = reduce(or_, done[first:first + width])  # the most of any
                operations[width] += _by_kind(together)
                events[width] += len({tick for tick, event, *_ in together if event})
    return Counts({width: width * sums / (WARP * COUNTED) for width, sums in operations.items()},
                  {width: width * number / ticks for width, number in events.items()})


def _by_kind(done: Counter[tuple[int, int, int, str]]) -> Any:
    return np.array([sum(n for (*_, kind), n in done.items() if kind == each) for each in KINDS])


def operations() -> str:
    """Operations of a step by kind."""
    cases = [counts(hard) for hard in (False, True)]
    columns = [case.operations[width] for case in cases for width in WIDTHS]
    rows = [(kind, *(f"{column[i]:.0f}" for column in columns)) for i, kind in enumerate(KINDS)]
    rows.append(("double-precision instructions", *(f"{np.dot(COST, column):.0f}" for column in columns)))
    rows.append(("for each of them, over one alone", *(
        f"{np.dot(COST, case.operations[width]) / np.dot(COST, case.operations[1]) / width:.2f}"
        for case in cases for width in WIDTHS)))
    rows.append(("ticks with an event", *(f"{100.0 * case.events[width]:.0f} %" for case in cases for width in WIDTHS)))
    heads = [f"{width} together" if width > 1 else f"{case}, one" for case in ("in motion", "hard case")
             for width in WIDTHS]
    return markdown(("in 1 ms", *heads), rows)


@cache
def varying() -> int:
    """Return how many values the benchmark's own parameters make an actuator's own: themselves and what follows."""
    names, kept = [v.name for v in get(NONLINEAR).parameters], []
    for row in BENCHMARK["parameters"](2, True).tolist():
        made = codegen.make(model=NONLINEAR)({**load_parameters().values, **dict(zip(names, row, strict=True))})
        kept.append({name: cell.cell_contents for function in made
                     for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)})
    return sum(kept[1][name] != value for name, value in kept[0].items())


def _state() -> tuple[int, int]:
    """Return how many numbers of an actuator's state a step reads, and how many it writes."""
    sizes, schedule = codegen.sizes(get(NONLINEAR)), codegen.core(load_parameters().values).schedule
    plant, controller, _, loads, _ = sizes
    stepped = plant + controller + 2 + len(get(NONLINEAR).sampled_states)
    line = int(schedule[-3]) + 2 + int(schedule[-2])
    return stepped + line + loads - 1, stepped + 1


def _bytes() -> dict[str, int]:
    read, written = _state()
    return {"state, read": 8 * read, "state, written": 8 * written, "command and load": 8 * 2,
            "outputs": 8 * len(get(NONLINEAR).outputs), "own parameters and what follows": 8 * varying()}


def memory() -> str:
    """Bytes of a step."""
    return markdown(("an actuator, in 1 ms", "bytes"), [(what, str(n)) for what, n in _bytes().items()])


def estimate() -> str:
    """What GPUs would take for them."""
    sizes, rows = _bytes(), []
    shared = sum(sizes.values()) - sizes["own parameters and what follows"]
    for gpu in GPUS:
        moved = [1e9 * n / gpu.bytes for n in (shared, sum(sizes.values()))]
        worked = [1e9 * np.dot(COST, counts(hard).operations[WARP]) / gpu.instructions for hard in (False, True)]
        across = 1e9 * max(sizes["outputs"], sizes["command and load"]) / gpu.bus
        rows.append((gpu.name, *(f"{t:.2g} ns" for t in (*moved, *worked, across))))
    return markdown(("", "memory, one set", "memory, own parameters", "arithmetic, in motion", "arithmetic, hard case",
                     "outputs over the bus"), rows)


def registers() -> str:
    """Numbers that live at once in a tick."""
    step = _source().partition("    def step(")[2].partition("    def ")[0]
    live, arguments = len(set(re.findall(r"\br[0-9]+\b", step))), step.partition(")")[0].count(",") + 1
    return (f"A tick keeps up to {live} numbers beside its {arguments} arguments: {2 * (live + arguments)} registers "
            "of 32 bits, of 255 that a thread may have.")


TABLES = {"develop/gpu.md": {"operations": operations, "memory": memory, "registers": registers,
                             "estimate": estimate}}

if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_gpu.py"))

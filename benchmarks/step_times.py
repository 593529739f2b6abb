"""How long a step takes at most, for hardware in the loop: every actuator under millions of random steps.

    python benchmarks/step_times.py [--steps 10000000] [--repeats 5] [--model MODEL ...] [--json FILE]

Steps are of 1 ms or less; command, load, supply and `enable` jump at random. Each sequence of a thousand steps is run
several times from the same state: the least time of each step is the algorithm's, what a single run shows beyond that
is the machine's. Times are those of core_run, what every doStep comes to, as ratios to the actuator's median step.
`pieces` are what a step is made of: ticks, parts of ticks, and what is left of a tick behind an event.

    python benchmarks/step_times.py --steps 100000 --model nonlinear --model elastic+heat
    python benchmarks/step_times.py --json step_times.json
"""

from __future__ import annotations

import argparse
import ctypes as ct
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics.loads import LOADS
from emcas_fmu.runtime.c_sources import batch_sources
from emcas_fmu.runtime.compiler import local_compilers, local_platform

SOURCE = Path(__file__).parent / "native" / "step_times.c"
LOAD = 150.0  # N.m, largest of either sign: more than most of them hold
SEQUENCE = 1000


class _Task(ct.Structure):
    _fields_ = (("command", ct.c_double), ("load", ct.c_double), ("supply", ct.c_double),
                ("seed", ct.c_uint64), ("steps", ct.c_uint64), ("repeats", ct.c_uint64))


class _Tally(ct.Structure):
    _fields_ = (("pieces", ct.c_uint64), ("most_pieces", ct.c_uint64), ("refused", ct.c_uint64),
                ("clock_ns", ct.c_uint64))


def _library(model: str, folder: Path) -> ct.CDLL:
    target, compiler = local_platform(), next(local_compilers(), None)
    if target is None or compiler is None:
        raise SystemExit("no C compiler: install one, or ziglang with  pip install 'emcas-fmu[native]'")
    sources = {SOURCE.name: SOURCE.read_text(encoding="utf-8"), **batch_sources(model)}
    path = folder / f"{model}{target.suffix}"
    path.write_bytes(compiler.library(sources, SOURCE.name, target, "step_times"))
    return ct.CDLL(str(path))


def figures(model: str, steps: int, repeats: int, seed: int, folder: Path) -> dict[str, Any]:
    """Return the distribution of an actuator's steps: median [ns], the rest over the median."""
    actuator, library = get(model), _library(model, folder)
    parameters = load_parameters(model=model)
    values = (parameters.with_values({"homing.required": False}) if "homing" in model else parameters).values
    start = {v.name: float(v.initial(values)) for v in actuator.inputs}
    supply = start[actuator.supply.input.name] if actuator.supply else 0.0
    calm = [start["fin_command"], *(0.0 for _ in LOADS), supply, start["enable"],
            *(start[v.name] for v in actuator.further_inputs)]
    least, first = np.zeros(steps, dtype=np.uint32), np.zeros(steps, dtype=np.uint32)
    tally = _Tally()
    numbers = [float(values[v.name]) for v in actuator.parameters]
    if not library.step_times((ct.c_double * len(numbers))(*numbers), (ct.c_double * len(calm))(*calm),
                              ct.byref(_Task(values["command.limit"], LOAD, supply, seed, steps, repeats)),
                              least.ctypes.data_as(ct.c_void_p), first.ctypes.data_as(ct.c_void_p), ct.byref(tally)):
        raise SystemExit(f"{model}: the parameters are refused")
    own, single = (np.maximum(times.astype(float) - tally.clock_ns, 0.0) for times in (least, first))
    median = float(np.median(own))
    return {"median_ns": median, "p99": float(np.quantile(own, 0.99)) / median,
            "p9999": float(np.quantile(own, 0.9999)) / median, "largest": float(own.max()) / median,
            "single_p9999": float(np.quantile(single, 0.9999)) / median, "single_largest": float(single.max()) / median,
            "pieces": tally.pieces / steps, "most_pieces": tally.most_pieces, "refused": tally.refused}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=10_000_000, help="steps of each actuator (default 10 million)")
    parser.add_argument("--repeats", type=int, default=3, help="how often each sequence is run (default 3)")
    parser.add_argument("--model", action="append", help="only this actuator (may be given several times)")
    parser.add_argument("--seed", type=int, default=1, help="of the random steps (default 1)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.repeats, arguments.seed) < 1 or arguments.steps % SEQUENCE:
        parser.error(f"--steps is a multiple of {SEQUENCE}, --repeats and --seed are at least 1")
    print(f"{'':24}{'median':>10}{'over the median':>36}{'one run':>20}{'pieces':>16}")
    print(f"{'':24}{'ns':>10}{'99 %':>12}{'99.99 %':>12}{'largest':>12}{'99.99 %':>10}{'largest':>10}"
          f"{'mean':>8}{'most':>8}")
    found = {}
    with tempfile.TemporaryDirectory() as name:
        for model in arguments.model or NAMES:
            of = found[model] = figures(model, arguments.steps, arguments.repeats, arguments.seed, Path(name))
            refused = f"   {of['refused']} refused" if of["refused"] else ""
            print(f"{model:24}{of['median_ns']:10.0f}{of['p99']:12.2f}{of['p9999']:12.2f}{of['largest']:12.2f}"
                  f"{of['single_p9999']:10.1f}{of['single_largest']:10.0f}{of['pieces']:8.2f}{of['most_pieces']:8}"
                  f"{refused}", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()

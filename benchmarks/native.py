"""Speed of the native FMU against the same actuator written by hand in C, as ratios within one run.

    python benchmarks/native.py [--fmu EMCAS.fmu] [--processes 5] [--rounds 40] [--json FILE]

The yardstick (native/yardstick.c) is what the author of a 6-DOF simulation would write: fixed ticks of 0.1 ms, one
semi-implicit Euler step each. Both are driven by the same C host (native/host.c) in turn, round after round, so that
a machine that changes its speed hurts both alike; the FMU's sources and the yardstick are compiled by the same
compiler with the same flags, and the binary as shipped is measured too. Then both under hosts other people wrote.
Exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import native_build
import native_hosts
import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files
from emcas_fmu.reference.cases import CASES
from emcas_fmu.support.files import models_directory

INPUTS = get(NONLINEAR).inputs

SOURCES, SHIPPED, YARDSTICK, LEAN = "EMCAS, sources", "EMCAS, as shipped", "yardstick", "yardstick without cos"
RATIO_TARGET, MEMORY_TARGET = 0.45, 4096  # at most; bytes of an instance: a page of memory
STEPS, INSTANCES = 20_000, 500  # of a round; of the start-up measurement
PROCESSES = 3  # of each FMU under each other host

Figures = dict[str, Any]


def in_c(host: Path, slaves: Mapping[str, Sequence[str]], processes: int, rounds: int) -> Figures:
    """CPU [ns] of a 1 ms step for each slave (GUID, resources, library) and round, start-up [ns] and memory [B]."""
    arguments = [argument for slave in slaves.values() for argument in slave]
    starts, times = [], []
    for _ in range(processes):
        done = subprocess.run([str(host), str(rounds), str(STEPS), str(INSTANCES), *arguments],
                              capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr.strip())
        lines = [[float(cell) for cell in line.split()] for line in done.stdout.splitlines()]
        starts.append(lines[:len(slaves)])
        times.append(lines[len(slaves):])
    start = np.median(np.array(starts), axis=0)
    columns = np.array(times)  # process, round, slave; the last is the host alone
    reference = columns[:, :, list(slaves).index(YARDSTICK)]
    figures: Figures = {"host_ns": float(np.median(columns[:, :, -1]))}
    for k, name in enumerate(slaves):
        ratios = columns[:, :, k] / reference
        medians = np.median(ratios, axis=1)
        figures[name] = {
            "step_ns": float(np.median(columns[:, :, k])), "ratio": float(np.median(ratios)),
            "ratio_by_process": [float(medians.min()), float(medians.max())],
            "first_instance_us": start[k, 0] / 1e3, "instance_us": start[k, 1] / 1e3,
            "instance_bytes": int(start[k, 2])}
    return figures


def _error(fmu: Path, case: Any, starts: Mapping[str, Any]) -> float:
    """Largest difference of the fin angle [deg] to the stored reference of a case."""
    folder = models_directory() / "reference"
    inputs = files.read_csv(files.path_of(folder, case.name, "in.csv"))
    reference = files.read_csv(files.path_of(folder, case.name, "ref.csv"))["fin_angle"]
    given = {name: column for name, column in inputs.items() if name != "time"}
    with open_subject(fmu) as subject:
        run = subject.run(Excitation(case.title, given, step=case.step), starts, ("fin_angle",))
    if len(run.columns["fin_angle"]) != len(reference):
        raise RuntimeError(f"{fmu}: {case.name} stopped at {run.stopped} s {run.messages}")
    return float(np.degrees(np.abs(run.columns["fin_angle"] - reference).max()))


def accuracy(fmu: Path, values: Mapping[str, Any], folder: Path) -> dict[str, dict[str, float]]:
    """Errors [deg] by case; the yardstick's, whose parameters are compiled in, with the case's own, at two ticks."""
    errors: dict[str, dict[str, float]] = {}
    made: dict[str, Path] = {}

    def yardstick(overrides: Mapping[str, Any], ticks: int) -> Path:
        own, key = {**values, **overrides}, f"{ticks}{sorted(overrides.items())}"
        if key not in made:
            library = native_build.compile_yardstick(own, folder / f"case{len(made)}", f"-DPERIOD={ticks}")
            made[key] = native_build.packed(own, library)
        return made[key]

    for case in CASES:
        coarse, fine = yardstick(case.overrides, 10), yardstick(case.overrides, 1000)
        errors[case.name] = {"EMCAS": _error(fmu, case, case.overrides), YARDSTICK: _error(coarse, case, {}),
                             "yardstick, 1 us": _error(fine, case, {})}
    return errors


def _hosts(fmus: Mapping[str, Path], rounds: int) -> Figures:
    figures: Figures = {}
    for host in native_hosts.HOSTS:
        times: dict[str, native_hosts.Times] = {name: [] for name in fmus}
        reason = ""
        for name in [*fmus] * PROCESSES:
            measured, reason = native_hosts.run(host, rounds, fmus[name])
            if reason:
                break
            times[name] += measured
        figures[host] = reason or {
            name: {"cpu_us": statistics.median(cpu for cpu, _ in own),
                   "elapsed_us": sorted(elapsed for _, elapsed in own)} for name, own in times.items()}
    return figures


def _print(figures: Figures) -> None:
    c = figures["c_host"]
    print(f"1 ms step under a C host, CPU (the host's own {c['host_ns']:.0f} ns included)\n")
    print(f"{'':24}{'ns':>8}{'of the yardstick':>18}{'by process':>16}{'first us':>10}{'next us':>9}{'bytes':>7}")
    for name, of in c.items():
        if name != "host_ns":
            low, high = of["ratio_by_process"]
            print(f"{name:24}{of['step_ns']:8.0f}{of['ratio']:18.3f}{low:9.3f}-{high:.3f}"
                  f"{of['first_instance_us']:11.0f}{of['instance_us']:9.2f}{of['instance_bytes']:7}")
    errors = figures["accuracy_deg"]
    columns = list(next(iter(errors.values())))
    print("\nlargest difference of the fin angle to the stored references / deg (encoder off)\n")
    print(f"{'':24}" + "".join(f"{name:>18}" for name in columns))
    for case, of in errors.items():
        print(f"{case:24}" + "".join(f"{of[name]:18.5f}" for name in columns))
    print(f"{'worst':24}" + "".join(f"{max(of[name] for of in errors.values()):18.5f}" for name in columns))
    print("\n1 ms step under other hosts / us: median CPU (elapsed)\n")
    for host, measured in figures["hosts"].items():
        text = (f"not measured: {measured}" if isinstance(measured, str) else
                "   ".join(f"{name} {of['cpu_us']:.1f} ({of['elapsed_us'][0]:.1f}-{of['elapsed_us'][-1]:.1f})"
                           for name, of in measured.items()))
        print(f"{host:24}{text}")
    print(f"\nFMU file {figures['fmu_bytes'] / 1024:.0f} KiB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fmu", type=Path, help="native FMU to measure; the shipped one is built if not given")
    parser.add_argument("--processes", type=int, default=5, help="processes of the C host (default 5)")
    parser.add_argument("--rounds", type=int, default=40, help="rounds of a process (default 40)")
    parser.add_argument("--host-rounds", type=int, default=3,
                        help="rounds of each process under other hosts (default 3)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    parameters = load_parameters()
    values = parameters.values
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmu = arguments.fmu or build(parameters, folder / "EMCAS.fmu", backend="native", platforms=("linux64",)).path
        emcas = native_build.Unpacked(fmu, folder / "unpacked")
        own = (emcas.guid, emcas.resources)
        yardstick = native_build.compile_yardstick(values, folder / "yardstick")
        lean = native_build.compile_yardstick(values, folder / "lean", "-DWITHOUT_COS")
        slaves = {SOURCES: (*own, str(emcas.compiled())), SHIPPED: (*own, str(emcas.library)),
                  YARDSTICK: (*own, str(yardstick)), LEAN: (*own, str(lean))}
        host = native_build.compile_host(values, folder)
        contestants = {"EMCAS": fmu, YARDSTICK: native_build.packed(values, yardstick)}
        contestants["EMCAS in Python"] = build(parameters, folder / "EMCASPython.fmu").path
        figures: Figures = {
            "c_host": in_c(host, slaves, arguments.processes, arguments.rounds),
            "accuracy_deg": accuracy(fmu, values, folder),
            "hosts": _hosts(contestants, arguments.host_rounds),
            "fmu_bytes": fmu.stat().st_size,
        }
    _print(figures)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    missed = [f"{what} {of:.4g} (target: at most {target:g})" for what, of, target in (
        *((f"ratio to the yardstick, {name}", figures["c_host"][name]["ratio"], RATIO_TARGET)
          for name in (SOURCES, SHIPPED)),
        ("bytes of an instance", figures["c_host"][SHIPPED]["instance_bytes"], MEMORY_TARGET)) if of > target]
    print("\n" + ("; ".join(f"missed: {line}" for line in missed) if missed else "all targets met"))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

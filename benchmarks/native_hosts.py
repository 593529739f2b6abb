"""FMUs under hosts other people wrote: `run` times a 1 ms step, two inputs set and six outputs read.

Each FMU runs in processes of its own, since hosts keep threads that would disturb the next one's:

    python benchmarks/native_hosts.py HOST ROUNDS FMU

prints (CPU, elapsed) in microseconds per step, one for each round, as JSON. libcosim hands every step to a thread:
where that may run on another core, its times are mostly those of two threads waking each other, and differ from run
to run.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu

from emcas_fmu.fmi.interface import FmuInterface

STEP, STEPS, PERIOD = 1e-3, 2000, 500  # s; steps of a round; steps of a period of the signals
INPUTS = ("fin_command", "aero_torque")
OUTPUTS = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "hinge_torque", "supply_power")
REFERENCE = {v.name: i for i, v in enumerate(FmuInterface(1).variables)}

Round = Callable[[], None]
Times = list[tuple[float, float]]


def signals(step: int) -> tuple[float, float]:
    """Command [rad] and load [N.m] of a fin that never rests: 2 Hz at 10 deg against a load that follows it."""
    wave = math.sin(2.0 * math.pi * (step % PERIOD) / PERIOD)
    return math.radians(10.0) * wave, -60.0 * wave


def _fmpy(path: Path) -> Round:
    description, folder = read_model_description(str(path)), extract(str(path))
    instance = instantiate_fmu(folder, description, "CoSimulation")
    table = np.array([(k * STEP, *signals(k)) for k in range(STEPS + 1)],
                     dtype=[("time", float), *((name, float) for name in INPUTS)])

    def simulate() -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # fmpy lists the inputs that are not given
            result = simulate_fmu(folder, model_description=description, fmu_instance=instance, input=table,
                                  output=list(OUTPUTS), stop_time=STEPS * STEP, output_interval=STEP, terminate=False)
        if len(result) != STEPS + 1:
            raise RuntimeError(f"{path} stopped at {result['time'][-1]} s")
        instance.reset()

    return simulate


def _libcosimpy(path: Path) -> Round:
    execution = import_module("libcosimpy.CosimExecution").CosimExecution.from_step_size(round(STEP * 1e9))
    slave = import_module("libcosimpy.CosimSlave").CosimLocalSlave(fmu_path=str(path), instance_name="fin")
    index = execution.add_local_slave(slave)
    manipulator = import_module("libcosimpy.CosimManipulator").CosimManipulator.create_override()
    observer = import_module("libcosimpy.CosimObserver").CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    inputs, outputs = [REFERENCE[n] for n in INPUTS], [REFERENCE[n] for n in OUTPUTS]

    def simulate(kept: object = slave) -> None:
        for k in range(STEPS):
            manipulator.slave_real_values(index, inputs, list(signals(k)))
            if not execution.step():
                raise RuntimeError(f"{path} did not step")
            values = observer.last_real_values(index, outputs)
        if not any(values):
            raise RuntimeError(f"{path} did not move")

    return simulate


def _ecos(path: Path) -> Round:
    ecos = import_module("ecospy")
    ecos.EcosLib.set_log_level("warn")
    structure = ecos.EcosSimulationStructure()
    structure.add_model("fin", str(path))
    simulation = ecos.EcosSimulation(structure=structure, step_size=STEP)
    simulation.init()
    inputs, outputs = [f"fin::{n}" for n in INPUTS], [f"fin::{n}" for n in OUTPUTS]

    def simulate(kept: object = structure) -> None:
        for k in range(STEPS):
            for name, value in zip(inputs, signals(k), strict=True):
                simulation.set_real(name, value)
            simulation.step()
            values = [simulation.get_real(name) for name in outputs]
        if not any(values):
            raise RuntimeError(f"{path} did not move")

    return simulate


HOSTS: dict[str, tuple[Callable[[Path], Round], bool]] = {
    "fmpy": (_fmpy, False),
    "libcosimpy": (_libcosimpy, False),
    "libcosimpy, one core": (_libcosimpy, True),
    "Ecos": (_ecos, False),
}
"""How a round is made of an FMU, and whether the process keeps to one core."""


def run(host: str, rounds: int, fmu: Path) -> tuple[Times, str]:
    """Times of an FMU under a host, or none and why."""
    command = [sys.executable, __file__, host, str(rounds), str(fmu)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        times: Times = json.loads(done.stdout.splitlines()[-1])
        return times, ""
    reason = done.stderr.strip().splitlines()
    return [], reason[-1] if reason else f"ended with {done.returncode}"


def _timed(action: Round) -> tuple[float, float]:
    elapsed, cpu = time.perf_counter(), time.process_time()
    action()
    scale = 1e6 / STEPS
    return (time.process_time() - cpu) * scale, (time.perf_counter() - elapsed) * scale


def main() -> None:
    host, rounds, fmu = sys.argv[1:]
    make, pinned = HOSTS[host]
    if pinned and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    action = make(Path(fmu))
    action()
    print(json.dumps([_timed(action) for _ in range(int(rounds))]), flush=True)
    # Not by way of the interpreter's end: hosts' libraries outlive what they still refer to.
    os._exit(0)


if __name__ == "__main__":
    main()

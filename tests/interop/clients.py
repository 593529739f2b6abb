"""Run an FMU in another developer's client: `python -m tests.interop.clients CLIENT FMU TASK TABLE`.

TASK is a file with ``step`` [s], ``parameters`` (name to value) and ``inputs`` (name to a value for each step); the
value of an array is a list. TABLE is the file for time and every Real and Boolean output at the end of each step, with
a column for each element of an array. Messages of client and FMU go to standard output and error. Exit code 77: the
client is not installed.
"""

from __future__ import annotations

import csv
import importlib
import json
import logging
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

ABSENT = 77
Row = Iterable[Any]


@dataclass(frozen=True)
class Task:
    """A run of the FMU at `path`; the module's docstring describes the other fields."""

    path: Path
    step: float
    parameters: Mapping[str, Any]
    inputs: Mapping[str, list[Any]]

    @cached_property
    def description(self) -> Any:
        """The model description as fmpy reads it."""
        return read_model_description(str(self.path))

    @cached_property
    def references(self) -> Mapping[str, int]:
        """Value references by name."""
        return {v.name: v.valueReference for v in self.description.modelVariables}

    def outputs(self, *types: str) -> list[str]:
        """Return the names of outputs with these types of FMI."""
        return [v.name for v in self.description.modelVariables if v.causality == "output" and v.type in types]

    @cached_property
    def reals(self) -> list[str]:
        return self.outputs("Real", "Float64")

    @cached_property
    def flags(self) -> list[str]:
        return self.outputs("Boolean")

    @cached_property
    def steps(self) -> int:
        """Number of steps."""
        return len(next(iter(self.inputs.values())))

    def at(self, k: int) -> dict[str, Any]:
        """Return the inputs of a step."""
        return {name: values[k] for name, values in self.inputs.items()}


def _simulated(task: Task, path: Path, parameters: Mapping[str, Any] | None = None) -> Iterator[Row]:
    """Run the FMU or folder at `path` in fmpy's simulate_fmu."""
    names = [*task.reals, *task.flags]
    table = np.array([(k * task.step, *task.at(k).values()) for k in range(task.steps)],
                     dtype=[("time", float), *((name, float, np.shape(v[0])) for name, v in task.inputs.items())])
    found = simulate_fmu(str(path), stop_time=task.steps * task.step, step_size=task.step, output_interval=task.step,
                         start_values=dict(task.parameters if parameters is None else parameters), input=table,
                         output=names, debug_logging=True)
    for row in found[1:]:
        yield [row[name] for name in names]


def fmpy(task: Task) -> Iterator[Row]:
    """Validate and run the FMU in fmpy."""
    for problem in validate_fmu(str(task.path)):
        print(problem)
    return _simulated(task, task.path)


@contextmanager
def _without_progress() -> Iterator[None]:
    """Discard standard output, on which cmake prints its progress; it prints errors on standard error."""
    with Path(os.devnull).open("w") as null:
        output = os.dup(1)
        os.dup2(null.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(output, 1)
            os.close(output)


def rebuilt(task: Task) -> Iterator[Row]:
    """Build the binary from the FMU's sources with fmpy's cmake project, and run it in fmpy. Warnings are errors."""
    from fmpy.build import build_platform_binary

    with TemporaryDirectory() as unpacked, TemporaryDirectory() as build:
        extract(str(task.path), unpacked)
        shutil.rmtree(Path(unpacked) / "binaries")
        # cmake is installed with fmpy, in an environment that may not be activated.
        os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        with _without_progress():
            build_platform_binary(unpacked, build, all_warnings=True, cmake_options={"CMAKE_C_FLAGS:STRING": "-Werror"})
        yield from _simulated(task, Path(unpacked))


def libcosimpy(task: Task) -> Iterator[Row]:
    """Run libcosim with its fixed-step algorithm; the first inputs are initial values, the others are overridden."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    nanoseconds = round(task.step * 1e9)
    execution = CosimExecution.from_step_size(nanoseconds)
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=str(task.path), instance_name="fin"))
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    assert execution.add_observer(observer)
    assert execution.add_manipulator(manipulator)
    for name, value in {**task.parameters, **task.at(0)}.items():
        initial = execution.boolean_initial_value if isinstance(value, bool) else execution.real_initial_value
        assert initial(index, task.references[name], value)
    for k in range(task.steps):
        inputs = task.at(k)
        assert manipulator.slave_real_values(index, [task.references[n] for n in inputs], list(inputs.values()))
        execution.step()  # always False before version 0.0.6
        assert execution.status().current_time == (k + 1) * nanoseconds, execution.status()
        yield [*observer.last_real_values(index, [task.references[n] for n in task.reals]),
               *observer.last_boolean_values(index, [task.references[n] for n in task.flags])]


def ecospy(task: Task) -> Iterator[Row]:
    """Run Ecos with its fixed-step algorithm."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("fin", str(task.path))
        structure.add_parameter_set("begin", {f"fin::{n}": v for n, v in {**task.parameters, **task.at(0)}.items()})
        with EcosSimulation(structure=structure, step_size=task.step) as simulation:
            assert simulation.init(parameter_set="begin")
            for k in range(task.steps):
                for name, value in task.at(k).items():
                    simulation.set_real(f"fin::{name}", value)
                simulation.step()
                yield [*(simulation.get_real(f"fin::{n}") for n in task.reals),
                       *(simulation.get_bool(f"fin::{n}") for n in task.flags)]
            simulation.terminate()


def fmuloader(task: Task) -> Iterator[Row]:
    """Step the FMU with fmuloader."""
    from fmuloader import fmi2, fmi3

    logging.basicConfig(level=logging.DEBUG)
    model, version_3 = task.description, task.description.fmiVersion != "2.0"
    with (fmi3.Fmi3Slave if version_3 else fmi2.Fmi2Slave)(
            task.path, model_identifier=model.coSimulation.modelIdentifier) as slave:
        if version_3:
            slave.instantiate_co_simulation("fin", instantiation_token=model.guid, logging_on=True)
        else:
            slave.instantiate("fin", fmi2.Fmi2Type.CO_SIMULATION, guid=model.guid, logging_on=True)
            slave.setup_experiment(start_time=0.0)
        set_real, get_real = ((slave.set_float64, slave.get_float64) if version_3 else
                              (slave.set_real, slave.get_real))
        slave.enter_initialization_mode()
        for name, value in task.parameters.items():
            (slave.set_boolean if isinstance(value, bool) else set_real)([task.references[name]], [value])
        slave.exit_initialization_mode()
        for k in range(task.steps):
            inputs = task.at(k)
            set_real([task.references[n] for n in inputs], list(inputs.values()))
            slave.do_step(k * task.step, task.step)
            yield [*get_real([task.references[n] for n in task.reals]),
                   *slave.get_boolean([task.references[n] for n in task.flags])]
        slave.terminate()
        slave.free_instance()


def sofirpy(task: Task) -> Iterator[Row]:
    """Run sofirpy, which uses fmpy's slave; a model in Python is the source of the inputs."""
    from sofirpy import SimulationEntity, simulate

    class Source(SimulationEntity):  # type: ignore[misc]
        """A model whose outputs are the inputs of the next step."""

        at = 0

        def do_step(self, time: float) -> None:
            self.at = min(self.at + 1, task.steps - 1)

        def get_parameter_value(self, parameter_name: str) -> Any:
            return task.inputs[parameter_name][self.at]

        def set_parameter(self, parameter_name: str, parameter_value: float) -> None:
            raise NotImplementedError

    logging.disable(logging.INFO)  # sofirpy logs its progress
    names = [*task.reals, *task.flags]
    wires = [{"parameter_name": name, "connect_to_system": "source", "connect_to_external_parameter": name}
             for name in task.inputs]
    # Half a step more: sofirpy omits a last step that ends a rounding error after the stop time.
    found = simulate(stop_time=(task.steps + 0.5) * task.step, step_size=task.step, fmu_paths={"fin": task.path},
                     model_classes={"source": Source}, connections_config={"fin": wires},
                     start_values={"fin": {**task.parameters, **task.at(0)}}, parameters_to_log={"fin": names})
    for k in range(task.steps):
        yield found.iloc[k + 1][[f"fin.{name}" for name in names]]


def pathsim(task: Task) -> Iterator[Row]:
    """Run a block of pathsim-fmi; every input has a source, because pathsim would set one without a source to 0."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Source
    from pathsim_fmi import CoSimulationFMU

    rows: list[Row] = []

    class Recorded(CoSimulationFMU):  # type: ignore[misc]
        """The block, which also stores its outputs after each step."""

        def _step_fmu(self, t: float) -> None:
            super()._step_fmu(t)
            outputs = dict(zip(self.fmu_wrapper.output_refs, self.outputs.to_array()))
            rows.append([outputs[name] for name in (*task.reals, *task.flags)])

    def source(name: str, start: float) -> Any:
        values = task.inputs.get(name, [start])
        return Source(lambda t: values[min(round(t / task.step), len(values) - 1)])

    block = Recorded(str(task.path), start_values=dict(task.parameters), dt=task.step)
    sources = {v.name: source(v.name, float(v.start)) for v in task.description.modelVariables
               if v.causality == "input" and v.type in ("Real", "Float64")}
    wires = [Connection(block_of_input, block[name]) for name, block_of_input in sources.items()]
    Simulation([block, *sources.values()], wires, dt=task.step, log=False).run(task.steps * task.step)
    yield from rows[:task.steps]  # pathsim makes one more step at the end


def _program(name: str, *arguments: str | Path, cwd: Path | None = None,
             environment: Mapping[str, str] | None = None) -> None:
    """Run a program of the environment or of the system, and print its messages without progress."""
    program = shutil.which(name, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])) or name
    done = subprocess.run([program, *arguments], cwd=cwd, env={**os.environ, **(environment or {})},
                          capture_output=True, text=True)
    print("\n".join(line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("INFO")))
    if done.returncode:
        sys.exit(done.returncode)


def _words(value: Any) -> str:
    """Return a value, or the elements of an array, as text."""
    return " ".join(str(element).lower() for element in np.atleast_1d(value).tolist())


def fmutool(task: Task) -> Iterator[Row]:
    """Check the FMU with the FMU Manipulation Toolbox: schema and rules of the standard. It does not run the FMU."""
    _program("fmutool", "-input", task.path, "-check")
    yield from ()


def fmucontainer(task: Task) -> Iterator[Row]:
    """Pack the FMU into a container of the FMU Manipulation Toolbox, and run the container in fmpy."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        shutil.copy(task.path, folder / "fin.fmu")
        rows = ["rule;from_fmu;from_port;to_fmu;to_port", "FMU;fin.fmu;;;",
                *(f"START;fin.fmu;{name};{_words(value)};" for name, value in task.parameters.items())]
        (folder / "container.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        _program("fmucontainer", "-fmu-directory", ".", "-container", f"container.csv:{task.step}", "-fmi",
                 task.description.fmiVersion[0], cwd=folder)
        yield from _simulated(task, folder / "container.fmu", {})


def _in_fmusim(task: Task, environment: Mapping[str, str]) -> Iterator[Row]:
    with TemporaryDirectory() as temporary:
        inputs, table = Path(temporary) / "in.csv", Path(temporary) / "out.csv"
        with inputs.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *task.inputs])
            writer.writerows([k * task.step, *map(_words, task.at(k).values())] for k in range(task.steps))
        starts = [word for name, value in task.parameters.items() for word in ("--start-value", name, _words(value))]
        _program("fmusim", "--interface-type", "cs", "--stop-time", str(task.steps * task.step), "--output-interval",
                 str(task.step), *starts, "--input-file", inputs, "--output-file", table, "--logging-on", task.path,
                 environment=environment)
        with table.open(encoding="utf-8") as file:
            for row in list(csv.DictReader(file))[1:]:
                yield [row[name].split() for name in (*task.reals, *task.flags)]


def fmusim(task: Task) -> Iterator[Row]:
    """Run fmusim of the Reference FMUs with a table of inputs."""
    return _in_fmusim(task, {})


def fmusim_preloaded(task: Task) -> Iterator[Row]:
    """Run fmusim with Python's library preloaded."""
    library = Path(str(sysconfig.get_config_var("LIBDIR"))) / str(sysconfig.get_config_var("INSTSONAME"))
    return _in_fmusim(task, {"LD_PRELOAD": str(library)})


@dataclass(frozen=True)
class Client:
    """A client: its title on pages, package on PyPI, module to import, and system programs with their Debian packages.

    Without `whole` only angles can be compared: sofirpy reads outputs after it has set the inputs of the next step, and
    pathsim-fmi reads Booleans as Reals.
    """

    run: Callable[[Task], Iterator[Row]]
    title: str
    package: str
    module: str
    programs: tuple[tuple[str, str], ...] = ()
    whole: bool = True


_TOOLBOX = ("fmu-manipulation-toolbox", "fmu_manipulation_toolbox")
CLIENTS: Mapping[str, Client] = {
    "fmpy": Client(fmpy, "fmpy", "fmpy", "fmpy"),
    "rebuilt": Client(rebuilt, "fmpy: sources rebuilt by cmake", "fmpy", "fmpy",
                      (("make", "make"), ("gcc", "gcc"), ("g++", "g++"))),  # the cmake project requires C++
    "libcosimpy": Client(libcosimpy, "libcosim (libcosimpy)", "libcosimpy", "libcosimpy"),
    "ecospy": Client(ecospy, "Ecos (ecospy)", "ecospy", "ecospy", (("unzip", "unzip"),)),
    "sofirpy": Client(sofirpy, "sofirpy", "sofirpy", "sofirpy", whole=False),
    "pathsim": Client(pathsim, "pathsim-fmi", "pathsim-fmi", "pathsim_fmi", whole=False),
    "fmuloader": Client(fmuloader, "fmuloader", "fmuloader", "fmuloader"),
    "fmutool": Client(fmutool, "FMU Manipulation Toolbox: check", *_TOOLBOX),
    "fmucontainer": Client(fmucontainer, "FMU Manipulation Toolbox: container", *_TOOLBOX),
    "fmusim": Client(fmusim, "fmusim", "", "fmpy"),
    "fmusim_preloaded": Client(fmusim_preloaded, "fmusim with libpython preloaded", "", "fmpy"),
}
CHECKS = ("fmutool",)
"""Clients that do not run the FMU."""


def main(client: str, fmu: str, task_file: str, table: str) -> None:
    """Run the client, and write the table if there are results."""
    try:
        importlib.import_module(CLIENTS[client].module)
    except (ImportError, OSError) as error:  # OSError: a missing library
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    task = Task(Path(fmu), **json.loads(Path(task_file).read_text(encoding="utf-8")))
    rows = [[np.atleast_1d(value) for value in row] for row in CLIENTS[client].run(task)]
    if not rows:
        return
    names = [name if len(value) == 1 else f"{name}[{k + 1}]"
             for name, value in zip((*task.reals, *task.flags), rows[0]) for k in range(len(value))]
    with Path(table).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *names])
        for k, row in enumerate(rows):
            writer.writerow([(k + 1) * task.step, *(repr(float(x)) for x in np.concatenate(row))])


if __name__ == "__main__":
    main(*sys.argv[1:])

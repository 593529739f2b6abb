"""A step command under load through a co-simulation master: `python masters.py MASTER FMU ENCODER`.

Prints the trajectory as the host in C does, for the same inputs. Exit code 77: the
master is not installed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fmpy import extract, instantiate_fmu, read_model_description

STEP, STEPS = 1e-3, 300
ABSENT = 77
COMMAND = 0.2
Row = list[Any]


def load_at(step: int) -> float:
    """The hinge moment held during a step."""
    return 0.0 if step < 100 else -40.0


def with_fmpy(fmu: str, model: Any, encoder: bool, reals: list[Any], flags: list[Any]) -> Iterator[Row]:
    """fmpy's slave stepped by hand."""
    references = {v.name: v.valueReference for v in model.modelVariables}
    slave = instantiate_fmu(extract(fmu), model, "CoSimulation")
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.setBoolean([references["encoder.enabled"]], [encoder])
    slave.exitInitializationMode()
    slave.setReal([references["fin_command"]], [COMMAND])
    for k in range(STEPS):
        slave.setReal([references["aero_torque"]], [load_at(k)])
        slave.doStep(k * STEP, STEP)
        yield [*slave.getReal([v.valueReference for v in reals]), *slave.getBoolean([v.valueReference for v in flags])]
    slave.terminate()
    slave.freeInstance()


def with_cosim(fmu: str, model: Any, encoder: bool, reals: list[Any], flags: list[Any]) -> Iterator[Row]:
    """libcosim with its fixed-step algorithm; inputs overridden between steps, before the first one set as initial."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    references = {v.name: v.valueReference for v in model.modelVariables}
    nanoseconds = round(STEP * 1e9)
    execution = CosimExecution.from_step_size(nanoseconds)
    slave = CosimLocalSlave(fmu_path=fmu, instance_name="fin")
    index = execution.add_local_slave(slave)
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    assert execution.add_observer(observer)
    assert execution.add_manipulator(manipulator)
    assert execution.boolean_initial_value(index, references["encoder.enabled"], encoder)
    assert execution.real_initial_value(index, references["fin_command"], COMMAND)
    for k in range(STEPS):
        assert manipulator.slave_real_values(index, [references["aero_torque"]], [load_at(k)])
        execution.step()  # always False before version 0.0.6
        assert execution.status().current_time == (k + 1) * nanoseconds, execution.status()
        yield [*observer.last_real_values(index, [v.valueReference for v in reals]),
               *observer.last_boolean_values(index, [v.valueReference for v in flags])]


def with_ecos(fmu: str, model: Any, encoder: bool, reals: list[Any], flags: list[Any]) -> Iterator[Row]:
    """ecos with its fixed-step algorithm."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("fin", fmu)
        structure.add_parameter_set("begin", {"fin::encoder.enabled": encoder, "fin::fin_command": COMMAND})
        with EcosSimulation(structure=structure, step_size=STEP) as simulation:
            assert simulation.init(parameter_set="begin")
            for k in range(STEPS):
                simulation.set_real("fin::aero_torque", load_at(k))
                simulation.step()
                yield [*(simulation.get_real(f"fin::{v.name}") for v in reals),
                       *(simulation.get_bool(f"fin::{v.name}") for v in flags)]
            simulation.terminate()


MASTERS = {"fmpy": with_fmpy, "libcosimpy": with_cosim, "ecospy": with_ecos}


def main(master: str, fmu: str, encoder: str) -> None:
    """Print the trajectory."""
    try:
        __import__(master)
    except (ImportError, OSError) as error:  # OSError: a library it needs
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    model = read_model_description(fmu)
    outputs = [v for v in model.modelVariables if v.causality == "output"]
    reals = [v for v in outputs if v.type == "Real"]
    flags = [v for v in outputs if v.type == "Boolean"]
    lines = [",".join(["time", *(v.name for v in reals + flags)])]
    for k, row in enumerate(MASTERS[master](fmu, model, encoder == "1", reals, flags)):
        lines.append(",".join([repr((k + 1) * STEP), *(str(float(value)) for value in row)]))
    print("\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1], str(Path(sys.argv[2])), sys.argv[3])

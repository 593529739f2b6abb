"""CPU time of the FMU per simulated second, as ratios within one run.

    python benchmarks/benchmark.py [--fmu EMCAS.fmu] [--repeat 5] [--json FILE]

Compared in turn, round after round, so that a machine that changes its speed hurts all
alike: the FMU under fmpy at 1 ms (two inputs, six outputs), a trivial pythonfmu FMU with
the same inputs and outputs (the wrapper's own cost), SciPy's LSODA on the same equations
(traced to straight-line Python like the FMU's), and motulator's PMSM drive if installed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu
from scipy.integrate import solve_ivp

from emcas_fmu.control import controllers, sensors
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import drive, kinematics, mechanics
from emcas_fmu.physics.loads import NONE
from emcas_fmu.trace.python_source import python_source
from emcas_fmu.trace.tracer import Tracer
from tests.default_actuator import namespace

STOP, STEP = 2.0, 1e-3
INPUTS = ("fin_command", "aero_torque")
OUTPUTS = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "hinge_torque", "supply_power")
TRIVIAL = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Trivial(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in {inputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input, variability=Fmi2Variability.continuous))
        for name in {outputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.fin_angle = self.fin_command
        return True
'''


def _signals() -> np.ndarray:
    """A fin that never rests: 2 Hz at 10 deg against a load that follows it."""
    t = np.arange(round(STOP / STEP) + 1) * STEP
    signals = np.zeros(t.size, dtype=[("time", float), *((name, float) for name in INPUTS)])
    signals["time"] = t
    signals["fin_command"] = np.radians(10.0) * np.sin(4.0 * np.pi * t)
    signals["aero_torque"] = -60.0 * np.sin(4.0 * np.pi * t)
    return signals


def _trivial(folder: Path) -> Path:
    script = folder / "trivial_slave.py"
    script.write_text(textwrap.dedent(TRIVIAL.format(inputs=INPUTS, outputs=OUTPUTS)), encoding="utf-8")
    subprocess.run([sys.executable, "-m", "pythonfmu", "build", "-f", script.name], cwd=folder, check=True,
                   capture_output=True)
    return folder / "Trivial.fmu"


def _under_fmpy(path: Path) -> Callable[[], None]:
    description = read_model_description(str(path))
    folder = extract(str(path))
    instance = instantiate_fmu(folder, description, "CoSimulation")
    signals = _signals()

    def run() -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # fmpy lists the inputs that are not given
            result = simulate_fmu(folder, model_description=description, fmu_instance=instance, input=signals,
                                  output=list(OUTPUTS), stop_time=STOP, output_interval=STEP, terminate=False)
        if not np.isclose(result["time"][-1], STOP):
            raise RuntimeError(f"{path} stopped at {result['time'][-1]} s")
        instance.reset()

    return run


def _equations(values: Any) -> Any:
    """Right-hand side and controllers' sample, traced; Coulomb friction smoothed by tanh, as LSODA needs."""
    tracer = Tracer()
    p = namespace({name: tracer.parameter(name) for name in values})

    def right_hand_side(angle: Any, speed: Any, current: Any, xi: Any, reference: Any, load: Any, supply: Any) -> Any:
        m = mechanics.coefficients(tracer, p, angle, NONE.replace(aero_torque=load))
        i_ref = drive.current_reference(tracer, p, reference)
        demand = drive.voltage_demand(p, i_ref, current, xi)
        voltage = tracer.clip(demand, -supply, supply)
        smooth = 1.0 - 2.0 / (1.0 + tracer.exp(tracer.clip(2.0 * speed / 0.05, -50.0, 50.0)))
        torque = (drive.torque(p, current) - mechanics.breakaway(tracer, p, m, speed) * smooth
                  - mechanics.damping(tracer, p, m, speed) * speed + m.load + m.centrifugal * speed * speed)
        di = (voltage - p.motor.resistance * current - drive.back_emf(p, speed)) / p.motor.inductance
        held = tracer.where(tracer.fabs(demand) > supply, 0.0, p.drive.ki * (i_ref - current))
        return speed, torque / m.inertia, di, held

    def sample(angle: Any, speed: Any, current: Any, counts: Any, command: Any, integral: Any, velocity_integral: Any,
               target: Any, momentum: Any) -> Any:
        measured = sensors.measure(tracer, p, p, angle, angle, speed, counts)
        loops = controllers.Loops(integral, velocity_integral, target, momentum)
        out = controllers.sample(tracer, p, loops, measured, current, command)
        return out.reference, measured.motor_counts, *out.loops

    def fin(angle: Any) -> Any:
        return (kinematics.fin_angle(tracer, p, kinematics.lever_tangent(tracer, p, angle)),)

    for function in (right_hand_side, sample, fin):
        names = function.__code__.co_varnames[:function.__code__.co_argcount]
        tracer.function(function.__name__, names, function)
    space: dict[str, Any] = {}
    exec(python_source(tracer, "benchmark"), space)
    return space["make"](values)


def _lsoda(values: Any) -> Callable[[], None]:
    right_hand_side, sample, _ = _equations(values)
    signals = _signals()
    period, delay = values["controller.sample_time"], values["drive.transport_delay"]
    late = int(delay / period)
    fraction = delay - late * period

    def run() -> None:
        state, counts, loops, line = [0.0] * 4, 0.0, [0.0] * 4, [0.0] * (late + 2)
        for _, command, load in signals[:-1].tolist():
            reference, counts, *loops = sample(*state[:3], counts, command, *loops)
            line = [*line[1:], reference]
            for active, begin, end in ((line[0], 0.0, fraction), (line[1], fraction, period)):
                solution = solve_ivp(lambda _, y, u=active, f=load: right_hand_side(*y, u, f, 39.0), (begin, end),
                                     state, method="LSODA", rtol=1e-6, atol=1e-8)
                state = solution.y[:, -1].tolist()

    return run


def _motulator() -> Callable[[], None] | None:
    """motulator's current-controlled PMSM drive, speed loop closed, on a stiff shaft of the same inertia."""
    try:
        import motulator.drive.control.sm as control_of
        from motulator.drive import model
        from motulator.drive.utils import SynchronousMachinePars
    except ImportError:
        return None

    def run() -> None:
        machine = SynchronousMachinePars(n_p=4, R_s=0.25, L_d=0.6e-3, L_q=0.6e-3, psi_f=0.11 / 6.0)
        system = model.Drive(model.VoltageSourceConverter(u_dc=80.0), model.SynchronousMachine(machine),
                             model.StiffMechanicalSystem(J=3e-4))
        limits = control_of.CurrentReferenceCfg(machine, max_i_s=60.0, nom_w_m=4 * 300.0)
        controller = control_of.CurrentVectorControl(machine, limits, T_s=1e-3 / 4, J=3e-4, sensorless=False)
        controller.ref.w_m = lambda t: 300.0 * np.sin(4.0 * np.pi * t)
        model.Simulation(system, controller).simulate(t_stop=STOP)

    return run


def _memory(path: Path, count: int = 200) -> float:
    """Resident memory [KiB] of a further instance that has stepped."""
    description = read_model_description(str(path))
    folder = extract(str(path))

    def stepped() -> Any:
        instance = instantiate_fmu(folder, description, "CoSimulation")
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        instance.doStep(0.0, STEP)
        return instance

    kept = [stepped() for _ in range(20)]
    before = _resident()
    kept += [stepped() for _ in range(count)]
    grown = _resident() - before
    for instance in kept:
        instance.terminate()
        instance.freeInstance()
    return grown / count


def _resident() -> float:
    """KiB of this process in memory; Linux."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1024.0


def _cpu(action: Callable[[], None]) -> float:
    begin = time.process_time()
    action()
    return (time.process_time() - begin) / STOP


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fmu", type=Path, help="FMU to measure; the shipped one is built if not given")
    parser.add_argument("--repeat", type=int, default=5, help="rounds (default 5)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    parameters = load_parameters()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmu = arguments.fmu or build(parameters, folder / "EMCAS.fmu").path
        contestants = {"EMCAS.fmu": _under_fmpy(fmu), "trivial pythonfmu FMU": _under_fmpy(_trivial(folder)),
                       "SciPy LSODA": _lsoda(parameters.values)}
        drive_model = _motulator()
        if drive_model is not None:
            contestants["motulator PMSM drive"] = drive_model
        times: dict[str, list[float]] = {name: [] for name in contestants}
        memory = _memory(fmu)
        for action in contestants.values():
            action()
        for _ in range(arguments.repeat):
            for name, action in contestants.items():
                times[name].append(_cpu(action))
    ratios = {name: statistics.median(b / a for a, b in zip(times["EMCAS.fmu"], values, strict=True))
              for name, values in times.items()}
    print(f"{'':24}{'CPU ms per simulated s':>24}{'relative to EMCAS.fmu':>24}")
    for name, values in times.items():
        print(f"{name:24}{statistics.median(values) * 1e3:24.1f}{ratios[name]:24.2f}")
    wrapper, lsoda = 1.0 / ratios["trivial pythonfmu FMU"], ratios["SciPy LSODA"]
    print(f"EMCAS.fmu is {wrapper:.2f} x the trivial FMU (target: at most 2), "
          f"{lsoda:.1f} x faster than LSODA (target: at least 8)")
    print(f"a further instance takes {memory:.0f} KiB (target: at most 200)")
    if arguments.json:
        figures = {"cpu_s_per_s": times, "ratios": ratios, "instance_kib": memory}
        arguments.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    return 0 if wrapper <= 2.0 and lsoda >= 8.0 and memory <= 200.0 else 1


if __name__ == "__main__":
    sys.exit(main())

"""The Python and the native FMU respond to the same calls with the same bits."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from hypothesis import HealthCheck, event, example, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import fin_port
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.cases import CASES
from emcas_fmu.reference.stored import load
from emcas_fmu.support.files import models_directory
from tests.default_actuator import INPUTS, OUTPUTS, PARAMETERS, VARIABLES
from tests.marks import others_slow

from ..fmu.built import lean, unpacked
from ..fmu.built import slave_class as build_slave_class
from ..fmu.host import OK, Fmu, Instance
from ..simulation import ramped_core

ANGLE = 1e-9  # rad, the documented tolerance; measured: no difference
REALS, BOOLEANS = ([v.name for v in OUTPUTS if v.kind == kind] for kind in ("Real", "Boolean"))
INDEX = {v.name: i for i, v in enumerate(VARIABLES)}


@pytest.fixture(scope="module")
def library(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("parity")
    with zipfile.ZipFile(native) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


@pytest.fixture(scope="module")
def slave_class(values: Mapping[str, Any]) -> type[Slave]:
    return build_slave_class(FmuInterface(1), [values])


@pytest.mark.acceptance
@pytest.mark.parametrize("case", others_slow((case.name for case in CASES), lambda name: name not in (
    "chirp_1deg", "chirp_3p5deg", "square")))
def test_both_fmus_agree_on_reference_cases(units: Mapping[str, Path], case: str) -> None:
    """Run both FMUs in fmpy, as a user does."""
    (stored,) = load(models_directory() / "reference", [case])
    stop = min(stored.stop_time, 4.0)  # s: long sweeps up to 3 and 4 Hz, where limits act
    signals = np.zeros(len(stored.inputs["time"]), dtype=[(name, float) for name in stored.inputs])
    for name, column in stored.inputs.items():
        signals[name] = column
    runs = {backend: simulate_fmu(str(unit), stop_time=stop, output_interval=stored.step, input=signals,
                                  start_values=dict(stored.start_values), output=REALS,
                                  fmi_call_logger=None)
            for backend, unit in units.items()}
    for name in ("fin_angle", "measured_fin_angle"):
        assert np.abs(runs["python"][name] - runs["native"][name]).max() <= ANGLE
    assert np.ptp(runs["native"]["fin_angle"]) > 0.01


_UNIFORM = st.floats(-1.0, 1.0)
# Ranges without extremes, with which a run would be trivial or take very long.
_SPANS = {"controller.position.kp": (10.0, 200.0), "controller.position.ki": (0.0, 500.0),
          "controller.position.setpoint_weight": (0.0, 1.5), "controller.position.velocity_feedforward": (0.0, 1.0),
          "controller.velocity.kp": (0.005, 0.2), "controller.velocity.ki": (0.0, 2.0),
          "controller.load_observer": (0.0, 250.0),  # also at the longest sample time
          "controller.drive_antiwindup": (0.0, 50.0), "deviation.kinematics.moment_arm": (-0.1, 0.1),
          "deviation.kinematics.initial_angle": (-0.05, 0.05), "deviation.screw.lead": (-0.1, 0.1),
          "deviation.motor.torque_constant": (-0.3, 0.3), "deviation.friction.coulomb": (-1.0, 3.0),
          "deviation.friction.viscous": (-1.0, 5.0), "friction.temperature": (-20.0, 40.0),
          "compensation.gain": (0.0, 1.2), "drive.transport_delay": (0.0, 8e-3),
          "controller.sample_time": (4e-4, 4e-3), "solver.max_tick": (5e-5, 1e-3), "drive.ki": (0.0, 200.0),
          "motor.inductance": (1e-4, 3e-3), "friction.fin_coulomb": (0.0, 20.0), "friction.fin_viscous": (0.0, 5.0),
          "mass.fin": (0.0, 5.0), "center_of_mass.fin.x": (-0.2, 0.2), "mounting.azimuth": (-3.0, 3.0),
          "command.latency": (0.0, 8e-3), "command.resolution": (0.0, 0.02), "command.update_time": (0.0, 0.01),
          "fin.start_angle": (-0.4, 0.4), "kinematics.initial_angle": (-0.3, 0.3), "inertia.fin": (0.01, 0.5)}
_parameters = st.dictionaries(st.sampled_from(sorted(_SPANS)), st.floats(0.0, 1.0), max_size=8).map(
    lambda shares: {name: _SPANS[name][0] + share * (_SPANS[name][1] - _SPANS[name][0])
                    for name, share in shares.items()})
_flags = st.fixed_dictionaries({}, optional={
    **{name: st.booleans() for name in ("encoder.enabled", "encoder.on_fin", "loads.gravity")},
    "motor.pole_pairs": st.integers(0, 8)})
# Changes of a tunable parameter during a run.
_TUNED = [("controller.position.kp", 30.0), ("controller.position.kp", 90.0),
          ("controller.position.setpoint_weight", 0.8), ("controller.position.setpoint_weight", 1.0),
          ("controller.load_observer", 0.0), ("controller.load_observer", 120.0)]
_segments = st.lists(st.fixed_dictionaries({
    "inputs": st.fixed_dictionaries({
        "fin_command": _UNIFORM.map(lambda x: 0.5 * x), "aero_torque": _UNIFORM.map(lambda x: 250.0 * x),
        "supply_voltage": st.floats(0.0, 45.0), "enable": st.sampled_from([True, True, True, False])},
        optional={"acceleration.x": _UNIFORM.map(lambda x: 80.0 * x), "attitude.pitch": _UNIFORM,
                  "acceleration.z": _UNIFORM.map(lambda x: 80.0 * x), "attitude.roll": _UNIFORM,
                  "angular_rate.x": _UNIFORM.map(lambda x: 60.0 * x), "angular_rate.z": _UNIFORM,
                  "angular_acceleration.x": _UNIFORM.map(lambda x: 500.0 * x), "angular_acceleration.y": _UNIFORM}),
    "size": st.sampled_from([1e-4, 3.7e-4, 1e-3, 2.5e-3, 7e-3]), "steps": st.integers(1, 12),
    "restore": st.booleans(), "tuned": st.sampled_from([None, None, *_TUNED])}), min_size=1, max_size=8)


@settings(derandomize=True, max_examples=75,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(changes=_parameters, flags=_flags, segments=_segments)
@example(changes={}, flags={}, segments=[  # within a tick the supply changes, and later the load alone
    {"inputs": {"aero_torque": torque, "supply_voltage": supply}, "size": 1e-4, "steps": steps, "restore": False,
     "tuned": None} for torque, supply, steps in ((0.0, 39.0, 1), (0.0, 20.0, 1), (200.0, 20.0, 1), (-50.0, 20.0, 20))])
def test_both_fmus_agree_on_any_calls(library: Fmu, slave_class: type[Slave], changes: dict[str, float],
                                      flags: dict[str, int], segments: list[dict[str, Any]]) -> None:
    """Parameters, inputs, step sizes, restored states and tuning during the run."""
    native, python = Instance(library), slave_class(instance_name="fin")
    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    for name, value in (changes | flags).items():
        _set(python, name, value)
    python.exit_initialization_mode()
    accepted = max(native.initialize(**{n.replace(".", "__"): v for n, v in (changes | flags).items()})) == OK
    assert accepted == (not python._refusal), (python._refusal, native.log)
    time = 0.0
    for segment in segments if accepted else ():
        for name, value in segment["inputs"].items():
            _set(python, name, value)
            assert native.set(name, value) == OK
        if segment["tuned"] is not None:
            name, value = segment["tuned"]
            _set(python, name, value)
            assert native.set(name, value) == OK
        saved = (python._get_fmu_state(), native.save(), time) if segment["restore"] else None
        for _ in range(2 if saved else 1):
            for _ in range(segment["steps"]):
                done = python.do_step(time, segment["size"])
                assert done == (native.step(time, segment["size"]) == OK), native.log
                if not done:
                    event("a step that is refused")
                    break
                time += segment["size"]
            outputs = native.outputs()
            assert [outputs[name] for name in (*REALS, *BOOLEANS)] == [
                *python.get_real([INDEX[name] for name in REALS]),
                *python.get_boolean([INDEX[name] for name in BOOLEANS])]
            if saved:
                python._set_fmu_state(saved[0])
                assert native.call("SetFMUstate", saved[1]) == OK
                time = saved[2]
    native.free()


def test_outputs_follow_a_tuned_parameter_before_the_next_step(tmp_path: Path) -> None:
    """An open phase whose angle is tuned changes voltage and torque at once in both FMUs."""
    parameters = load_parameters(model="nonlinear+faults")
    interface = FmuInterface(1, parameters.model)
    native = Instance(unpacked(lean(parameters, tmp_path / "x.fmu"), tmp_path))
    python = build_slave_class(interface, [parameters.values])(instance_name="fin")
    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    python.exit_initialization_mode()
    assert max(native.initialize()) == OK
    real = [interface.reference[v.name] for v in interface.outputs if v.kind == "Real"]

    def both(kind: str, name: str, value: Any) -> None:
        assert native.set(name, value) == OK
        getattr(python, f"set_{kind}")([interface.reference[name]], [value])

    both("real", "fin_command", 0.2)
    both("boolean", "fault.phase_loss.active", True)
    for k in range(20):
        assert python.do_step(k * 1e-3, 1e-3)
        assert native.step(k * 1e-3, 1e-3) == OK
    before = python.get_real(real)
    both("real", "fault.phase_loss.angle", 0.15)
    assert python.get_real(real) == native.get_vr("Real", real)[1] != before
    native.free()


def _set(slave: Slave, name: str, value: Any) -> None:
    kind = VARIABLES[INDEX[name]].kind
    {"Real": slave.set_real, "Boolean": slave.set_boolean, "Integer": slave.set_integer}[kind]([INDEX[name]], [value])


@settings(derandomize=True, max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rates=st.tuples(*(st.floats(-1.0, 1.0) for _ in range(7))), sizes=st.lists(
    st.sampled_from([2e-4, 1e-3, 1.7e-3, 5e-3]), min_size=1, max_size=15))
def test_input_derivatives(library: Fmu, values: Mapping[str, Any], rates: tuple[float, ...], sizes: list[float]
                           ) -> None:
    """The native FMU with input derivatives and a Python core with ramps agree to the bit."""
    native, core = Instance(library), ramped_core(values)
    native.initialize()
    scales = {"fin_command": 3.0, "aero_torque": 500.0, "acceleration.x": 2e3, "acceleration.z": 2e3,
              "supply_voltage": 30.0, "angular_rate.x": 300.0, "angular_acceleration.x": 5e3}
    slopes = {name: scale * rate for (name, scale), rate in zip(scales.items(), rates, strict=True)}
    time = 0.0
    for size in sizes:
        now = {name: (39.0 if name == "supply_voltage" else 0.0) + slope * time for name, slope in slopes.items()}
        for name, value in now.items():
            native.set(name, value)
            native.differentiate(name, 1, slopes[name])
        assert native.step(time, size) == OK
        begin, end = time, time + size
        then = {name: value + slopes[name] * (end - begin) for name, value in now.items()}
        loads, loads_then = (core.motion_loads(*(inputs.get(v.name, 0.0) for v in fin_port.VEHICLE_MOTION))
                             for inputs in (now, then))
        rise = ((b - a) / (end - begin) for a, b in zip(loads, loads_then, strict=True))
        outputs = core.run(end, (now["fin_command"], now["aero_torque"], *loads, now["supply_voltage"], True),
                           (begin, (slopes["fin_command"], slopes["aero_torque"], *rise, slopes["supply_voltage"])))
        assert native.get("fin_angle") == outputs[0]
        assert native.get("motor_current") == outputs[4]
        time = end
    native.free()


def test_both_fmus_refuse_parameters_with_the_same_message(library: Fmu, slave_class: type[Slave]) -> None:
    """Every rule, and every limit of every parameter."""
    bad: list[dict[str, Any]] = [
        {"fin.stop_angle": 0.1}, {"fin.start_angle": 0.5}, {"kinematics.initial_angle": 1.04, "fin.stop_angle": 0.6},
        {"drive.transport_delay": 0.1}, {"encoder.multiplier": 3}, {"command.latency": 0.021},
        {"friction.table.temperature[2]": 60.0},
        {"friction.coulomb.positive[0]": -1e-3}, {"friction.coulomb.negative[1]": 5.0},
        {"drive.ki": 1e6, "motor.inductance": 1e-7, "controller.sample_time": 0.1},
        {"motor.resistance": float("nan")}]
    bad += [{v.name: v.minimum - 1.0} for v in PARAMETERS if v.kind == "Real"]
    bad += [{v.name: v.maximum + 1.0} for v in PARAMETERS if v.kind == "Real"]
    for changes in bad:
        native, python = Instance(library), slave_class(instance_name="fin")
        python.setup_experiment(0.0)
        python.enter_initialization_mode()
        for name, value in changes.items():
            _set(python, name, value)
        python.exit_initialization_mode()
        native.initialize(**{n.replace(".", "__"): v for n, v in changes.items()})
        messages = [message for _, message in native.log]
        assert "; ".join(messages) == python._refusal, changes
        assert messages
        native.free()


@pytest.fixture(autouse=True)
def quiet(capsys: pytest.CaptureFixture[str]) -> Iterator[None]:
    """Discard the Python FMU's refusals and fmpy's missing inputs on standard error."""
    yield
    capsys.readouterr()


def test_fmu_inputs_are_those_of_the_declaration(library: Fmu) -> None:
    assert list(library.references)[:len(INPUTS)] == [v.name for v in INPUTS]

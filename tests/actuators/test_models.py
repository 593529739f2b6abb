"""The simpler actuators: against closed forms, against each other, and as FMUs behind the one interface."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

from emcas_fmu.actuators import NAMES, NONLINEAR, fin_port, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.fitting import MODEL, fit, write_fitted

from ..fmu.built import both
from ..fmu.built import slave_class as local_class
from ..fmu.host import OK, Fmu, Instance
from ..marks import others_slow

OTHERS = [name for name in NAMES if name != NONLINEAR]


def test_linear_is_the_thesis_linear_model() -> None:
    """Against matrix exponentials: of second order in the tick, and closer than the encoder can tell at the default."""
    command = np.full(301, 0.1)
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):  # which halves the parts of a sample time too
        values = load_parameters(model="linear").with_values({
            "solver.max_tick": tick, "drive.transport_delay": 3.5e-3}).values
        found = simulate(values, 0.3, model="linear", fin_command=command)["fin_angle"]
        errors.append(np.abs(found - LinearModel(values).simulate(command)).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.3), slopes  # the order, away from its asymptote
    assert np.degrees(errors[0]) < 1e-4  # of 5.7 deg; a count is 7e-4 deg at the fin


def test_linear_is_linear_in_commands_and_loads() -> None:
    values = load_parameters(model="linear").values

    def response(command: float, torque: float) -> Any:
        return simulate(values, 0.2, model="linear", fin_command=command, aero_torque=torque)["fin_angle"]

    both = response(0.1, -40.0)
    # A tick is cut where its motion reverses: no more apart than the error of ticks, 8e-5 deg (above).
    assert both == pytest.approx(response(0.1, 0.0) + response(0.0, -40.0), abs=radians(8e-5))
    assert 2.0 * response(0.05, 0.0) == pytest.approx(response(0.1, 0.0), abs=1e-12)


def test_linear_with_p_control_leaves_the_load_s_error() -> None:
    """Final value, section 4.1: T_f/N over K_pos K_vel K_v K_t times the prompt share of the drive's current."""
    values = load_parameters(model="linear").with_values({"controller.position.ki": 0.0, "drive.ki": 0.0}).values
    run = simulate(values, 1.0, model="linear", aero_torque=-30.0)
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    share = values["drive.kp"] / (values["drive.kp"] + values["motor.resistance"])
    stiffness = (values["controller.position.kp"] * values["controller.velocity.kp"] * values["drive.current_gain"]
                 * values["motor.torque_constant"] * share)
    # The inertia's loops have settled to 1e-6 after a second.
    assert run["fin_angle"][-1] == pytest.approx(-30.0 / ratio / stiffness / ratio, rel=1e-4)


@pytest.mark.parametrize("damping", [0.0, 0.2, 0.7, 1.0, 1.0 + 1e-10, 1.5, 30.0])
def test_second_order_is_its_closed_form(damping: float) -> None:
    values = load_parameters(model=MODEL).with_values({
        "second_order.damping": damping, "second_order.rate_limit": 1e5, "drive.transport_delay": 0.0}).values
    frequency = values["second_order.natural_frequency"]
    run = simulate(values, 0.2, model=MODEL, fin_command=0.05)
    system = ([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2])
    _, exact, _ = lsim(system, np.full(len(run["time"]), 0.05), run["time"])
    # Both exact for a held command: rounding, 1e-9 relative where two roots are taken for a double one.
    assert run["fin_angle"] == pytest.approx(exact, abs=1e-10)


def test_second_order_keeps_its_limits() -> None:
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.3, 1e-4, model=MODEL, fin_command=lambda t: 0.34 if t < 0.15 else -0.34)
    limit = values["second_order.rate_limit"]
    assert np.abs(run["fin_rate"]).max() == pytest.approx(limit, rel=1e-12)
    slewing = np.abs(run["fin_rate"]) > limit * (1.0 - 1e-9)
    assert slewing.sum() > 500
    assert np.all(run["saturated"][slewing] > 0.0)
    inner = slewing[1:] & slewing[:-1]
    travelled = np.abs(np.diff(run["fin_angle"])[inner])
    assert np.median(travelled) == pytest.approx(limit * 1e-4, rel=1e-9)
    assert travelled == pytest.approx(limit * 1e-4, rel=0.1)  # in the tick in which the limit is met or left


def test_second_order_rate_limit_converges() -> None:
    """The onset of the limit within a tick is met to second order."""
    def run(tick: float) -> Any:
        values = load_parameters(model=MODEL).with_values({"solver.max_tick": tick}).values
        return simulate(values, 0.2, model=MODEL, fin_command=0.3)["fin_angle"]

    finest = run(1e-6)
    errors = [np.abs(run(tick) - finest).max() for tick in (4e-4, 2e-4, 1e-4)]
    assert np.degrees(errors[0]) < 0.01  # of 17 deg, at half the largest tick
    # Second order over a factor of four is 16; where the limit falls within a tick moves it either way.
    assert errors[2] < errors[0] / 6.0


def test_second_order_stands_where_it_is_disabled() -> None:
    """At once, despite delayed commands; the motion then continues from there."""
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.3, model=MODEL, fin_command=0.3, enable=lambda t: not 0.05 <= t + 1e-9 < 0.1)
    assert 0.05 < run["fin_angle"][50] < 0.25
    assert np.all(run["fin_angle"][50:101] == run["fin_angle"][50])
    assert np.all(run["fin_rate"][51:101] == 0.0)
    assert run["fin_angle"][-1] == pytest.approx(0.3, abs=1e-3)


def test_second_order_shows_the_fin_port_alone() -> None:
    """Its moment is that on the fin, though it moves nothing; it has no motor, no supply and nothing always 0."""
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.1, model=MODEL, fin_command=0.4, aero_torque=-12.0)
    assert set(run) == {"time", "fin_angle", "fin_rate", "hinge_torque", "tracking_error", "measured_fin_angle",
                        "saturated", "at_stop"}
    assert run["hinge_torque"] == pytest.approx(-12.0)
    assert run["tracking_error"] == pytest.approx(values["command.limit"] - run["fin_angle"], abs=1e-15)
    assert np.all(run["saturated"][2:] > 0.0)  # the command is beyond its limit from the first sample on


def test_second_order_stops() -> None:
    values = load_parameters(model=MODEL).with_values({
        "fin.stop_angle": radians(20.0), "second_order.damping": 0.1, "second_order.rate_limit": 1e3}).values
    run = simulate(values, 0.5, 1e-4, model=MODEL, fin_command=radians(19.5))
    # It leaves the stop at w_n^2 0.5 deg = 720 rad/s2, by 3.6e-6 rad within a row.
    assert radians(20.0) - 4e-6 < run["fin_angle"].max() <= radians(20.0)
    assert run["fin_angle"][-1] < radians(20.0)


def test_fit_finds_what_is_known() -> None:
    """The nonlinear set as shipped: better than ideal by far, and the shipped file is this fit."""
    found = fit(load_parameters())
    assert max(found.rms) < 6.0  # % of the step; a fin that rests at its command has 20 and more
    shipped = load_parameters(model=MODEL).values
    # Four digits are written; the last may move with the compiler.
    for name, value in found.parameters.values.items():
        assert shipped[name] == pytest.approx(value, rel=2e-3), name


def test_a_fit_at_a_bound_is_warned_of() -> None:
    found = fit(load_parameters())
    assert (found.at_bound, found.warnings) == ({}, ())
    found = replace(found, parameters=found.parameters.with_values({"second_order.damping": 3.0}))
    assert found.figures()["at_bound"] == {"second_order.damping": "upper"}
    warning, = found.warnings
    assert warning.startswith("second_order.damping = 3 is at the upper bound of the fit")


def test_fit_keeps_the_actuator(tmp_path: Path) -> None:
    """The file holds all that the set has changed: it is the fitted set again."""
    mine = load_parameters().with_values({"command.limit": radians(25.0), "fin.stop_angle": radians(28.0),
                                      "kinematics.moment_arm": 0.06, "encoder.pulses": 1024,
                                      "friction.coulomb.positive[1]": 0.02, "loads.gravity": True})
    found = fit(mine)
    write_fitted(found, tmp_path / "fitted.toml", "a test")
    again = load_parameters(tmp_path / "fitted.toml", model=MODEL)
    assert dict(again.values) == dict(found.parameters.values)
    assert again.values["command.limit"] == radians(25.0)


def test_registry_and_files() -> None:
    with pytest.raises(EmcasError, match=r"no actuator 'hydraulic';.* there is nonlinear, linear"):
        get("hydraulic")
    # A name has the same meaning everywhere: the same unit, limits and kind, with any description. How far an
    # output can go is the actuator's: a pump gives no power back. So is how far it turns: a servo has no lever.
    turns = {"command.limit", "fin.stop_angle", "fin.start_angle"}
    meant: dict[str, Any] = {}
    for v in (v for name in NAMES for v in get(name).inputs + get(name).outputs + get(name).file_entries):
        limits = () if v.causality == "output" or v.name in turns else (v.minimum, v.maximum)
        same = (v.kind, v.causality, v.variability, v.unit, *limits)
        assert meant.setdefault(v.name, same) == same, v.name
    assert {"second_order.damping", "pwm.gain"} <= set(meant)
    with pytest.raises(ParameterError, match="the nonlinear actuator has no such parameter"):
        load_parameters().with_values({"second_order.damping": 0.5})
    with pytest.raises(ParameterError, match=r"second_order.damping = -1\.0"):
        load_parameters(model=MODEL).with_values({"second_order.damping": -1.0})


# -- FMUs -------------------------------------------------------------------------


@pytest.fixture(scope="module", params=others_slow(OTHERS, lambda name: name == "second-order"))
def model(request: pytest.FixtureRequest) -> str:
    chosen: str = request.param
    return chosen


@pytest.fixture(scope="module")
def built(model: str, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    return both(load_parameters(model=model), tmp_path_factory.mktemp("models"))


@pytest.mark.fmu
@pytest.mark.parametrize("backend", ["python", "native"])
def test_the_interface_is_the_actuator_s_with_the_fin_port(model: str, built: Mapping[str, Path], backend: str) -> None:
    """What is there in the FMU is what is declared; the fin port is in each, its inputs first and in one order."""
    assert validate_fmu(str(built[backend])) == []
    described = read_model_description(str(built[backend])).modelVariables
    actuator = get(model)
    assert [(v.name, v.causality) for v in described] == [
        (v.name, v.causality) for v in actuator.inputs + actuator.outputs + actuator.parameters]
    names = [v.name for v in described]
    assert names[:8] == [v.name for v in FmuInterface(1).variables[:8]]
    assert {v.name for v in (*fin_port.inputs(), *fin_port.OUTPUTS, *fin_port.PARAMETERS)} <= set(names)


_segments = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-150.0, 150.0), st.sampled_from([True, True, False]),
                               st.sampled_from([2.3e-4, 1e-3, 4.1e-3]), st.integers(1, 20)), min_size=1, max_size=6)


@pytest.mark.fmu
@settings(derandomize=True, max_examples=20,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(segments=_segments)
def test_both_back_ends_are_one_model(model: str, library: Fmu, slave_class: type[Slave], segments: list[Any]) -> None:
    index = FmuInterface(1, model).reference
    native, python = Instance(library), slave_class(instance_name="fin")
    assert max(native.initialize()) == OK
    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    python.exit_initialization_mode()
    time = 0.0
    for command, torque, enable, size, steps in segments:
        python.set_real([index["fin_command"], index["aero_torque"]], [command, torque])
        python.set_boolean([index["enable"]], [enable])
        native.set("fin_command", command)
        native.set("aero_torque", torque)
        native.set("enable", enable)
        for _ in range(steps):
            assert python.do_step(time, size)
            assert native.step(time, size) == OK
            time += size
        reals = [v.name for v in get(model).outputs if v.kind == "Real"]
        assert python.get_real([index[name] for name in reals]) == [native.get(name) for name in reals]
    native.free()


@pytest.fixture(scope="module")
def library(built: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(built["native"]) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


@pytest.fixture(scope="module")
def slave_class(model: str) -> type[Slave]:
    return local_class(FmuInterface(1, model), [load_parameters(model=model).values])

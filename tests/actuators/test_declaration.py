"""Declarations: further inputs that act on the plant, FMUs of every actuator, unused parameters, direct inputs.

The actuator with further inputs is driven.py beside this file.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from math import inf, nan, sin
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, fin_port, get, get_extension
from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.actuators.state import State
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.halves import PLANT
from emcas_fmu.fmi.description import terminals_and_icons, to_bytes
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import check_combinations, load_parameters
from emcas_fmu.physics.loads import NONE
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.core import Core
from emcas_fmu.simulation import simulate
from emcas_fmu.trace.c_source import CWriter
from emcas_fmu.trace.tracer import Expr
from emcas_fmu.variables import real_input
from tests.runs import run_both_kernels

from ..fmu.built import both
from ..fmu.built import slave_class as local_class
from ..fmu.host import OK, Fmu, Instance
from ..marks import others_slow, slow
from ..simulation import CompiledCore, ramped_core

DRIVEN = str(Path(__file__).with_name("driven.py"))
RATED = 2e5  # Pa


def _with_all(name: str, *without: str) -> str:
    """Return an actuator's name with every extension that it can have except `without`, in their order."""
    for extension in EXTENSIONS:
        if extension not in without and get(name).provides.issuperset(get_extension(extension).needs):
            name += f"+{extension}"
    return name


# LuGre friction replaces Stribeck friction: the last model has the former.
WITH_EXTENSIONS = [*NAMES, *map(_with_all, NAMES), _with_all("nonlinear", "stribeck")]
# Programs that take seconds to trace. The other models together have every extension, and every actuator.
LARGE = frozenset(_with_all(name) for name in (
    "nonlinear", "elastic", "habibi", "worm-gear", "worm-gear-elastic"))
QUICK = [model for model in WITH_EXTENSIONS if model not in LARGE]
# With module scope, all tests of one model run consecutively, so that the model is traced once.
each_traced_once = pytest.mark.parametrize(
    "model", others_slow(WITH_EXTENSIONS, QUICK.__contains__), scope="module")


def core_inputs(pressure: float = RATED, drift: float = 0.0, boost: bool = False, command: float = 0.1,
                moment: float = 0.0) -> tuple[Any, ...]:
    """Return inputs in a core's order: of the fin port, those that act on the plant, the Boolean that samples read."""
    return codegen.inputs_at_rest(command, moment, 0.0, True, pressure, drift, boost)


def ramp_rates(command: float, moment: float, pressure: float, drift: float) -> tuple[Any, ...]:
    """Return rates of change in a core's order, of all inputs except enable and the Boolean."""
    return (*codegen.inputs_at_rest(command, moment, 0.0)[:-1], pressure, drift)


# -- a further input that acts on the plant -----------------------------------------


def test_inputs_that_act_on_the_plant_come_before_those_of_samples() -> None:
    names = [v.name for v in get(DRIVEN).inputs]
    assert names[-4:] == ["enable", "hydraulic.pressure", "drift", "boost"]
    assert codegen.direct_inputs(DRIVEN)["flow"] == ("hydraulic.pressure",)
    assert "boosted" not in codegen.direct_inputs(DRIVEN)


def test_kernels_agree_with_further_inputs() -> None:
    values = load_parameters(model=DRIVEN).values
    inputs: dict[str, Any] = {
        "fin_command": lambda t: 0.2 * sin(25.0 * t), "hydraulic__pressure": lambda t: RATED * (1.0 + sin(90.0 * t)),
        "drift": lambda t: 0.1 * sin(7.0 * t), "boost": lambda t: 0.1 < t < 0.2, "enable": lambda t: t < 0.25,
        "aero_torque": lambda t: 60.0 * sin(40.0 * t)}
    run = run_both_kernels(values, 0.3, DRIVEN, 0.37e-3, **inputs)
    constant_pressure = simulate(values, 0.3, 0.37e-3, model=DRIVEN, **{**inputs, "hydraulic__pressure": RATED})
    assert np.abs(constant_pressure["fin_angle"] - run["fin_angle"]).max() > 1e-3
    assert set(np.unique(run["boosted"])) == {1.0, 2.0}


def _cores() -> tuple[Core, CompiledCore]:
    values = load_parameters(model=DRIVEN).values
    return codegen.core(values, DRIVEN), CompiledCore(values, DRIVEN)


@pytest.mark.parametrize("name", ["pressure", "drift"])
def test_a_tick_is_split_where_an_input_of_the_plant_changes(name: str) -> None:
    """The change is 0.2 ms after the start of a tick of 0.5 ms: the new value acts for the other 0.3 ms."""
    values = load_parameters(model=DRIVEN).values
    actuator, p = get(DRIVEN), get(DRIVEN).namespace(values)
    before: dict[str, Any] = {"pressure": RATED, "drift": 0.0}
    after = before | {name: {"pressure": 0.25 * RATED, "drift": 0.5}[name]}
    assert codegen.core(values, DRIVEN).schedule[1:4] == (0, 2, 0.0)
    starts, rows = [], []
    for core in _cores():
        starts.append(core.run(0.01, core_inputs(**before)))
        rows.append([core.run(0.0102, core_inputs(**before)), core.run(0.0102, core_inputs(**before)),
                     core.run(0.0103, core_inputs(**after)), core.run(0.0105, core_inputs(**after))])
    assert rows[0] == rows[1]

    def stepped(x: Record, levels: Mapping[str, float], h: float) -> Record:
        u = PlantInputs(reference=0.1, **vars(NONE), supply=0.0, enabled=True, gain=1.0, rated_current_limit=None,
                        hydraulic_pressure=levels["pressure"], drift=levels["drift"])
        states, used = actuator.step(FLOATS, p, x, u, h)
        assert used == h
        return Record(**states)

    start = Record(fin_angle=starts[0][0], fin_rate=starts[0][1])
    expected = stepped(stepped(start, before, 0.0102 - 0.01), after, 0.0003)
    # The lengths of the parts are differences of multiples of 0.1 ms, and so rounded.
    assert rows[0][-1][:2] == pytest.approx((expected.fin_angle, expected.fin_rate), rel=1e-12)
    assert abs(rows[0][-1][1] - stepped(start, after, 0.0005).fin_rate) > 1e-4


@pytest.mark.parametrize("kernel", [0, 1])
def test_communication_steps_do_not_matter_under_constant_inputs(kernel: int) -> None:
    ends = []
    for size in (5e-3, 1e-3, 0.37e-3, 0.11e-3):
        core, time = _cores()[kernel], 0.0
        inputs = core_inputs(1.3 * RATED, 0.05, True, moment=20.0)
        for end in (0.02, 0.05):
            while time + size < end - 1e-9:
                time += size
                core.run(time, inputs)
            time = end
            outputs = core.run(end, inputs)
        ends.append(outputs)
    assert ends[0] == ends[1] == ends[2] == ends[3]


def test_a_ramp_is_the_limit_of_small_steps() -> None:
    """A pressure that rises from 0 by 20 MPa/s acts like steps of 1 us, each with the pressure of its middle."""
    values = load_parameters(model=DRIVEN).values
    core, fine, coarse, slope = ramped_core(values, DRIVEN), *_cores(), 2e7
    ramped = [core.run(5e-3 * k, core_inputs(slope * 5e-3 * (k - 1)),
                       (5e-3 * (k - 1), ramp_rates(0.0, 0.0, slope, 0.0)))[0] for k in range(1, 5)]
    for k in range(20_000):
        expected = fine.run((k + 1) * 1e-6, core_inputs(slope * (k + 0.5) * 1e-6))[0]
    # A tick uses the pressure of its middle: an error of second order in 0.5 ms, a twentieth of the time constant.
    assert ramped[-1] == pytest.approx(expected, rel=2e-3)
    for k in range(1, 5):
        stepped = coarse.run(5e-3 * k, core_inputs(slope * 5e-3 * (k - 1)))[0]
    assert abs(stepped - expected) > 0.1 * expected


# -- FMUs of every actuator except the default one, and of several fins --------------

FMUS = [(DRIVEN, 1), ("second-order", 1), *slow(*(((name, 1),) for name in NAMES if name not in (
    NONLINEAR, "second-order")), ((DRIVEN, 3),), (("second-order", 3),), (("second-order+faults", 2),))]


@pytest.fixture(scope="module", params=FMUS, ids=lambda fmu: f"{Path(fmu[0]).stem}-{fmu[1]}")
def unit(request: pytest.FixtureRequest) -> FmuInterface:
    kind, fins = request.param
    return FmuInterface(fins, kind)


@pytest.fixture(scope="module")
def built(unit: FmuInterface, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    return both(load_parameters(model=unit.kind), tmp_path_factory.mktemp("declared"), unit.fins)


@pytest.fixture(scope="module")
def library(built: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(built["native"]) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


@pytest.fixture(scope="module")
def slave_class(unit: FmuInterface) -> type[Slave]:
    one = load_parameters(model=unit.kind)
    return local_class(unit, [p.values for p in ([one] if unit.fins == 1 else fin_sets(one, unit.fins, "cross", {}))])


@pytest.mark.fmu
@pytest.mark.parametrize("backend", ["python", "native"])
def test_fmu_has_the_declared_variables(unit: FmuInterface, built: Mapping[str, Path], backend: str) -> None:
    """With one fin they are the actuator's, in its order, and first those of the fin port."""
    assert validate_fmu(str(built[backend])) == []
    described = read_model_description(str(built[backend])).modelVariables
    assert [(v.name, v.causality) for v in described] == [(v.name, v.causality) for v in unit.variables]
    names, actuator = [v.name for v in described], unit.actuator
    if unit.fins == 1:
        assert names == [v.name for v in actuator.inputs + actuator.outputs + actuator.parameters]
        assert names[:8] == [v.name for v in FmuInterface(1).variables[:8]]
        assert {v.name for v in (*fin_port.inputs(), *fin_port.OUTPUTS, *fin_port.PARAMETERS)} <= set(names)
    with zipfile.ZipFile(built[backend]) as archive:
        page = archive.read("documentation/index.html").decode()
    for v in actuator.further_inputs:
        assert v.name in page
    if actuator.supply is None:
        assert not [name for name in names if "bus" in name or "supply" in name]
        assert "supply_voltage" not in page


_fin_inputs = st.tuples(st.floats(-0.5, 0.5), st.floats(-150.0, 150.0), st.sampled_from([True, True, False]),
                 st.floats(0.0, 2.0 * RATED), st.booleans())
_segments = st.lists(st.tuples(st.lists(_fin_inputs, min_size=3, max_size=3), st.floats(-0.2, 0.2),
                               st.sampled_from([0.9e-4, 2.3e-4, 1e-3, 4.1e-3]), st.integers(1, 20), st.booleans()),
                     min_size=1, max_size=6)


@pytest.mark.fmu
@settings(derandomize=True, max_examples=30,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(segments=_segments)
def test_both_back_ends_agree(unit: FmuInterface, library: Fmu, slave_class: type[Slave], segments: list[Any]) -> None:
    """All outputs agree to the bit, with different inputs of each fin, changes within ticks, and restored states."""
    native, python = Instance(library), slave_class(instance_name="fin")
    assert max(native.initialize()) == OK
    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    python.exit_initialization_mode()
    index, kinds = unit.reference, {v.name: v.kind for v in unit.variables}

    def set_input(name: str, value: Any) -> None:
        if name in index:
            {"Real": python.set_real, "Boolean": python.set_boolean}[kinds[name]]([index[name]], [value])
            assert native.set(name, value) == OK

    def python_outputs() -> list[Any]:
        getters: dict[str, Any] = {"Real": python.get_real, "Boolean": python.get_boolean}
        return [getters.get(v.kind, python.get_integer)([index[v.name]])[0] for v in unit.outputs]

    time = 0.0
    for fin_inputs, shared, size, steps, repeat in segments:
        saved = (python._get_fmu_state(), native.save(), time) if repeat else None
        for _ in range(2 if repeat else 1):
            for fin, (command, torque, enable, pressure, boost) in zip(range(unit.fins), fin_inputs, strict=False):
                for name, value in {"fin_command": command, "aero_torque": torque, "enable": enable,
                                    "hydraulic.pressure": pressure, "boost": boost}.items():
                    set_input(unit.name(name, fin), value)
            set_input("pitch_command", shared)
            set_input("acceleration.z", 50.0 * shared)
            for _ in range(steps):
                assert python.do_step(time, size)
                assert native.step(time, size) == OK
                time += size
            assert python_outputs() == [native.get(v.name) for v in unit.outputs]
            if saved:
                python._set_fmu_state(saved[0])
                assert native.call("SetFMUstate", saved[1]) == OK
                time, saved = saved[2], None
    native.free()


@pytest.mark.fmu
@pytest.mark.parametrize("unit", FMUS[:1], indirect=True, ids=["driven"])
def test_input_derivatives_of_a_further_input(unit: FmuInterface, library: Fmu) -> None:
    """The native FMU with input derivatives agrees to the bit with a Python core whose inputs are ramps."""
    native, core = Instance(library), ramped_core(load_parameters(model=DRIVEN).values, DRIVEN)
    assert max(native.initialize(fin_command=0.1)) == OK
    slopes, time = ramp_rates(1.0, 0.0, 3e6, -0.4), 0.0
    for size in (2e-4, 1e-3, 1.7e-3, 5e-3, 3e-4):
        inputs = core_inputs(RATED + 3e6 * time, -0.4 * time, command=0.1 + time)
        for name, value, slope in (("fin_command", inputs[0], 1.0), ("hydraulic.pressure", inputs[-3], 3e6),
                                   ("drift", inputs[-2], -0.4)):
            assert native.set(name, value) == OK
            assert native.differentiate(name, 1, slope) == OK
        assert native.step(time, size) == OK
        outputs = core.run(time + size, inputs, (time, slopes))
        assert [native.get(v.name) for v in unit.outputs] == list(outputs)
        time += size
    assert native.differentiate("boost", 1, 1.0) != OK
    native.free()


# -- unused parameters, constant outputs, terminals, direct inputs -------------------


def _parameters_read(model: str) -> set[str]:
    """Return the parameters that equations, schedule or rules read: those that the C printer prints."""
    one, several = (codegen.functions(get(model), fins) for fins in (False, True))
    of_several = codegen.traced_functions(model, several[len(one):])
    names = set()
    for tracer in (codegen.traced(False, model), of_several, codegen.traced_rules(model)):
        uses = CWriter(tracer).uses
        names |= {key for name, key in tracer.parameters if uses.get(name)}
    return names


@each_traced_once
def test_every_parameter_is_read(model: str) -> None:
    unread = {v.name for v in get(model).parameters} - _parameters_read(model)
    # Only the torque-speed envelope of the tools reads heat.winding_limit, as its description says.
    assert unread == ({"heat.winding_limit"} if "heat" in model else set())


@each_traced_once
def test_no_output_is_a_constant(model: str) -> None:
    (outputs,) = (f for f in codegen.traced(False, model).functions if f.name == "outputs")
    constant = [v.name for v, result in zip(get(model).outputs, outputs.results, strict=True)
                if not isinstance(result, Expr) or result.fixed]
    assert constant == []


@pytest.mark.parametrize("model", [*WITH_EXTENSIONS, DRIVEN])
@pytest.mark.parametrize("fins", [1, 2])
def test_terminals_name_existing_variables_once(model: str, fins: int) -> None:
    unit = FmuInterface(fins, model)
    existing = {v.name for v in unit.inputs + unit.outputs}
    root = fromstring(to_bytes(terminals_and_icons(unit)))
    members = [e.attrib["variableName"] for e in root.iter("TerminalMemberVariable")]
    assert members
    assert set(members) <= existing
    assert len(members) == len(set(members))
    assert all(list(terminal.iter("TerminalMemberVariable")) for terminal in root.iter("Terminal"))


def test_direct_inputs_of_the_default_actuator() -> None:
    """The expected inputs, on which an output depends without delay, are derived by hand."""
    assert codegen.direct_inputs(NONLINEAR) == {
        "motor_current": ("enable",),
        "motor_voltage": ("supply_voltage", "enable"),
        "motor_torque": ("enable",),
        "hinge_torque": ("aero_torque", "acceleration.x", "acceleration.y", "acceleration.z", "attitude.roll",
                         "attitude.pitch", "angular_rate.x", "angular_rate.y", "angular_rate.z",
                         "angular_acceleration.y", "angular_acceleration.z"),
        "supply_power": ("supply_voltage", "enable"),
        "tracking_error": ("fin_command",),
        "saturated": ("supply_voltage", "enable"),
        "current_error": ("enable",),
    }


@each_traced_once
def test_an_output_that_changes_at_once_has_its_direct_input_declared(model: str) -> None:
    """Every input is changed before a step; each output that then changes must list this input."""
    actuator, rng = get(model), np.random.default_rng(3)
    core = codegen.core(load_parameters(model=model).values, model)
    names = [v.name for v in actuator.inputs]
    row: list[Any] = [v.start if v.start is not None else 39.0 for v in actuator.inputs]
    direct = codegen.direct_inputs(model)
    for k in range(1, 30):
        row[names.index("fin_command")] = 0.2 * sin(0.5 * k)
        core.run(2e-3 * k, codegen.core_inputs(core, row, actuator))
        base = core.outputs(codegen.core_inputs(core, row, actuator))
        for i, v in enumerate(actuator.inputs):
            changed = list(row)
            changed[i] = not row[i] if v.kind == "Boolean" else row[i] + rng.normal() * (20.0 if row[i] else 1.0)
            outputs = core.outputs(codegen.core_inputs(core, changed, actuator))
            affected = {o.name for o, a, b in zip(actuator.outputs, base, outputs, strict=True) if a != b}
            assert all(v.name in direct.get(name, ()) for name in affected), (v.name, affected)


def test_quick_models_have_every_extension() -> None:
    assert {part for name in QUICK for part in name.split("+")[1:]} == set(EXTENSIONS)
    assert all(get(one).name != get(other).name for one, other in pairwise(WITH_EXTENSIONS))


def test_inputs_of_a_plant_alone_start_with_the_sampled_states_starts() -> None:
    whole = replace(get("nonlinear"), sampled_states=(State("position"), State("ready", start=1.0)))
    starts = {v.name: v.start for v in PLANT.extend(whole).inputs}
    assert (starts["position"], starts["ready"]) == (0.0, 1.0)


def test_an_input_with_the_name_of_a_state_is_refused() -> None:
    with pytest.raises(EmcasError, match="fin_rate is the name of two things"):
        replace(get(DRIVEN), further_inputs=(real_input("fin.rate", "rad/s", "a slip"),))


@pytest.mark.parametrize(("tick", "delay"), [(nan, 0.0), (inf, 0.0), (0.0, 0.0), (-1e-4, 0.0), (1e-4, nan),
                                             (1e-4, inf), (1e-4, -1e-3)])
def test_unusable_tick_or_delay_breaks_a_rule(tick: float, delay: float) -> None:
    """The runtime lays out memory and counts ticks by both, also for a user's actuator."""
    actuator = replace(get(DRIVEN), longest_tick=lambda ops, p: tick, transport_delay=lambda ops, p: delay)
    values = load_parameters(model=DRIVEN).values
    assert any("controller.sample_time" in problem for problem in check_combinations(values, actuator))

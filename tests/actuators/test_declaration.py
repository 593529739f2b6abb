"""A declaration: a further input that acts on the plant, fins without a supply, nothing idle in shipped ones.

The actuator with such inputs is the tests' own, driven.py beside this file.
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

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, get, get_extension
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

from ..fmu.built import both
from ..fmu.built import slave_class as local_class
from ..fmu.host import OK, Fmu, Instance
from ..marks import others_slow
from ..simulation import CompiledCore, ramped_core

DRIVEN = str(Path(__file__).with_name("driven.py"))
RATED = 2e5  # Pa


def _with_all(name: str, *without: str) -> str:
    """Return an actuator's name with every extension that it can have, in their order."""
    for extension in EXTENSIONS:
        if extension not in without and get(name).provides.issuperset(get_extension(extension).needs):
            name += f"+{extension}"
    return name


# LuGre friction is instead of Stribeck friction.
WITH_EXTENSIONS = [*NAMES, *map(_with_all, NAMES), _with_all("nonlinear", "stribeck")]
# Large programs, which take seconds to trace; the others have every extension, and these actuators without any.
LARGE = frozenset(_with_all(name) for name in (
    "nonlinear", "elastic", "habibi", "worm-gear", "worm-gear-elastic"))
QUICK = [model for model in WITH_EXTENSIONS if model not in LARGE]
# All tests of one model run in turn, so that it is traced once.
each_traced_once = pytest.mark.parametrize(
    "model", others_slow(WITH_EXTENSIONS, QUICK.__contains__), scope="module")


def acts(pressure: float = RATED, drift: float = 0.0, boost: bool = False, command: float = 0.1,
         moment: float = 0.0) -> tuple[Any, ...]:
    """A core's inputs: the fin port's, then those that act on the plant, then the Boolean that samples see."""
    return codegen.inputs_at_rest(command, moment, 0.0, True, pressure, drift, boost)


def sloping(command: float, moment: float, pressure: float, drift: float) -> tuple[Any, ...]:
    """The rates of a ramp of these, in a core's order: all but enable and the Boolean."""
    return (*codegen.inputs_at_rest(command, moment, 0.0)[:-1], pressure, drift)


# -- a further input that acts on the plant -----------------------------------------


def test_what_acts_comes_before_what_samples_see() -> None:
    names = [v.name for v in get(DRIVEN).inputs]
    assert names[-4:] == ["enable", "hydraulic.pressure", "drift", "boost"]
    assert codegen.direct_inputs(DRIVEN)["flow"] == ("hydraulic.pressure",)
    assert "boosted" not in codegen.direct_inputs(DRIVEN)


def test_both_kernels_under_signals() -> None:
    values = load_parameters(model=DRIVEN).values
    inputs: dict[str, Any] = {
        "fin_command": lambda t: 0.2 * sin(25.0 * t), "hydraulic__pressure": lambda t: RATED * (1.0 + sin(90.0 * t)),
        "drift": lambda t: 0.1 * sin(7.0 * t), "boost": lambda t: 0.1 < t < 0.2, "enable": lambda t: t < 0.25,
        "aero_torque": lambda t: 60.0 * sin(40.0 * t)}
    runs = [simulate(values, 0.3, 0.37e-3, kernel, DRIVEN, **inputs) for kernel in ("compiled", "python")]
    assert all(np.array_equal(runs[0][name], runs[1][name]) for name in runs[0])
    held = simulate(values, 0.3, 0.37e-3, model=DRIVEN, **{**inputs, "hydraulic__pressure": RATED})
    assert np.abs(held["fin_angle"] - runs[0]["fin_angle"]).max() > 1e-3
    assert set(np.unique(runs[0]["boosted"])) == {1.0, 2.0}


def _cores(model: str = DRIVEN, **changes: Any) -> tuple[Core, CompiledCore]:
    values = load_parameters(model=model).with_values(changes).values
    return codegen.core(values, model), CompiledCore(values, model)


@pytest.mark.parametrize("name", ["pressure", "drift"])
def test_a_tick_is_split_where_such_an_input_changes(name: str) -> None:
    """Ticks are 0.5 ms, the change is 0.2 ms into one: the plant takes 0.2 ms of the old value and 0.3 of the new."""
    values = load_parameters(model=DRIVEN).values
    actuator, p = get(DRIVEN), get(DRIVEN).namespace(values)
    before: dict[str, Any] = {"pressure": RATED, "drift": 0.0}
    after = dict(before)
    after[name] = {"pressure": 0.25 * RATED, "drift": 0.5}[name]
    found = []
    assert codegen.core(values, DRIVEN).schedule[1:4] == (0, 2, 0.0)
    for core in _cores():
        core.run(0.01, acts(**before))
        core.run(0.0102, acts(**before))
        there = core.run(0.0102, acts(**before))
        rows = [core.run(0.0103, acts(**after)), core.run(0.0105, acts(**after))]
        found.append((there, rows))
    assert found[0] == found[1]

    def moved(x: Record, given: Mapping[str, float], h: float) -> Record:
        u = PlantInputs(reference=0.1, **vars(NONE), supply=0.0, enabled=True, gain=1.0, rated_current_limit=None,
                   hydraulic_pressure=given["pressure"], drift=given["drift"])
        values, used = actuator.step(FLOATS, p, x, u, h)
        assert used == h
        return Record(**values)

    start, _ = _cores()
    fin = start.run(0.01, acts(**before))
    at = Record(fin_angle=fin[0], fin_rate=fin[1])
    expected = moved(moved(at, before, 0.0102 - 0.01), after, 0.0003)
    # The times of the split are differences of multiples of 0.1 ms: rounding.
    assert found[0][1][1][:2] == pytest.approx((expected.fin_angle, expected.fin_rate), rel=1e-12)
    whole = moved(at, after, 0.0005)
    assert abs(found[0][1][1][1] - whole.fin_rate) > 1e-4


def test_steps_of_the_host_do_not_matter_while_inputs_hold() -> None:
    for which in (0, 1):
        found = []
        for size in (5e-3, 1e-3, 0.37e-3, 0.11e-3):
            core, time = _cores()[which], 0.0
            inputs = acts(1.3 * RATED, 0.05, True, moment=20.0)
            for mark in (0.02, 0.05):
                while time + size < mark - 1e-9:
                    time += size
                    core.run(time, inputs)
                time = mark
                rows = core.run(mark, inputs)
            found.append(rows)
        assert found[0] == found[1] == found[2] == found[3]


COMMON = settings(derandomize=True, max_examples=30,
                  suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])


def test_a_ramp_is_what_small_held_steps_come_to() -> None:
    """A pressure from 0 at 20 MPa/s: against steps of 1 us, each at its middle."""
    values = load_parameters(model=DRIVEN).values
    core, fine, held, slope = ramped_core(values, DRIVEN), *_cores(), 2e7
    ramped = [core.run(5e-3 * k, acts(slope * 5e-3 * (k - 1)), (5e-3 * (k - 1), sloping(0.0, 0.0, slope, 0.0)))[0]
              for k in range(1, 5)]
    for k in range(20_000):
        row = fine.run((k + 1) * 1e-6, acts(slope * (k + 0.5) * 1e-6))
    # A tick takes its middle: of second order in ticks of 0.5 ms, a twentieth of the time constant.
    assert ramped[-1] == pytest.approx(row[0], rel=2e-3)
    for k in range(1, 5):
        begin = held.run(5e-3 * k, acts(slope * 5e-3 * (k - 1)))[0]
    assert abs(begin - row[0]) > 0.1 * row[0]


# -- in FMUs, one and several, with a supply and without -----------------------------

UNITS = [(DRIVEN, 1), (DRIVEN, 3), ("second-order", 3), ("second-order+faults", 2)]


@pytest.fixture(scope="module", params=[
    UNITS[0], *(pytest.param(unit, marks=pytest.mark.slow) for unit in UNITS[1:])],
    ids=lambda unit: f"{Path(unit[0]).stem}-{unit[1]}")
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
def test_a_unit_shows_what_is_declared(unit: FmuInterface, built: Mapping[str, Path], backend: str) -> None:
    assert validate_fmu(str(built[backend])) == []
    described = read_model_description(str(built[backend]))
    names = [v.name for v in described.modelVariables]
    assert names == [v.name for v in unit.variables]
    assert not [name for name in names if "bus" in name or "supply" in name]
    with zipfile.ZipFile(built[backend]) as archive:
        page = archive.read("documentation/index.html").decode()
    for v in unit.actuator.further_inputs:
        assert v.name in page
    assert "supply_voltage" not in page
    assert "perpendicular to the screw" not in page  # as the shipped note of the fork's centre of mass says


_row = st.tuples(st.floats(-0.5, 0.5), st.floats(-150.0, 150.0), st.sampled_from([True, True, False]),
                 st.floats(0.0, 2.0 * RATED), st.booleans())
_segments = st.lists(st.tuples(st.lists(_row, min_size=3, max_size=3), st.floats(-0.2, 0.2),
                               st.sampled_from([0.9e-4, 2.3e-4, 1e-3, 4.1e-3]), st.integers(1, 12), st.booleans()),
                     min_size=1, max_size=5)


@pytest.mark.fmu
@COMMON
@given(segments=_segments)
def test_both_back_ends(unit: FmuInterface, library: Fmu, slave_class: type[Slave], segments: list[Any]) -> None:
    """Each fin its own inputs, changed within ticks too, over a restored state: the same bits in every output."""
    native, python = Instance(library), slave_class(instance_name="fin")
    assert max(native.initialize()) == OK
    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    python.exit_initialization_mode()
    index, kinds = unit.reference, {v.name: v.kind for v in unit.variables}

    def give(name: str, value: Any) -> None:
        if name in index:
            {"Real": python.set_real, "Boolean": python.set_boolean}[kinds[name]]([index[name]], [value])
            assert native.set(name, value) == OK

    def told() -> list[Any]:
        getters: dict[str, Any] = {"Real": python.get_real, "Boolean": python.get_boolean}
        return [getters.get(v.kind, python.get_integer)([index[v.name]])[0] for v in unit.outputs]

    time = 0.0
    for rows, shared, size, steps, again in segments:
        saved = (python._get_fmu_state(), native.save(), time) if again else None
        for _ in range(2 if again else 1):
            for fin, (command, torque, enable, pressure, boost) in zip(range(unit.fins), rows, strict=False):
                for name, value in {"fin_command": command, "aero_torque": torque, "enable": enable,
                                    "hydraulic.pressure": pressure, "boost": boost}.items():
                    give(unit.name(name, fin), value)
            give("pitch_command", shared)
            give("acceleration.z", 50.0 * shared)
            for _ in range(steps):
                assert python.do_step(time, size)
                assert native.step(time, size) == OK
                time += size
            assert told() == [native.get(v.name) for v in unit.outputs]
            if saved:
                python._set_fmu_state(saved[0])
                assert native.call("SetFMUstate", saved[1]) == OK
                time, saved = saved[2], None
    native.free()


@pytest.mark.fmu
def test_input_derivatives_of_a_further_input(unit: FmuInterface, library: Fmu) -> None:
    """Of the native unit, against a Python core with ramps: the same bits."""
    if unit.fins > 1 or not unit.actuator.acting_inputs:
        pytest.skip("a single unit with such inputs")
    native, core = Instance(library), ramped_core(load_parameters(model=DRIVEN).values, DRIVEN)
    assert max(native.initialize(fin_command=0.1)) == OK
    slopes, time = sloping(1.0, 0.0, 3e6, -0.4), 0.0
    for size in (2e-4, 1e-3, 1.7e-3, 5e-3, 3e-4):
        inputs = acts(RATED + 3e6 * time, -0.4 * time, command=0.1 + time)
        for name, value, slope in (("fin_command", inputs[0], 1.0), ("hydraulic.pressure", inputs[-3], 3e6),
                                   ("drift", inputs[-2], -0.4)):
            assert native.set(name, value) == OK
            assert native.differentiate(name, 1, slope) == OK
        assert native.step(time, size) == OK
        row = core.run(time + size, inputs, (time, slopes))
        assert [native.get(v.name) for v in unit.outputs] == list(row)
        time += size
    assert native.differentiate("boost", 1, 1.0) != OK
    native.free()


# -- nothing idle in what is shipped -------------------------------------------------


def _read(model: str) -> set[str]:
    """Parameters that the equations, their schedule or the rules read, by what the printer of C would print."""
    one, several = (codegen.functions(get(model), fins) for fins in (False, True))
    of_several = codegen.traced_functions(model, several[len(one):])
    names = set()
    for tracer in (codegen.traced(False, model), of_several, codegen.traced_rules(model)):
        uses = CWriter(tracer).uses
        names |= {key for name, key in tracer.parameters if uses.get(name)}
    return names


@each_traced_once
def test_every_parameter_is_read(model: str) -> None:
    idle = {v.name for v in get(model).parameters} - _read(model)
    # Of the torque-speed envelope, as its description says; and a loop's gain that an ideal one has for heat alone.
    assert idle == ({"heat.winding_limit"} if "heat" in model else set())


@each_traced_once
def test_no_output_is_a_constant(model: str) -> None:
    (outputs,) = (f for f in codegen.traced(False, model).functions if f.name == "outputs")
    constant = [v.name for v, result in zip(get(model).outputs, outputs.results, strict=True)
                if not isinstance(result, Expr) or result.fixed]
    assert constant == []


@pytest.mark.parametrize("model", [*WITH_EXTENSIONS, DRIVEN])
@pytest.mark.parametrize("fins", [1, 2])
def test_terminals_name_only_what_there_is(model: str, fins: int) -> None:
    unit = FmuInterface(fins, model)
    there = {v.name for v in unit.inputs + unit.outputs}
    root = fromstring(to_bytes(terminals_and_icons(unit)))
    members = [e.attrib["variableName"] for e in root.iter("TerminalMemberVariable")]
    assert members
    assert set(members) <= there
    assert len(members) == len(set(members))
    assert all(list(terminal.iter("TerminalMemberVariable")) for terminal in root.iter("Terminal"))


def test_direct_inputs_of_the_default_unit() -> None:
    """By hand: what an output at a communication point depends on at once; the state integrates the rest."""
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
def test_direct_inputs_are_those_that_change_an_output_at_once(model: str) -> None:
    """By trying: an output that moves with an input before a step is said to depend on it."""
    actuator, rng = get(model), np.random.default_rng(3)
    core = codegen.core(load_parameters(model=model).values, model)
    names = [v.name for v in actuator.inputs]
    row: list[Any] = [v.start if v.start is not None else 39.0 for v in actuator.inputs]
    said = codegen.direct_inputs(model)
    for k in range(1, 30):
        row[names.index("fin_command")] = 0.2 * sin(0.5 * k)
        core.run(2e-3 * k, codegen.core_inputs(core, row, actuator))
        base = core.outputs(codegen.core_inputs(core, row, actuator))
        for i, v in enumerate(actuator.inputs):
            changed = list(row)
            changed[i] = not row[i] if v.kind == "Boolean" else row[i] + rng.normal() * (20.0 if row[i] else 1.0)
            now = core.outputs(codegen.core_inputs(core, changed, actuator))
            moved = {o.name for o, a, b in zip(actuator.outputs, base, now, strict=True) if a != b}
            assert all(v.name in said.get(name, ()) for name in moved), (v.name, moved)


def test_every_extension_is_among_these() -> None:
    assert {part for name in QUICK for part in name.split("+")[1:]} == set(EXTENSIONS)
    assert all(get(one).name != get(other).name for one, other in pairwise(WITH_EXTENSIONS))


def test_a_plant_alone_begins_with_the_start_of_what_samples_set() -> None:
    whole = replace(get("nonlinear"), sampled_states=(State("held"), State("ready", start=1.0)))
    starts = {v.name: v.start for v in PLANT.extend(whole).inputs}
    assert starts["held"] == 0.0
    assert starts["ready"] == 1.0


def test_a_name_of_an_input_that_is_a_state_s_is_refused() -> None:
    with pytest.raises(EmcasError, match="fin_rate is the name of two things"):
        replace(get(DRIVEN), further_inputs=(real_input("fin.rate", "rad/s", "a slip"),))


@pytest.mark.parametrize(("tick", "delay"), [(nan, 0.0), (inf, 0.0), (0.0, 0.0), (-1e-4, 0.0), (1e-4, nan),
                                             (1e-4, inf), (1e-4, -1e-3)])
def test_a_schedule_that_is_not_finite_breaks_a_rule(tick: float, delay: float) -> None:
    """Whatever makes them, in a user's file too: the runtime lays out memory and counts ticks by them."""
    actuator = replace(get(DRIVEN), longest_tick=lambda ops, p: tick, transport_delay=lambda ops, p: delay)
    values = load_parameters(model=DRIVEN).values
    assert any("controller.sample_time" in problem for problem in check_combinations(values, actuator))

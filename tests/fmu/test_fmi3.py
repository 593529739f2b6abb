"""Features of FMI 3.0 that FMI 2.0 lacks: arrays, types, event mode with early return, and the clock of the samples."""

from __future__ import annotations

import ctypes as ct
import random
import zipfile
from collections.abc import Mapping
from math import inf, nan, radians
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import fromstring

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from lxml import etree

from emcas_fmu.actuators import NAMES
from emcas_fmu.errors import BuildError
from emcas_fmu.fmi.fmi3.arrays import CLOCK, arrays
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.fmi.native import chosen
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.compiler import PLATFORMS, local_platform

from .built import lean, unpacked
from .host import DISCARD, ERROR, OK, Fmu, Instance, Instance3

pytestmark = pytest.mark.fmu
FAULTS = "elastic+heat+homing+faults"
SAMPLE = 1e-3  # s, of the shipped parameters


@pytest.fixture(scope="module")
def unit3(native3: Path, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return unpacked(native3, tmp_path_factory.mktemp("three"))


@pytest.fixture(scope="module")
def unit2(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return unpacked(native, tmp_path_factory.mktemp("two"))


@pytest.fixture(scope="module", params=[
    pytest.param(("nonlinear+faults", 2), id="two fins with faults"),
    pytest.param(("nonlinear", 4), id="four fins", marks=pytest.mark.slow),
    pytest.param((FAULTS, 1), id="faults", marks=pytest.mark.slow)])
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Fmu, Fmu]:
    """The path of an FMU in FMI 3.0, the FMU, and the same actuator in FMI 2.0."""
    model, fins = request.param
    folder, parameters = tmp_path_factory.mktemp("both"), load_parameters(model=model)
    path3 = lean(parameters, folder / "3.fmu", fins=fins, fmi="3", clock=True)
    path2 = lean(parameters, folder / "2.fmu", fins=fins)
    return path3, unpacked(path3, folder / "3"), unpacked(path2, folder / "2")


@pytest.fixture(scope="module")
def clocked3(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("clocked")
    return unpacked(lean(load_parameters(), folder / "3.fmu", fmi="3", clock=True), folder / "3")


def with_events(fmu: Fmu, early_return: bool = True, **values: Any) -> Instance3:
    """Return an instance with event mode, initialized and in step mode."""
    instance = Instance3(fmu, event_mode=True, early_return=early_return)
    assert max(instance.initialize(**values)) == OK, instance.log
    assert [instance.update(), instance.call("EnterStepMode")] == [OK, OK]
    return instance


def handle_event(instance: Instance3) -> None:
    """Pass through event mode."""
    assert [instance.call("EnterEventMode"), instance.update(), instance.call("EnterStepMode")] == [OK] * 3


def run_to(instance: Instance3, begin: float, end: float) -> list[float]:
    """Step to a time, handle the events on the way, and return their times."""
    now, events = begin, []
    while end - now > 1e-12:
        assert instance.step(now, end - now) == OK, instance.log
        now = instance.reached
        assert instance.event_needed or not instance.returned_early
        if instance.event_needed:
            events.append(now)
            handle_event(instance)
    return events


@pytest.mark.parametrize("model", [*NAMES, FAULTS])
@pytest.mark.parametrize("fins", [1, 4])
def test_every_scalar_is_an_element_of_one_array(model: str, fins: int) -> None:
    unit = FmuInterface(fins, model)
    assert sorted(index for v in arrays(unit) for index in v.indices) == list(range(len(unit.variables)))
    for v in arrays(unit):
        elements = [unit.variables[index] for index in v.indices]
        assert {(e.kind, e.unit, e.causality, e.variability, e.minimum, e.maximum) for e in elements} == {
            (v.variable.kind, v.variable.unit, v.variable.causality, v.variable.variability, v.variable.minimum,
             v.variable.maximum)}
        assert np.prod(v.dimensions, dtype=int) == len(elements)


def test_four_fins_need_fewer_arrays_than_one_fin_needs_scalars() -> None:
    assert len(arrays(FmuInterface(4))) + 2 < 130 < len(FmuInterface(1).variables)


def test_descriptions_follow_the_schemas(both: tuple[Path, Fmu, Fmu]) -> None:
    path = both[0]
    schemas = Path(fmpy.__file__).parent / "schema/fmi3"
    with zipfile.ZipFile(path) as archive:
        for name, schema in (("modelDescription.xml", "fmi3ModelDescription.xsd"),
                             ("terminalsAndIcons/terminalsAndIcons.xml", "fmi3TerminalsAndIcons.xsd"),
                             ("sources/buildDescription.xml", "fmi3BuildDescription.xsd")):
            checker = etree.XMLSchema(etree.parse(str(schemas / schema)))
            assert checker.validate(etree.fromstring(archive.read(name))), checker.error_log
        root = fromstring(archive.read("modelDescription.xml"))
        terminals = fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        names = archive.namelist()
    assert validate_fmu(str(path)) == []
    variables = {v.attrib["name"] for v in root.find("ModelVariables") or ()}
    assert {m.attrib["variableName"] for m in terminals.iter("TerminalMemberVariable")} <= variables
    local = local_platform()
    assert local is not None
    (platform_tuple,) = local.targets  # a Mac has two
    assert [n for n in names if n.startswith("binaries/")] == [
        f"binaries/{platform_tuple}/{root.attrib['modelName']}.so"]


def test_outputs_have_the_bits_of_fmi_2(both: tuple[Path, Fmu, Fmu]) -> None:
    """Through a run with changed parameters, inputs and step sizes."""
    _, fmu3, fmu2 = both
    assert fmu3.references.keys() - fmu2.references.keys() == {"time", CLOCK.name}
    assert sorted(fmu3.outputs) == sorted(fmu2.outputs)
    fin = "fin[2]." if "fin[2].fin_command" in fmu3.references else ""
    runs = []
    for fmu in (fmu2, fmu3):
        unit = Instance(fmu)
        values = {f"{fin}friction.coulomb.positive[3]": 0.004, f"{fin}encoder.enabled": False,
                  f"{fin}friction.temperature": -3.0}
        assert max(unit.initialize(**values)) == OK, unit.log
        rows, time = [], 0.0
        for k in range(200):
            unit.set(f"{fin}fin_command", 0.3 if k % 60 < 30 else -0.2)
            unit.set(f"{fin}aero_torque", -2.0 * k)
            unit.set("attitude.pitch", 0.01 * k)
            size = (1e-3, 0.37e-3, 4e-3)[k % 3]
            assert unit.step(time, size) == OK, unit.log
            time += size
            rows.append([unit.get(name) for name in sorted(fmu.outputs)])
        runs.append(rows)
    assert np.isfinite(runs[0]).all()
    assert np.array_equal(runs[0], runs[1])


def test_value_references_count_from_1(both: tuple[Path, Fmu, Fmu]) -> None:
    with zipfile.ZipFile(both[0]) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
    assert [int(v.attrib["valueReference"]) for v in root.find("ModelVariables") or ()] == list(
        range(1, len(root.find("ModelVariables") or ()) + 1))
    assert all("0" not in unknown.attrib["dependencies"].split() for unknown in root.find("ModelStructure") or ())
    assert Instance(both[1]).get_vr("Float64", [0])[0] == ERROR


@pytest.mark.parametrize(("fins", "names"), [(1, "structured"), (4, "flat")])
def test_option_scalars_gives_variables_and_bits_of_fmi_2(tmp_path: Path, fins: int, names: str) -> None:
    paths = [lean(load_parameters(), tmp_path / f"{fmi}.fmu", fins=fins, fmi=fmi, names=names, scalars=fmi == "3")
             for fmi in ("2", "3")]
    assert validate_fmu(str(paths[1])) == []
    variables = [{v.name: (v.start, v.unit, v.causality)
                  for v in fmpy.read_model_description(str(path)).modelVariables if v.name != "time"} for path in paths]
    assert variables[0] == variables[1]
    command = "fin2_fin_command" if fins > 1 else "fin_command"
    runs = [fmpy.simulate_fmu(str(path), stop_time=0.1, output_interval=1e-3, start_values={command: 0.2})
            for path in paths]
    assert runs[0].dtype.names == runs[1].dtype.names
    assert runs[0].tolist() == runs[1].tolist()
    assert max(runs[0][command.replace("command", "angle")]) > 0.1


def test_flag_words_are_uint32_and_enumerations_int64(both: tuple[Path, Fmu, Fmu]) -> None:
    kinds = {name.rpartition(".")[2]: kind for name, kind in both[1].kinds.items()}
    if "fault_word" not in kinds:
        pytest.skip("this actuator has no faults")
    assert (kinds["fault_word"], kinds["built_in_test"], kinds["status"]) == ("UInt32", "UInt32", "Int64")


def test_time_is_a_variable_that_only_steps_change(unit3: Fmu) -> None:
    unit = Instance(unit3)
    assert max(unit.initialize(5.0)) == OK
    assert unit.get("time") == 5.0
    assert unit.step(5.0, 2e-3) == OK
    assert unit.get("time") == pytest.approx(5.002, abs=1e-12)  # rounding of the sum
    assert unit.set("time", 1.0) == ERROR
    assert "set by the steps" in unit.messages(ERROR)


def test_wrong_number_of_values_is_an_error(unit3: Fmu) -> None:
    unit = Instance3(unit3)
    assert max(unit.initialize()) == OK
    table = unit3.references["friction.coulomb.positive[0]"]
    for count, status in ((7, OK), (6, ERROR), (8, ERROR), (0, ERROR)):
        assert unit.get_elements("Float64", table, count)[0] == status
    assert "7 elements" in unit.messages(ERROR)


@pytest.mark.parametrize("early_return", [False, True])
def test_event_mode_does_not_change_the_trajectory(unit2: Fmu, unit3: Fmu, early_return: bool) -> None:
    """At common times the outputs have the same bits, although steps end early."""
    plain, eventful, events = Instance(unit2), with_events(unit3, early_return), []
    assert max(plain.initialize()) == OK
    for k in range(80):
        for unit in (plain, eventful):
            unit.set("fin_command", radians(20.0) * (-1) ** (k // 16))
            unit.set("aero_torque", -80.0 if k % 20 < 10 else 300.0)
        assert plain.step(k * 5e-3, 5e-3) == OK
        events += run_to(eventful, k * 5e-3, (k + 1) * 5e-3)
        assert plain.outputs() == eventful.outputs()
    assert len(events) > 5


def test_event_mode_on_a_soft_bus(both: tuple[Path, Fmu, Fmu]) -> None:
    """Two fins load one bus. Events lie before and after the instants at which the bus voltage is updated."""
    if not any(name.startswith("fin[2]") for name in both[1].references):
        pytest.skip("one fin has no bus")
    plain, eventful, events, rng = Instance(both[2]), with_events(both[1]), [], random.Random(5)
    for unit in (plain, eventful):
        unit.call("Reset")
        assert max(unit.initialize(bus__source_resistance=0.05)) == OK
    assert [eventful.update(), eventful.call("EnterStepMode")] == [OK, OK]
    commands = [f"fin[{k}].fin_command" for k in (1, 2)]
    for k in range(120):
        command_angles = [rng.uniform(-0.3, 0.3) for _ in commands]
        for unit in (plain, eventful):
            for name, angle in zip(commands, command_angles):
                assert unit.set(name, angle) == OK
        assert plain.step(k * 5e-3, 5e-3) == OK
        events += run_to(eventful, k * 5e-3, (k + 1) * 5e-3)
        # Not the same bits: encoder counts and dry friction amplify the rounding of the host's time. 1e-9 rad is the
        # limit that is guaranteed for any step sizes.
        assert abs(plain.get("fin[1].fin_angle") - eventful.get("fin[1].fin_angle")) < 1e-9
    assert len(events) > 50


def test_a_step_ends_at_each_event(unit3: Fmu) -> None:
    """Between events no Boolean output changes, and the fin neither sticks nor slips."""
    unit, now = with_events(unit3), 0.0
    unit.set("fin_command", 0.2)

    def mode() -> tuple[Any, ...]:
        return unit.get("saturated"), unit.get("at_stop"), unit.get("fin_rate") == 0.0

    modes, before = set(), mode()
    while now < 0.3:
        assert unit.step(now, 0.05) == OK
        assert unit.returned_early == (unit.reached < now + 0.05 - 1e-12)
        now = unit.reached
        assert (mode() != before) == unit.event_needed
        modes.add(before := mode())
        if unit.event_needed:
            handle_event(unit)
    assert len(modes) >= 3  # the fin sticks, it moves, the motor voltage is saturated


def test_time_of_slip_equals_that_in_steps_of_a_microsecond(unit3: Fmu) -> None:
    unit, fine = with_events(unit3), Instance(unit3)
    assert max(fine.initialize()) == OK
    for instance in (unit, fine):
        instance.set("fin_command", 0.1)
    now = 0.0
    while unit.get("fin_rate") == 0.0:
        assert unit.step(now, 0.02) == OK
        now = unit.reached
        if unit.event_needed:
            handle_event(unit)
    for k in range(20_000):
        assert fine.step(k * 1e-6, 1e-6) == OK
        if fine.get("fin_rate") != 0.0:
            break
    assert now == pytest.approx((k + 1) * 1e-6, abs=2e-6)  # one small step, and 1 us tolerance of communication points


def test_without_early_return_steps_are_whole(unit3: Fmu) -> None:
    unit, events = with_events(unit3, early_return=False), 0
    unit.set("fin_command", 0.2)
    for k in range(100):
        assert unit.step(k * SAMPLE, SAMPLE) == OK
        assert not unit.returned_early
        assert unit.reached == pytest.approx((k + 1) * SAMPLE, abs=1e-12)  # rounding of the sum
        if unit.event_needed:
            events += 1
            handle_event(unit)
    assert 0 < events < 100


def test_without_event_mode_no_event_is_reported(unit3: Fmu) -> None:
    unit = Instance3(unit3, early_return=True)
    assert max(unit.initialize(fin_command=0.2)) == OK
    for k in range(50):
        assert unit.step(k * SAMPLE, SAMPLE) == OK
        assert not unit.event_needed
        assert not unit.returned_early
    assert unit.call("EnterEventMode") == ERROR
    assert "without event mode" in unit.messages(ERROR)


def test_a_refused_step_changes_nothing(unit3: Fmu) -> None:
    unit = with_events(unit3)
    unit.set("fin_command", 0.2)
    run_to(unit, 0.0, SAMPLE)
    before = unit.outputs()
    assert unit.step(SAMPLE, 1e12) == DISCARD  # too many ticks
    for bad in (nan, inf, -1.0, 0.0):
        assert unit.step(SAMPLE, bad) == ERROR
    assert unit.outputs() == before
    unit.set("acceleration.z", 1.7e308)
    unit.set("angular_acceleration.y", 1.7e308)
    unit.set("angular_rate.y", 1e200)
    # A host's clock may be slightly early; this step has then no length, but the inputs are checked nevertheless.
    assert unit.step(SAMPLE - 5e-7, 1e-9) == DISCARD
    for name in ("acceleration.z", "angular_acceleration.y", "angular_rate.y"):
        unit.set(name, 0.0)
    assert unit.outputs() == before
    assert unit.step(SAMPLE, SAMPLE) == OK


def clock_calls(unit: Instance3, value: bool) -> tuple[int, int, bool]:
    """Set and get the clock; return both statuses and whether the clock is active."""
    reference, active = (ct.c_uint * 1)(unit.fmu.references[CLOCK.name]), ct.c_bool()
    return (unit.call("SetClock", reference, ct.c_size_t(1), ct.byref(ct.c_bool(value))),
            unit.call("GetClock", reference, ct.c_size_t(1), ct.byref(active)), active.value)


def test_the_clock_ticks_at_samples_and_changes_nothing(clocked3: Fmu, unit3: Fmu) -> None:
    clocked, plain = with_events(clocked3), with_events(unit3)
    reference = (ct.c_uint * 1)(clocked3.references[CLOCK.name])
    interval, shift, qualifier = ct.c_double(), ct.c_double(nan), ct.c_int()
    assert clocked.call("GetIntervalDecimal", reference, ct.c_size_t(1), ct.byref(interval), ct.byref(qualifier)) == OK
    assert clocked.call("GetShiftDecimal", reference, ct.c_size_t(1), ct.byref(shift)) == OK
    assert (interval.value, shift.value) == (SAMPLE, 0.0)
    described = ET.parse(clocked3.folder / "modelDescription.xml").find(".//Clock")
    assert described is not None
    assert float(described.attrib["intervalDecimal"]) == SAMPLE
    for unit in (clocked, plain):
        unit.set("fin_command", 0.1)
    now = 0.0
    for k in range(100):
        assert clocked.call("EnterEventMode") == OK
        assert clock_calls(clocked, True) == (OK, OK, True)
        assert clocked.update() == OK
        assert clock_calls(clocked, False) == (OK, OK, False)  # the update has deactivated it
        assert clocked.call("EnterStepMode") == OK
        for unit in (clocked, plain):
            run_to(unit, now, (k + 1) * interval.value)
        now = (k + 1) * interval.value
        assert clocked.outputs() == plain.outputs()
    run_to(clocked, now, now + 0.4 * SAMPLE)
    assert clocked.call("EnterEventMode") == OK
    assert clock_calls(clocked, True)[0] == ERROR
    assert "is not a sample" in clocked.messages(ERROR)
    assert CLOCK.name not in unit3.references


def test_state_in_event_mode_can_be_restored(unit3: Fmu) -> None:
    unit = with_events(unit3)
    unit.set("fin_command", 0.1)
    run_to(unit, 0.0, 0.02)
    assert unit.call("EnterEventMode") == OK
    saved = unit.save()
    data = unit.serialize(saved)
    other, without = with_events(unit3), Instance(unit3)
    assert other.restore(data) == OK
    assert max(without.initialize()) == OK
    assert without.restore(data) == without.call("SetFMUstate", saved) == ERROR
    assert without.messages(ERROR).count("it is of event mode; restore it in an instance that has it") == 2
    assert without.step(0.0, SAMPLE) == OK
    for instance in (unit, other):
        assert instance.call("EnterStepMode") == OK
    assert run_to(unit, 0.02, 0.1) == run_to(other, 0.02, 0.1)
    assert unit.outputs() == other.outputs()


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(torque=st.floats(-200.0, 200.0), command=st.floats(-0.3, 0.3), sizes=st.lists(
    st.floats(1e-5, 8e-3), min_size=3, max_size=12))
# The arrival of a reference ends the saturation, which begins again in the same tick after the end of a step.
@example(159.0, 0.109375, [0.005859375, 0.0044433627564437325, 0.0034848724299057963, 0.0078125])
def test_events_do_not_depend_on_the_steps(unit3: Fmu, torque: float, command: float, sizes: list[float]) -> None:
    """With constant inputs, short steps have the events of one long step.

    The exception, a change that ends within a microsecond (docs/develop/native.md), is too rare for these examples.
    """
    whole, sliced = with_events(unit3), with_events(unit3)
    for unit in (whole, sliced):
        unit.set("fin_command", command)
        unit.set("aero_torque", torque)
    now, events = 0.0, []
    for size in sizes:
        events += run_to(sliced, now, now + size)
        now += size
    expected = run_to(whole, 0.0, now)
    # The sums of up to 0.1 s round by some 1e-17 s, and the fastest output changes by 1e6 per second: some 1e-11.
    assert np.allclose(list(whole.outputs().values()), list(sliced.outputs().values()), rtol=1e-9, atol=1e-9)
    # An event at less than the tolerance of 1 us from a step's end is reported there.
    assert len(events) == len(expected)
    assert np.allclose(events, expected, rtol=0.0, atol=3e-6)


def test_platforms_may_be_named_as_in_fmi_2_or_3() -> None:
    assert chosen(["x86_64-linux", "linux64", "x86_64-darwin", "aarch64-darwin"], None) == [
        PLATFORMS["linux64"], PLATFORMS["darwin64"]]


@pytest.mark.drawn
@pytest.mark.slow
def test_built_twice_the_same_bytes(native3: Path, tmp_path: Path) -> None:
    local = local_platform()
    assert local is not None
    again = build(load_parameters(), tmp_path / "3.fmu", "native", [local.name], fmi="3").path
    assert again.read_bytes() == native3.read_bytes()


@pytest.mark.parametrize(("options", "message"), [
    ({"fmi": "4"}, "choose 2 or 3"), ({"fmi": "3", "backend": "python"}, "native"), ({"clock": True}, "for fmi 3"),
    ({"scalars": True}, "for fmi 3")])
def test_unavailable_options_are_refused(tmp_path: Path, options: Mapping[str, Any], message: str) -> None:
    with pytest.raises(BuildError, match=message):
        build(load_parameters(), tmp_path / "EMCAS.fmu", **options)
    assert list(tmp_path.iterdir()) == []

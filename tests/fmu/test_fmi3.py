"""What FMI 3.0 has in addition to FMI 2.0: arrays, types, event mode with early return, the clock of the samples."""

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

from .built import lean
from .host import DISCARD, ERROR, OK, Fmu, Instance, Instance3

pytestmark = pytest.mark.fmu
FAULTS = "elastic+heat+homing+faults"
SAMPLE = 1e-3  # s, of the shipped parameters


def built(folder: Path, model: str = "nonlinear", fins: int = 1, fmi: str = "3", clock: bool = False) -> Path:
    return lean(load_parameters(model=model), folder / f"{fmi}.fmu", fins=fins, fmi=fmi, clock=clock)


def unpacked(path: Path, folder: Path) -> Fmu:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


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
    """A unit in FMI 3.0 (the file, and unpacked) and in FMI 2.0."""
    model, fins = request.param
    folder = tmp_path_factory.mktemp("both")
    third = built(folder, model, fins, clock=True)
    return third, unpacked(third, folder / "3"), unpacked(built(folder, model, fins, "2"), folder / "2")


@pytest.fixture(scope="module")
def clocked3(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    folder = tmp_path_factory.mktemp("clocked")
    return unpacked(built(folder, clock=True), folder / "3")


def with_events(fmu: Fmu, early_return: bool = True, **values: Any) -> Instance3:
    """An initialized instance in step mode."""
    instance = Instance3(fmu, event_mode=True, early_return=early_return)
    assert max(instance.initialize(**values)) == OK, instance.log
    assert [instance.update(), instance.call("EnterStepMode")] == [OK, OK]
    return instance


def run_to(instance: Instance3, begin: float, end: float) -> list[float]:
    """Steps to a time however early each ends; the times of events."""
    now, events = begin, []
    while end - now > 1e-12:
        assert instance.step(now, end - now) == OK, instance.log
        now = instance.reached
        assert instance.event_needed or not instance.returned_early
        if instance.event_needed:
            events.append(now)
            assert [instance.call("EnterEventMode"), instance.update(), instance.call("EnterStepMode")] == [OK] * 3
    return events


@pytest.mark.parametrize("model", [*NAMES, FAULTS])
@pytest.mark.parametrize("fins", [1, 4])
def test_every_scalar_is_an_element_of_one_array(model: str, fins: int) -> None:
    unit = FmuInterface(fins, model)
    listed = arrays(unit)
    assert sorted(place for v in listed for place in v.indices) == list(range(len(unit.variables)))
    for v in listed:
        elements = [unit.variables[place] for place in v.indices]
        assert {(e.kind, e.unit, e.causality, e.variability, e.minimum, e.maximum) for e in elements} == {
            (v.variable.kind, v.variable.unit, v.variable.causality, v.variable.variability, v.variable.minimum,
             v.variable.maximum)}
        assert np.prod(v.dimensions, dtype=int) == len(elements)


def test_four_fins_are_fewer_variables_than_one_in_scalars() -> None:
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
    assert [n for n in names if n.startswith("binaries/")] == [f"binaries/{tuple_of_this_machine()}/"
                                                               f"{root.attrib['modelName']}.so"]


def tuple_of_this_machine() -> str:
    local = local_platform()
    assert local is not None
    (machine,) = local.targets  # no Mac
    return machine


def test_it_is_the_unit_of_fmi_2(both: tuple[Path, Fmu, Fmu]) -> None:
    """Every output, to the last bit, through a run with parameters, inputs and steps of all sorts."""
    _, third, second = both
    assert third.references.keys() - second.references.keys() == {"time", CLOCK.name}
    assert sorted(third.outputs) == sorted(second.outputs)
    fins = "fin[2]." if "fin[2].fin_command" in third.references else ""
    runs = []
    for fmu in (second, third):
        unit = Instance(fmu)
        values = {f"{fins}friction.coulomb.positive[3]": 0.004, f"{fins}encoder.enabled": False,
                  f"{fins}friction.temperature": -3.0}
        assert max(unit.initialize(**values)) == OK, unit.log
        rows, time = [], 0.0
        for k in range(200):
            unit.set(f"{fins}fin_command", 0.3 if k % 60 < 30 else -0.2)
            unit.set(f"{fins}aero_torque", -2.0 * k)
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
    listed = [unknown.attrib["dependencies"].split() for unknown in root.find("ModelStructure") or ()]
    assert "0" not in {reference for references in listed for reference in references}
    assert Instance(both[1]).get_vr("Float64", [0])[0] == ERROR


@pytest.mark.parametrize(("fins", "names"), [(1, "structured"), (4, "flat")])
def test_scalars_are_the_variables_of_fmi_2(tmp_path: Path, fins: int, names: str) -> None:
    """Names, start values and, through a run, the bits."""
    units = [lean(load_parameters(), tmp_path / f"{fmi}.fmu", fins=fins, fmi=fmi, names=names, **more)
             for fmi, more in (("2", {}), ("3", {"scalars": True}))]
    assert validate_fmu(str(units[1])) == []
    read = [{v.name: (v.start, v.unit, v.causality) for v in fmpy.read_model_description(str(path)).modelVariables
             if v.name != "time"} for path in units]
    assert read[0] == read[1]
    command = "fin2_fin_command" if fins > 1 else "fin_command"
    rows = [fmpy.simulate_fmu(str(path), stop_time=0.1, output_interval=1e-3, start_values={command: 0.2})
            for path in units]
    assert rows[0].dtype.names == rows[1].dtype.names
    assert rows[0].tolist() == rows[1].tolist()
    assert max(rows[0][command.replace("command", "angle")]) > 0.1


def test_words_of_flags_are_unsigned_and_enumerations_int64(both: tuple[Path, Fmu, Fmu]) -> None:
    third = both[1]
    kinds = {name.rpartition(".")[2]: kind for name, kind in third.kinds.items()}
    if "fault_word" not in kinds:
        pytest.skip("this unit has none")
    assert (kinds["fault_word"], kinds["built_in_test"], kinds["status"]) == ("UInt32", "UInt32", "Int64")


def test_time_is_a_variable_that_steps_set(unit3: Fmu) -> None:
    unit = Instance(unit3)
    assert max(unit.initialize(5.0)) == OK
    assert unit.get("time") == 5.0
    assert unit.step(5.0, 2e-3) == OK
    assert unit.get("time") == pytest.approx(5.002, abs=1e-12)  # rounding of the sum
    assert unit.set("time", 1.0) == ERROR
    assert "set by the steps" in unit.messages(ERROR)


def test_counts_of_values_must_fit(unit3: Fmu) -> None:
    unit = Instance3(unit3)
    assert max(unit.initialize()) == OK
    table = unit3.references["friction.coulomb.positive[0]"]
    for count, status in ((7, OK), (6, ERROR), (8, ERROR), (0, ERROR)):
        assert unit.get_elements("Float64", table, count)[0] == status
    assert "7 elements" in unit.messages(ERROR)


@pytest.mark.parametrize("early_return", [False, True])
def test_event_mode_leaves_the_trajectory_alone(unit2: Fmu, unit3: Fmu, early_return: bool) -> None:
    """The same bits at common times, inputs held between them, though steps end early."""
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
    """Fins that pull one bus down, whose voltage follows at instants of its own: events lie on either side of these."""
    if not any(name.startswith("fin[2]") for name in both[1].references):
        pytest.skip("one fin has no bus")
    plain, eventful, events, rng = Instance(both[2]), with_events(both[1]), [], random.Random(5)
    for unit in (plain, eventful):
        unit.call("Reset")
        assert max(unit.initialize(bus__source_resistance=0.05)) == OK
    assert [eventful.update(), eventful.call("EnterStepMode")] == [OK, OK]
    commands = [f"fin[{k}].fin_command" for k in (1, 2)]
    for k in range(120):
        wanted = [rng.uniform(-0.3, 0.3) for _ in commands]
        for unit in (plain, eventful):
            for name, angle in zip(commands, wanted):
                assert unit.set(name, angle) == OK
        assert plain.step(k * 5e-3, 5e-3) == OK
        events += run_to(eventful, k * 5e-3, (k + 1) * 5e-3)
        # The encoder's counts and dry friction amplify rounding of the host's time: hence not to the bit.
        assert abs(plain.get("fin[1].fin_angle") - eventful.get("fin[1].fin_angle")) < 1e-9  # the contract of slicing
    assert len(events) > 50


def test_a_step_ends_at_each_event(unit3: Fmu) -> None:
    """Between events no discrete output changes and no fin sticks or comes loose."""
    unit, now = with_events(unit3), 0.0
    unit.set("fin_command", 0.2)

    def situation() -> tuple[Any, ...]:
        return unit.get("saturated"), unit.get("at_stop"), unit.get("fin_rate") == 0.0

    seen, before = set(), situation()
    while now < 0.3:
        assert unit.step(now, 0.05) == OK
        assert unit.returned_early == (unit.reached < now + 0.05 - 1e-12)
        now = unit.reached
        assert (situation() != before) == unit.event_needed
        seen.add(before := situation())
        if unit.event_needed:
            assert [unit.call("EnterEventMode"), unit.update(), unit.call("EnterStepMode")] == [OK] * 3
    assert len(seen) >= 3  # held, moving, at the voltage's limit


def test_the_time_of_an_event_is_that_of_small_steps(unit3: Fmu) -> None:
    """Where the fin comes loose, found by steps of a microsecond."""
    unit, fine = with_events(unit3), Instance(unit3)
    assert max(fine.initialize()) == OK
    loose: list[float] = []
    for instance in (unit, fine):
        instance.set("fin_command", 0.1)
    now = 0.0
    while unit.get("fin_rate") == 0.0:
        assert unit.step(now, 0.02) == OK
        now = unit.reached
        if unit.event_needed:
            assert [unit.call("EnterEventMode"), unit.update(), unit.call("EnterStepMode")] == [OK] * 3
    for k in range(20_000):
        assert fine.step(k * 1e-6, 1e-6) == OK
        if fine.get("fin_rate") != 0.0:
            loose.append((k + 1) * 1e-6)
            break
    assert now == pytest.approx(loose[0], abs=2e-6)  # a step, and the tolerance of communication points


def test_without_early_return_steps_are_whole(unit3: Fmu) -> None:
    unit, needed = with_events(unit3, early_return=False), 0
    unit.set("fin_command", 0.2)
    for k in range(100):
        assert unit.step(k * SAMPLE, SAMPLE) == OK
        assert not unit.returned_early
        assert unit.reached == pytest.approx((k + 1) * SAMPLE, abs=1e-12)  # rounding of the sum
        if unit.event_needed:
            needed += 1
            assert [unit.call("EnterEventMode"), unit.update(), unit.call("EnterStepMode")] == [OK] * 3
    assert 0 < needed < 100


def test_without_event_mode_there_are_no_events(unit3: Fmu) -> None:
    unit = Instance3(unit3, early_return=True)
    assert max(unit.initialize(fin_command=0.2)) == OK
    for k in range(50):
        assert unit.step(k * SAMPLE, SAMPLE) == OK
        assert not unit.event_needed
        assert not unit.returned_early
    assert unit.call("EnterEventMode") == ERROR
    assert "without event mode" in unit.messages(ERROR)


def test_a_step_that_cannot_be_followed_changes_nothing(unit3: Fmu) -> None:
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
    # Of no length, since a host's clock may run back a little: what follows from the inputs is looked at all the same.
    assert unit.step(SAMPLE - 5e-7, 1e-9) == DISCARD
    for name in ("acceleration.z", "angular_acceleration.y", "angular_rate.y"):
        unit.set(name, 0.0)
    assert unit.outputs() == before
    assert unit.step(SAMPLE, SAMPLE) == OK


def clock_calls(unit: Instance3, value: bool) -> tuple[int, int, bool]:
    """Statuses of setting and getting the clock, and whether it ticks."""
    reference, ticks = (ct.c_uint * 1)(unit.fmu.references[CLOCK.name]), ct.c_bool()
    return (unit.call("SetClock", reference, ct.c_size_t(1), ct.byref(ct.c_bool(value))),
            unit.call("GetClock", reference, ct.c_size_t(1), ct.byref(ticks)), ticks.value)


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
        assert clock_calls(clocked, False) == (OK, OK, False)  # it has ticked
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


def test_states_are_kept_in_event_mode(unit3: Fmu) -> None:
    unit = with_events(unit3)
    unit.set("fin_command", 0.1)
    run_to(unit, 0.0, 0.02)
    assert unit.call("EnterEventMode") == OK
    data = unit.serialize(unit.save())
    other, without = with_events(unit3), Instance(unit3)
    assert other.restore(data) == OK
    assert without.restore(data) == ERROR
    assert "unknown phase" in without.messages(ERROR)
    for instance in (unit, other):
        assert instance.call("EnterStepMode") == OK
    assert run_to(unit, 0.02, 0.1) == run_to(other, 0.02, 0.1)
    assert unit.outputs() == other.outputs()


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(torque=st.floats(-200.0, 200.0), command=st.floats(-0.3, 0.3), ends=st.lists(
    st.floats(1e-5, 8e-3), min_size=3, max_size=12))
# A reference ends the saturation when it arrives, which begins again in the same tick, after the end of a step.
@example(159.0, 0.109375, [0.005859375, 0.0044433627564437325, 0.0034848724299057963, 0.0078125])
def test_events_do_not_depend_on_the_steps(unit3: Fmu, torque: float, command: float, ends: list[float]) -> None:
    """Where steps end anyway, as long as inputs are held, events are where they are in one long step.

    But for a change that ends within a microsecond (docs/develop/native.md), which is rarer than these examples.
    """
    whole, sliced = with_events(unit3), with_events(unit3)
    for unit in (whole, sliced):
        unit.set("fin_command", command)
        unit.set("aero_torque", torque)
    now, found = 0.0, []
    for size in ends:
        found += run_to(sliced, now, now + size)
        now += size
    expected = run_to(whole, 0.0, now)
    # The host's sums of time differ by some 1e-18 s, the fastest output changes by 1e6 a second.
    assert np.allclose(list(whole.outputs().values()), list(sliced.outputs().values()), rtol=1e-9, atol=1e-9)
    # An event within the tolerance of a step's end is met there.
    assert len(found) == len(expected)
    assert np.allclose(found, expected, rtol=0.0, atol=3e-6)


def test_platforms_have_the_names_of_both_versions() -> None:
    assert chosen(["x86_64-linux", "linux64", "x86_64-darwin", "aarch64-darwin"], None) == [
        PLATFORMS["linux64"], PLATFORMS["darwin64"]]


@pytest.mark.drawn
@pytest.mark.slow
def test_built_twice_the_same_bytes(native3: Path, tmp_path: Path) -> None:
    local = local_platform()
    assert local is not None
    again = build(load_parameters(), tmp_path / "3.fmu", "native", [local.name], fmi="3").path
    assert again.read_bytes() == native3.read_bytes()


@pytest.mark.parametrize(("wanted", "said"), [
    ({"fmi": "4"}, "choose 2 or 3"), ({"fmi": "3", "backend": "python"}, "native"), ({"clock": True}, "for fmi 3"),
    ({"scalars": True}, "for fmi 3")])
def test_what_there_is_not(tmp_path: Path, wanted: Mapping[str, Any], said: str) -> None:
    with pytest.raises(BuildError, match=said):
        build(load_parameters(), tmp_path / "EMCAS.fmu", **wanted)
    assert list(tmp_path.iterdir()) == []

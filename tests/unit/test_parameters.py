"""Parameter files, units, and the checks of single values and of combinations."""

from __future__ import annotations

import builtins
import io
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from math import inf, nan, pi, radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emcas_fmu import rules
from emcas_fmu.parameters import (
    Entry,
    ParameterError,
    ParameterSet,
    check_combinations,
    check_parameters,
    load_parameters,
)
from emcas_fmu.parameters import sets as parameters
from emcas_fmu.rules import check_ranges
from emcas_fmu.support import files
from emcas_fmu.support.files import models_directory
from emcas_fmu.units import UnitError, quantity
from emcas_fmu.variables import Variable
from tests.default_actuator import ACTUATOR, FILE_ENTRIES, namespace

Load = Callable[[str], ParameterSet]
DEFAULTS = load_parameters()
VARIABLES = {v.name: v for v in FILE_ENTRIES}


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def load_text(text: str) -> ParameterSet:
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return load_parameters(path)

    return load_text


def problems(load: Load, text: str) -> tuple[str, ...]:
    """Return the problems that the error about a file lists."""
    with pytest.raises(ParameterError) as caught:
        load(text)
    return caught.value.problems


def test_default_set_has_every_entry_in_order() -> None:
    assert list(DEFAULTS.values) == [v.name for v in FILE_ENTRIES]
    assert [e.variable for e in DEFAULTS.entries] == list(FILE_ENTRIES)


@pytest.mark.parametrize("entry", DEFAULTS.entries, ids=lambda e: str(e.variable.name))
def test_default_value_has_source_note_type_and_is_within_limits(entry: Entry) -> None:
    assert entry.source in ("thesis", "derived", "estimate")
    assert re.fullmatch(r"[A-Z0-9].{10,}\.", entry.note)
    assert entry.file == "emcas.toml"
    assert type(entry.value) is {"Real": float, "Integer": int, "Boolean": bool}[entry.variable.kind]
    assert entry.variable.minimum <= entry.value <= entry.variable.maximum


@pytest.mark.parametrize(("name", "expected", "source"), [
    ("kinematics.moment_arm", 0.05, "estimate"), ("kinematics.initial_angle", pi / 36, "estimate"),
    ("screw.lead", 0.005 / (2 * pi), "derived"), ("inertia.motor", 0.000281, "derived"),
    ("inertia.screw", 0.0000045, "derived"), ("motor.inductance", 0.0006, "estimate"),
    ("drive.supply_voltage", 39.0, "thesis"), ("drive.current_limit", 60.0, "estimate"),
    ("drive.current_gain", 8.19, "thesis"), ("drive.current_offset", -0.015, "thesis"),
    ("drive.transport_delay", 0.0037, "thesis"), ("drive.kp", 5.0, "thesis"), ("drive.ki", 0.1, "thesis"),
    ("controller.position.ki", 225.0, "estimate"), ("command.limit", pi / 9, "thesis"),
    ("fin.stop_angle", 25 * pi / 180, "estimate"), ("friction.viscous.negative", 0.00046, "estimate"),
    ("friction.coulomb.positive[3]", -0.006, "estimate"), ("friction.coulomb.negative[6]", 0.003, "estimate"),
    ("friction.temperature", 24.0, "estimate"), ("encoder.pulses", 2048, "thesis"), ("encoder.multiplier", 4, "thesis"),
    ("encoder.enabled", True, "estimate"), ("loads.gravity", False, "estimate"), ("solver.max_tick", 0.0007, "derived"),
])
def test_default_value_and_source(name: str, expected: float, source: str) -> None:
    entry = next(e for e in DEFAULTS.entries if e.variable.name == name)
    assert entry.value == pytest.approx(expected, rel=1e-15, abs=0)
    assert entry.source == source


def test_derived_defaults_follow_from_their_sources() -> None:
    v = DEFAULTS.values
    assert v["screw.lead"] == pytest.approx((3e-4 / 476) ** 0.5, rel=5e-3)
    assert v["inertia.screw"] == pytest.approx(7850 * pi * 0.006**2 * 0.2785 * 0.006**2 / 2, rel=2e-2)
    ratio = v["kinematics.moment_arm"] / v["screw.lead"]
    total = (v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * v["screw.lead"] ** 2
             + (v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]) / ratio**2)
    assert total == pytest.approx(3e-4, rel=1e-2)


def test_notes_contain_the_alternative_current_loop() -> None:
    notes = {e.variable.name: e.note for e in DEFAULTS.entries}
    assert "0.208" in notes["drive.kp"]
    assert "1.04 V/A" in notes["drive.kp"]
    assert "0.018" in notes["drive.ki"]
    assert "0.0018 V/(A*s)" in notes["drive.ki"]


def test_example_in_the_default_file_works(load: Load) -> None:
    comment = (models_directory() / "emcas.toml").read_text(encoding="utf-8").split("\n\n")[0]
    chosen = load("\n".join(re.findall(r"^#   (\[.*|\w+ = .*)", comment, re.MULTILINE)))
    changed = {e.variable.name: (e.value, e.source, e.note) for e in chosen.entries if e not in DEFAULTS.entries}
    assert changed == {"kinematics.moment_arm": (0.05, "user", ""),
                       "motor.resistance": (0.24, "datasheet", "line to line")}


@pytest.mark.parametrize(("text", "name", "expected", "written"), [
    ('[kinematics]\nmoment_arm = "50.8 mm"', "kinematics.moment_arm", 0.0508, "50.8 mm"),
    ('kinematics.moment_arm = "2in"', "kinematics.moment_arm", 0.0508, "2in"),
    ('"kinematics.moment_arm" = " 6 cm "', "kinematics.moment_arm", 0.06, " 6 cm "),
    ('kinematics = { moment_arm = { value = 60, unit = "mm" } }', "kinematics.moment_arm", 0.06, "60 mm"),
    ('[kinematics.moment_arm]\nvalue = 6.0e1\nunit = "mm"', "kinematics.moment_arm", 0.06, "6.0e1 mm"),
    ('kinematics.moment_arm = { value = "60 mm" }', "kinematics.moment_arm", 0.06, "60 mm"),
    ('kinematics.moment_arm = { value = "6_0", unit = "mm" }', "kinematics.moment_arm", 0.06, "6_0 mm"),
    ('kinematics.initial_angle = "-3 deg"', "kinematics.initial_angle", -pi / 60, "-3 deg"),
    ('kinematics.initial_angle = "3°"', "kinematics.initial_angle", pi / 60, "3°"),
    ('screw.lead = "4 mm/rev"', "screw.lead", 0.002 / pi, "4 mm/rev"),
    ('screw.lead = "0.7 mm/rad"', "screw.lead", 0.0007, "0.7 mm/rad"),
    ('inertia.motor = "2500 g*cm^2"', "inertia.motor", 2.5e-4, "2500 g*cm^2"),
    ('inertia.motor = "0.00025 kg.m2"', "inertia.motor", 2.5e-4, "0.00025 kg.m2"),
    ('mass.nut = "1 lb"', "mass.nut", 0.45359237, "1 lb"),
    ('friction.fin_coulomb = "10 lbf*in"', "friction.fin_coulomb", 1.1298482902761668, "10 lbf*in"),
    ('friction.fin_coulomb = "10 Nm"', "friction.fin_coulomb", 10.0, "10 Nm"),
    ('friction.fin_coulomb = "10 N·m"', "friction.fin_coulomb", 10.0, "10 N·m"),
    ('friction.fin_viscous = "1 N*m/(deg/s)"', "friction.fin_viscous", 180 / pi, "1 N*m/(deg/s)"),
    ('motor.back_emf_constant = "11.52 V/krpm"', "motor.back_emf_constant", 11.52 * 60 / (2000 * pi), "11.52 V/krpm"),
    ('motor.resistance = "300 mΩ"', "motor.resistance", 0.3, "300 mΩ"),
    ('controller.speed_limit = "3000 rpm"', "controller.speed_limit", 100 * pi, "3000 rpm"),
    ('controller.position.kp = "50 /s"', "controller.position.kp", 50.0, "50 /s"),
    ('controller.position.ki = "50 s^-2"', "controller.position.ki", 50.0, "50 s^-2"),
    ('friction.temperature = "-6 degC"', "friction.temperature", -6.0, "-6 degC"),
    ('friction.temperature = "-6 °C"', "friction.temperature", -6.0, "-6 °C"),
    ('friction.temperature = "267.15 K"', "friction.temperature", -6.0, "267.15 K"),
    ('friction.temperature = "21.2 degF"', "friction.temperature", -6.0, "21.2 degF"),
    ('"friction.table.viscous[0]" = 2', "friction.table.viscous[0]", 2.0, "2"),
    ('"friction.table.viscous[0]" = "150 %"', "friction.table.viscous[0]", 1.5, "150 %"),
    ('compensation.gain = { value = 0.50, unit = "1" }', "compensation.gain", 0.5, "0.50"),
    ("encoder.pulses = 4096", "encoder.pulses", 4096, "4096"),
    ("encoder.pulses = 4096.0", "encoder.pulses", 4096, "4096.0"),
    ("encoder.enabled = false", "encoder.enabled", False, "false"),
    ("loads.gravity = { value = true }", "loads.gravity", True, "true"),
    ('"friction.coulomb.negative[2]" = "25 mN*m"', "friction.coulomb.negative[2]", 0.025, "25 mN*m"),
    ('drive.supply_voltage = "28 V"', "drive.supply_voltage", 28.0, "28 V"),
    ('fin.stop_angle = "80 deg"\nkinematics.initial_angle="0 deg"', "fin.stop_angle", radians(80), "80 deg"),
    ('\ufeffmass.nut = "1 kg"', "mass.nut", 1.0, "1 kg"),
])
def test_value_of_a_user_file_is_converted(load: Load, text: str, name: str, expected: float, written: str) -> None:
    entry = next(e for e in load(text).entries if e.variable.name == name)
    assert entry.value == pytest.approx(expected, rel=4e-16, abs=0)
    assert type(entry.value) is type(DEFAULTS.values[name])
    assert (entry.text, entry.source, entry.note, entry.file) == (written, "user", "", "mine.toml")


@pytest.mark.parametrize("written", [
    '["300 mN*m", "0 N*m", "0.02 N*m", "0 N*m", "0 N*m", "0 N*m", "1 lbf*in"]',
    '{ value = [300, 0, 20, 0, 0, 0, 112.984829027616670], unit = "mN*m" }',
])
def test_array_of_a_user_file_is_converted(load: Load, written: str) -> None:
    chosen = load(f"friction.coulomb.positive = {written}")
    expected = (0.3, 0.0, 0.02, 0.0, 0.0, 0.0, 0.11298482902761667)
    assert chosen.nested().friction.coulomb.positive == pytest.approx(expected, rel=4e-16, abs=0)
    assert chosen.nested().friction.coulomb.negative == DEFAULTS.nested().friction.coulomb.negative


def test_source_and_note_of_a_user_file_are_read(load: Load) -> None:
    chosen = load('mass.fin = { value = 4, unit = "kg", source = "weighed", note = "with paint" }')
    entry = next(e for e in chosen.entries if e.variable.name == "mass.fin")
    assert (entry.value, entry.source, entry.note) == (4.0, "weighed", "with paint")


def test_parameters_not_in_a_file_have_default_values(load: Load) -> None:
    chosen = load('mass.fin = "4 kg"')
    changed = [a for a, b in zip(chosen.entries, DEFAULTS.entries, strict=True) if a != b]
    assert [e.variable.name for e in changed] == ["mass.fin"]


@pytest.mark.parametrize(("name", "follower", "unit"), [
    ("torque_constant", "back_emf_constant", "N*m/A"), ("back_emf_constant", "torque_constant", "V*s/rad")])
def test_torque_and_back_emf_constant_follow_each_other(load: Load, name: str, follower: str, unit: str) -> None:
    entries = {e.variable.name: e for e in load(f'motor.{name} = "94 m{unit}"').entries}
    entry = entries[f"motor.{follower}"]
    assert entry.value == entries[f"motor.{name}"].value == 0.094
    assert (entry.text, entry.source, entry.file) == (f"as motor.{name}", "derived", "mine.toml")
    assert f"Follows from motor.{name}" in entry.note
    assert {n for n, e in entries.items() if e.value != DEFAULTS.values[n]} == {f"motor.{name}", f"motor.{follower}"}


def test_two_constants_in_a_file_do_not_follow_each_other(load: Load) -> None:
    chosen = load('motor.torque_constant = "0.094 N*m/A"\nmotor.back_emf_constant = "0.1 V*s/rad"')
    assert (chosen.values["motor.torque_constant"], chosen.values["motor.back_emf_constant"]) == (0.094, 0.1)


def test_constant_of_an_earlier_file_does_not_follow(tmp_path: Path) -> None:
    """A constant that followed in the first file follows again in the second."""
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text('motor.torque_constant = "0.094 N*m/A"', encoding="utf-8")
    second.write_text('motor.back_emf_constant = "0.05 V*s/rad"', encoding="utf-8")
    chosen = load_parameters([first, second])
    assert (chosen.values["motor.torque_constant"], chosen.values["motor.back_emf_constant"]) == (0.094, 0.05)
    assert len(chosen.warnings) == 1
    second.write_text('motor.torque_constant = "0.05 N*m/A"', encoding="utf-8")
    assert load_parameters([first, second]).values["motor.back_emf_constant"] == 0.05


def test_with_values_changes_only_named_parameters() -> None:
    """Tuning cases and samples of campaigns name all parameters that they change."""
    changed = DEFAULTS.with_values({"motor.torque_constant": 0.1})
    assert changed.values["motor.back_emf_constant"] == DEFAULTS.values["motor.back_emf_constant"]


def test_torque_constant_cannot_follow_to_zero(load: Load) -> None:
    (problem,) = problems(load, 'motor.back_emf_constant = "0 V*s/rad"')
    for fragment in ("mine.toml: motor.back_emf_constant = 0 V*s/rad", "motor.torque_constant", "1e-06 N.m/A",
                     "set motor.torque_constant too"):
        assert fragment in problem
    both = load('motor.back_emf_constant = "0 V*s/rad"\nmotor.torque_constant = "0.1 N*m/A"')
    assert len(both.warnings) == 1


@pytest.mark.parametrize(("back_emf", "warned"), [
    (0.11 * 1.19, False), (0.11 * 1.21, True), (0.11 / 1.19, False), (0.11 / 1.21, True)])
def test_inconsistent_motor_constants_give_a_warning(load: Load, back_emf: float, warned: bool) -> None:
    chosen = load(f'motor.torque_constant = "110 mN*m/A"\nmotor.back_emf_constant = "{back_emf} V*s/rad"')
    warnings = [warning for warning in chosen.warnings if "equal for a motor" in warning]
    assert len(warnings) == warned
    for line in warnings:
        for fragment in ("motor.torque_constant = 110 mN*m/A", f"{back_emf:.6g}", "set only one"):
            assert fragment in line


def test_empty_file_and_default_file_give_the_defaults(load: Load) -> None:
    assert load("[kinematics]\n").entries == DEFAULTS.entries
    assert load_parameters(models_directory() / "emcas.toml").values == DEFAULTS.values
    assert load_parameters(str(models_directory() / "emcas.toml")).values == DEFAULTS.values


@pytest.mark.parametrize(("text", "fragments"), [
    # unknown names
    ('kinematics.moment_am = "50 mm"', ["kinematics.moment_am = 50 mm", "unknown parameter",
                                        "did you mean kinematics.moment_arm?"]),
    ('[kinematic]\nmoment_arm = "50 mm"', ["kinematic.moment_arm", "did you mean kinematics.moment_arm?"]),
    ("[nonsense]", ["nonsense = {}", "unknown parameter"]), ("qqqq = 1", ["qqqq = 1: unknown parameter"]),
    ('friction.coulomb = "0.2 N*m"', ["friction.coulomb = 0.2 N*m", "group", "friction.coulomb.positive"]),
    ("kinematics = 5", ["kinematics = 5", "group", "kinematics.moment_arm"]),
    ('mass.fin = { valu = 4, unit = "kg" }', ["mass.fin", "unknown field 'valu'", "did you mean value?"]),
    ('mass.fin = { unit = "kg" }', ["mass.fin = (nothing) kg", "has no value"]),
    ('"friction.coulomb.positive[7]" = "0 N*m"', ["friction.coulomb.positive[7]", "unknown parameter"]),
    ('mass.fin = "4 kg"\n"mass.fin" = "5 kg"', ["mass.fin = 5 kg", "set twice"]),
    # units
    ("kinematics.moment_arm = 0.05", ["kinematics.moment_arm = 0.05", "no unit", "such as m"]),
    ('kinematics.moment_arm = "0.05"', ["kinematics.moment_arm = 0.05", "no unit", "such as m"]),
    ('kinematics.moment_arm = "50 frobs"', ["50 frobs", "unknown unit 'frobs'"]),
    ('kinematics.moment_arm = "50 milimeter"', ["unknown unit 'milimeter'", "did you mean millimeter?"]),
    ('kinematics.moment_arm = "50 mm,"', ["unknown unit 'mm,'"]),
    ('kinematics.moment_arm = "50 (mm"', ["unknown unit '(mm'"]),
    ('kinematics.moment_arm = "50 3 mm"', ["unknown unit '3 mm'"]),
    ('kinematics.moment_arm = "50 kg"', ["50 kg", "unit kg does not measure", "such as m"]),
    ('kinematics.moment_arm = { value = "50 mm", unit = "mm" }', ["two units"]),
    ('kinematics.moment_arm = { value = 50, unit = 3 }', ["unit = 3", "expected a string"]),
    ('kinematics.moment_arm = { value = 50, unit = "mm", note = 3 }', ["note = 3", "expected a string"]),
    ('kinematics.initial_angle = "50 mm"', ["unit mm does not measure", "such as rad"]),
    ("kinematics.initial_angle = 0.1", ["no unit", "such as rad"]),
    ('kinematics.initial_angle = { value = 0.1, unit = "1" }', ["unit 1 does not measure", "such as rad"]),
    ('controller.position.kp = "5 deg"', ["unit deg does not measure", "such as 1/s"]),
    ('controller.position.kp = "5 rpm"', ["unit rpm does not measure", "such as 1/s"]),
    ('controller.speed_limit = "50 Hz"', ["unit Hz does not measure", "such as rad/s"]),
    ('screw.lead = "5 mm"', ["unit mm does not measure", "such as m/rad"]),
    ('motor.back_emf_constant = "0.11 V*s"', ["unit V*s does not measure", "such as V.s/rad"]),
    ('compensation.gain = "5 deg"', ["unit deg does not measure", "expected a pure number"]),
    ('friction.fin_coulomb = "10 oz*in"', ["unit oz*in does not measure", "such as N.m"]),
    ('friction.temperature = "5 delta_degC"', ["unknown unit 'delta_degC'"]),
    ('friction.temperature = "5 delta_degree_Celsius"', ["cannot be converted to degC"]),
    ('friction.temperature = "5 delta_degree_Celsiu"', ["did you mean degree_Celsius?"]),
    ('encoder.enabled = { value = true, unit = "1" }', ["encoder.enabled = true", "no unit"]),
    # types
    ("kinematics.moment_arm = true", ["kinematics.moment_arm = true", "expected a number"]),
    ("kinematics.moment_arm = 1979-05-27", ["1979-05-27", "expected a number"]),
    ('kinematics.moment_arm = ["50 mm"]', ["['50 mm']", "expected a number"]),
    ('kinematics.moment_arm = "about 50 mm"', ["about 50 mm", "is not a number"]),
    ('kinematics.moment_arm = ""', ["is not a number"]),
    ('compensation.gain = "on"', ["is not a number", "a pure number"]),
    ("encoder.enabled = 1", ["encoder.enabled = 1", "expected true or false"]),
    ('encoder.enabled = "true"', ["expected true or false"]),
    ("encoder.pulses = 2048.5", ["encoder.pulses = 2048.5", "whole number"]),
    ("encoder.pulses = true", ["encoder.pulses = true", "a pure number"]),
    # values
    ('kinematics.moment_arm = { value = nan, unit = "m" }', ["nan m", "not a finite number"]),
    ('kinematics.moment_arm = { value = -inf, unit = "m" }', ["-inf m", "not a finite number"]),
    ('kinematics.moment_arm = "1e999 m"', ["1e999 m", "not a finite number"]),
    ('kinematics.moment_arm = "1e-99999999999999999999 m"', ["is 0 m", "0.001 .. 1 m"]),
    ('kinematics.moment_arm = "5 m"', ["= 5 m", "must be within 0.001 .. 1 m"]),
    ('kinematics.moment_arm = "0.9 mm"', ["0.9 mm", "is 0.0009 m", "must be within 0.001 .. 1 m"]),
    ('command.limit = "81 deg"', ["81 deg", "is 1.41372 rad", "0.00174533 .. 1.39626 rad"]),
    ("encoder.pulses = 0", ["encoder.pulses = 0", "1 .. 1e+06"]),
    ("compensation.gain = -0.1", ["compensation.gain = -0.1", "must be within 0 .. 10"]),
    ("friction.cold_viscous_ratio = 1.6", ["unknown parameter; did you mean friction.table.viscous?"]),
    # arrays
    ('friction.coulomb.positive = ["1 N*m"]', ["friction.coulomb.positive = ['1 N*m']",
                                               "array of 7 values"]),
    ('friction.coulomb.positive = "1 N*m"', ["friction.coulomb.positive = 1 N*m", "array of 7 values"]),
    ('friction.coulomb.positive = { unit = "N*m" }', ["friction.coulomb.positive", "array of 7 values"]),
    # combinations
    ('fin.stop_angle = "19 deg"', ["fin.stop_angle = 0.331613 rad (19 deg)", "command.limit", "(20 deg)"]),
])
def test_problem_names_file_key_value_and_remedy(load: Load, text: str, fragments: list[str]) -> None:
    reported = problems(load, text)
    assert len(reported) == 1
    assert re.match(r".*mine\.toml: ", reported[0])
    for fragment in fragments:
        assert fragment in reported[0]


def test_all_problems_of_a_file_are_reported(load: Load) -> None:
    reported = problems(load, """
        kinematics.moment_arm = 0.05
        motor.resistanc = "1 Ohm"
        encoder.enabled = 1
        friction.coulomb.positive = [0.2, "0 m", "0 N*m", "0 N*m", "0 N*m", "0 N*m", "99 N*m"]
        mass.fin = "4 kg"
    """)
    keys = [problem.split("mine.toml: ")[1].split(" = ")[0] for problem in reported]
    assert keys == ["kinematics.moment_arm", "motor.resistanc", "encoder.enabled",
                    "friction.coulomb.positive[0]",
                    "friction.coulomb.positive[1]", "friction.coulomb.positive[6]"]


def test_combinations_are_checked_after_single_values(load: Load) -> None:
    assert len(problems(load, 'fin.stop_angle = 30\ncommand.limit = "28 deg"')) == 1
    assert len(problems(load, 'fin.stop_angle = "27 deg"\ncommand.limit = "28 deg"')) == 1
    assert load('fin.stop_angle = "30 deg"\ncommand.limit = "28 deg"').values["command.limit"] == radians(28)


def test_message_contains_every_problem_and_survives_pickling(load: Load) -> None:
    with pytest.raises(ParameterError) as caught:
        load("mass.fin = 1\nmass.nut = 2")
    error = caught.value
    assert isinstance(error, ValueError)
    assert str(error).splitlines() == list(error.problems)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.problems) == (str(error), error.problems)


@pytest.mark.parametrize(("content", "fragment"), [
    (b"mass.fin = = 3", "is not valid TOML: Invalid value (at line 1"), (b"[a]\n[a]\n", "is not valid TOML"),
    (b"mass.fin = '\xff'", "cannot be read: it is not a text file in UTF-8"),
    (b"mass.fin = " + b"[" * 100_000, "is not valid TOML"),
])
def test_unreadable_content_is_refused(tmp_path: Path, content: bytes, fragment: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    with pytest.raises(ParameterError, match=re.escape(f"{path}: {fragment}")):
        load_parameters(path)


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"none\.toml: cannot be read: there is no such file or folder; check its"):
        load_parameters(tmp_path / "none.toml")
    with pytest.raises(ParameterError, match="cannot be read"):
        load_parameters(tmp_path)


@pytest.mark.parametrize(("old", "new", "fragments"), [
    ("\n[screw]\nlead", "\n[screw]\n#", ["screw.lead: missing"]),
    ("\ncoulomb.negative =", "\n#",
     [f"friction.coulomb.negative[{i}]: missing" for i in range(7)]),
    ("value = 0.05, unit = \"m\"", "value = 5, unit = \"m\"", ["kinematics.moment_arm = 5 m: is 5 m"]),
    ("stop_angle = { value = 25,", "stop_angle = { value = 15,", ["fin.stop_angle = 0.261799 rad (15 deg)"]),
])
def test_faulty_default_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str,
                             fragments: list[str]) -> None:
    text = (models_directory() / "emcas.toml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    (tmp_path / "emcas.toml").write_text(text.replace(old, new), encoding="utf-8")
    monkeypatch.setattr(parameters, "models_directory", lambda: tmp_path)
    with pytest.raises(ParameterError) as caught:
        load_parameters()
    assert len(caught.value.problems) == len(fragments)
    for problem, fragment in zip(caught.value.problems, fragments, strict=True):
        assert problem.startswith(f"{tmp_path / 'emcas.toml'}: {fragment}")


@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=12), st.sampled_from(sorted(VARIABLES)))
def test_any_text_gives_a_value_or_a_parameter_error(text: str, name: str) -> None:
    for written in (text, f"1 {text}"):
        reported: tuple[str, ...] = ()
        chosen = DEFAULTS
        try:
            chosen = DEFAULTS.with_values({name: written})
        except ParameterError as error:
            reported = error.problems
        # A problem of a combination names all its parameters, arrays without index.
        assert all(name.partition("[")[0] in problem for problem in reported)
        assert VARIABLES[name].minimum <= chosen.values[name] <= VARIABLES[name].maximum


@given(st.text(alphabet="mskgNAVrad/*^().-0123456789 °·²", max_size=14))
def test_any_unit_gives_a_positive_factor_or_a_unit_error(unit: str) -> None:
    refused, value = "", 0.0
    try:
        value = quantity(f"2 {unit}", "", "m")
    except UnitError as error:
        refused = str(error)
    assert "unit" in refused or value > 0.0


# Factors of units to the SI unit, written independently of the package.
FACTORS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "mm": 1e-3, "in": 0.0254, "ft": 0.3048, "µm": 1e-6},
    "rad": {"rad": 1.0, "deg": pi / 180, "mrad": 1e-3, "turn": 2 * pi, "arcmin": pi / 10800},
    "rad/s": {"rad/s": 1.0, "deg/s": pi / 180, "rpm": pi / 30},
    "m/rad": {"m/rad": 1.0, "mm/turn": 1e-3 / (2 * pi), "in/rev": 0.0254 / (2 * pi)},
    "kg": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237, "slug": 14.593902937206364},
    "kg.m2": {"kg.m2": 1.0, "g*cm^2": 1e-7, "lb*in^2": 0.45359237 * 0.0254**2, "kg·m²": 1.0},
    "N.m": {"N.m": 1.0, "mN*m": 1e-3, "lbf*in": 4.4482216152605 * 0.0254, "kgf*cm": 0.0980665},
    "N.m.s/rad": {"N.m.s/rad": 1.0, "N*m/rpm": 30 / pi, "N*m/(deg/s)": 180 / pi},
    "N.m/A": {"N.m/A": 1.0, "ozf*in/A": 4.4482216152605 / 16 * 0.0254}, "V/rad": {"V/rad": 1.0, "mV/deg": 0.18 / pi},
    "V.s/rad": {"V.s/rad": 1.0, "V/krpm": 30 / pi / 1000, "mV*s/deg": 0.18 / pi},
    "Ohm": {"Ohm": 1.0, "mohm": 1e-3, "kΩ": 1e3}, "H": {"H": 1.0, "mH": 1e-3, "uH": 1e-6}, "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "kV": 1e3}, "A/V": {"A/V": 1.0, "mA/mV": 1.0}, "V/A": {"V/A": 1.0, "Ohm": 1.0},
    "V/(A.s)": {"V/(A.s)": 1.0, "V/A/ms": 1e3}, "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "1/s": {"1/s": 1.0, "1/ms": 1e3, "s^-1": 1.0, "Hz": 1.0}, "1/s2": {"1/s2": 1.0, "1/ms^2": 1e6},
    "1": {"": 1.0, "1": 1.0, "percent": 1e-2, "%": 1e-2},
}


def test_every_unit_of_the_parameters_is_tested() -> None:
    assert {v.unit for v in FILE_ENTRIES if v.kind != "Boolean"} == {*FACTORS, "degC"}


@given(st.sampled_from([(unit, written) for unit, options in FACTORS.items() for written in options]),
       st.floats(-1e12, 1e12))
def test_quantity_is_converted_from_every_unit(units: tuple[str, str], value: float) -> None:
    unit, written = units
    number = repr(value / FACTORS[unit][written])
    expected = pytest.approx(value, rel=1e-15, abs=1e-300)
    assert quantity(f"{number} {written}", "", unit) == expected
    assert quantity(number, written, unit) == expected


@given(st.data(), st.sampled_from([v for v in FILE_ENTRIES
                                   if v.kind == "Real" and v.name.startswith(("motor.", "inertia."))]))
def test_parameter_is_converted_from_every_unit(data: st.DataObject, variable: Variable) -> None:
    value = data.draw(st.floats(variable.minimum, variable.maximum))
    written, factor = data.draw(st.sampled_from(sorted(FACTORS[variable.unit].items())))
    chosen = DEFAULTS.with_values({variable.name: f"{value / factor!r} {written}"})
    assert chosen.values[variable.name] == pytest.approx(value, rel=1e-12, abs=1e-300)


@given(st.floats(-100, 200))
def test_temperatures_are_converted_with_their_offset(celsius: float) -> None:
    assert quantity(repr(celsius), "degC", "degC") == celsius
    assert quantity(repr(celsius + 273.15), "K", "degC") == pytest.approx(celsius, abs=1e-12)
    assert quantity(repr(celsius * 1.8 + 32), "degF", "degC") == pytest.approx(celsius, abs=1e-12)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_value_in_its_si_unit_is_exact(value: float) -> None:
    assert quantity(repr(value), "m", "m") == value


def test_conversion_rounds_once() -> None:
    for micro in range(1, 2000, 7):
        assert quantity(f"{micro}", "us", "s") == float(f"{micro}e-6")


def test_limits_are_inclusive_in_any_unit(load: Load) -> None:
    for text, name in (("1000 mm", "maximum"), ("1 mm", "minimum")):
        chosen = load(f'kinematics.moment_arm = "{text}"')
        assert chosen.values["kinematics.moment_arm"] == getattr(VARIABLES["kinematics.moment_arm"], name)
    for sign, name in ((1, "maximum"), (-1, "minimum")):
        # Without correction, the converted value is one unit in the last place outside the limit.
        chosen = load(f'kinematics.initial_angle = "{60 * sign} deg"\nfin.stop_angle = "20 deg"')
        limit = getattr(VARIABLES["kinematics.initial_angle"], name)
        assert quantity(f"{60 * sign} deg", "", "rad") != limit
        assert chosen.values["kinematics.initial_angle"] == limit
    assert "must be within" in problems(load, 'kinematics.initial_angle = "60.000001 deg"')[0]


def test_with_values_accepts_numbers_texts_and_arrays() -> None:
    chosen = DEFAULTS.with_values(
        {"command.limit": 0.3, "kinematics.moment_arm": "60 mm", "encoder.pulses": 1000,
         "friction.coulomb.positive": (0.3, 0, 0, 0, 0, 0, "10 mN*m")},
        **{"encoder.enabled": False, "friction.temperature": -6},
    )
    changed = {n: v for n, v in chosen.values.items() if v != DEFAULTS.values[n]}
    assert changed == {
        "command.limit": 0.3, "kinematics.moment_arm": 0.06, "encoder.pulses": 1000, "encoder.enabled": False,
        "friction.temperature": -6.0, "friction.coulomb.positive[0]": 0.3, "friction.coulomb.positive[1]": 0.0,
        "friction.coulomb.positive[2]": 0.0, "friction.coulomb.positive[3]": 0.0,
        "friction.coulomb.positive[4]": 0.0, "friction.coulomb.positive[6]": 0.01,
    }
    assert list(chosen.values) == list(DEFAULTS.values)
    entry = next(e for e in chosen.entries if e.variable.name == "command.limit")
    assert (entry.text, entry.source, entry.file) == ("0.3 rad", "user", "")
    assert load_parameters() == DEFAULTS


@pytest.mark.parametrize(("overrides", "fragment"), [
    ({"command.limit": nan}, "command.limit = nan rad: is not a finite number"),
    ({"command.limit": -1.0}, "command.limit = -1.0 rad: is -1 rad"),
    ({"command.limt": 0.3}, "did you mean command.limit?"),
    ({"command.limit": None}, "expected a number with a unit such as rad"),
    ({"encoder.enabled": 1}, "expected true or false"),
    ({"encoder.multiplier": 3}, "encoder.multiplier = 3 must be 1, 2 or 4"),
    ({"friction.coulomb.positive": [0.2]}, "array of 7 values"),
])
def test_with_values_refuses_wrong_values(overrides: dict[str, object], fragment: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(fragment)):
        DEFAULTS.with_values(overrides)


def test_set_is_constant_and_can_be_pickled() -> None:
    with pytest.raises(TypeError, match="does not support item assignment"):
        DEFAULTS.values["mass.fin"] = 1.0  # type: ignore[index]
    with pytest.raises(AttributeError):
        DEFAULTS.entries = ()  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(DEFAULTS)) == DEFAULTS
    assert hash(DEFAULTS) == hash(load_parameters())


def test_repr_counts_changed_values_and_reads_no_file(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three values with the one that follows; then a further value, and another change of the first."""
    from_file = load("screw.lead = '5 mm/turn'\nmotor.torque_constant = '0.05 N.m/A'")
    changed = from_file.with_values({"screw.lead": "6 mm/turn", "kinematics.moment_arm": "42 mm"})

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a file is read")

    with monkeypatch.context() as patched:
        for module, function in ((os, "stat"), (os, "lstat"), (os, "open"), (builtins, "open"), (io, "open")):
            patched.setattr(module, function, refuse)
        shown = [repr(each) for each in (DEFAULTS, from_file, changed)]
    count = len(DEFAULTS.entries)
    assert shown == [f"<ParameterSet of nonlinear: {count} values, {k} over the default ones>" for k in (0, 3, 4)]


def test_nested_values_have_attributes_and_tuples() -> None:
    p = DEFAULTS.nested()
    assert p.kinematics.moment_arm == 0.05
    assert p.controller.position.kp == 53.8
    assert p.friction.coulomb.positive == (0.205, 0.01, 0.028, -0.006, 0.012, 0.0, 0.004)
    assert p.friction.viscous.negative == 0.00046
    assert p.encoder.enabled is True


def test_namespace_accepts_any_value() -> None:
    marker = object()
    nested = namespace({"a.b.c": marker, "a.b.d[0]": "x", "a.b.d[1]": marker, "e": 1})
    assert nested.a.b.c is marker
    assert nested.a.b.d == ("x", marker)
    assert nested.e == 1


def test_rules_need_only_the_standard_library() -> None:
    folder = Path(rules.__file__).parents[1]
    program = (f"import sys; sys.path.insert(0, {str(folder)!r}); "
               "import emcas_fmu.rules as module; print(module.__file__)")
    done = subprocess.run([sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == (rules.__file__, "")


def test_values_outside_their_range_are_reported() -> None:
    table = [("a", 0.0, 1.0), ("b", -inf, 5.0), ("c", 1, 4)]
    assert check_ranges({"a": 0.0, "b": -1e300, "c": 4, "d": nan}, table) == []
    assert check_ranges({"a": -0.5, "b": 5.5, "c": 1}, table) == [
        "a = -0.5 is below its minimum 0", "b = 5.5 is above its maximum 5"]
    assert check_ranges({"a": nan, "b": -inf, "c": 2}, table) == [
        "a = nan is not a finite number", "b = -inf is not a finite number"]
    with pytest.raises(KeyError):
        check_ranges({"a": 0.0}, table)


def test_defaults_are_consistent() -> None:
    assert check_combinations(DEFAULTS.values, ACTUATOR) == []
    assert check_ranges(DEFAULTS.values, [(v.name, v.minimum, v.maximum) for v in FILE_ENTRIES]) == []


def coulomb(direction: str, *coefficients: float) -> dict[str, float]:
    """Return the Coulomb friction's polynomial, with 0 for further coefficients."""
    padded = [*coefficients, *[0.0] * (7 - len(coefficients))]
    return {f"friction.coulomb.{direction}[{i}]": c for i, c in enumerate(padded)}


@pytest.mark.parametrize("changes", [
    {"command.limit": radians(25)}, {"fin.start_angle": radians(25)}, {"fin.start_angle": radians(-25)},
    {"kinematics.initial_angle": radians(59.9)}, {"kinematics.initial_angle": radians(-59.9)},
    {"drive.transport_delay": 0.032, "controller.sample_time": 0.0005},
    {"drive.transport_delay": 0.0032, "controller.sample_time": 5e-5}, {"drive.transport_delay": 0.0},
    {"encoder.multiplier": 1}, {"encoder.multiplier": 2}, coulomb("positive"),
    coulomb("negative", 0.125, -0.1),  # 0 at the stop: 25/20 = 1.25
    coulomb("negative", 0.0016071428571428571, -0.0012857142857142859),  # 0 at the stop within rounding
    coulomb("positive", 0.001, -0.02, 0.1),  # lowest 0 at 2 deg
])
def test_combinations_up_to_their_limit_are_accepted(changes: dict[str, float]) -> None:
    assert check_combinations({**DEFAULTS.values, **changes}, ACTUATOR) == []


@pytest.mark.parametrize(("changes", "fragments"), [
    ({"command.limit": radians(25.01)},
     ["fin.stop_angle = 0.436332 rad (25 deg)", "at least command.limit = 0.436507 rad (25.01 deg)"]),
    ({"fin.start_angle": radians(25.01)}, ["fin.start_angle = 0.436507 rad", "fin.stop_angle", "(25 deg)"]),
    ({"fin.start_angle": radians(-26)}, ["fin.start_angle = -0.453786 rad (-26 deg)", "fin.stop_angle"]),
    ({"kinematics.initial_angle": radians(60)}, ["kinematics.initial_angle", "(60 deg)", "fin.stop_angle",
                                                 "(25 deg)", "below 1.48353 rad (85 deg)"]),
    ({"kinematics.initial_angle": radians(-60)}, ["kinematics.initial_angle", "(60 deg)"]),
    ({"drive.transport_delay": 0.0321, "controller.sample_time": 0.0005},
     ["drive.transport_delay = 0.0321 s", "64 times",
                                         "controller.sample_time = 0.0005 s"]),
    ({"friction.identified_from": 30.0}, ["friction.identified_from = 30 degC", "at most friction.identified_to = 24"]),
    ({"encoder.multiplier": 3}, ["encoder.multiplier = 3", "1, 2 or 4"]),
    (coulomb("positive", -1e-6), ["friction.coulomb.positive = [-1e-06, 0, 0, 0, 0, 0, 0] N.m",
                                  "friction of -1e-06 N.m"]),
    (coulomb("negative", 0.12, -0.1), ["friction.coulomb.negative", "-0.005 N.m at fin_angle = 0.436332 rad",
                                       "fin.stop_angle"]),
    (coulomb("positive", 0.12, 0.1), ["-0.005 N.m at fin_angle = -0.436332 rad"]),
    (coulomb("positive", 0.0009, -0.02, 0.1), ["-0.0001 N.m at fin_angle = 0.0349066 rad (2 deg)"]),
])
def test_inconsistent_combination_is_reported(changes: dict[str, float], fragments: list[str]) -> None:
    reported = check_combinations({**DEFAULTS.values, **changes}, ACTUATOR)
    assert len(reported) == 1
    for fragment in fragments:
        assert fragment in reported[0]


def test_non_finite_values_are_reported_before_combinations() -> None:
    reported = check_parameters({**DEFAULTS.values, "mass.fin": nan, "fin.stop_angle": -inf, "encoder.multiplier": 3})
    assert reported == ["mass.fin = nan is not a finite number", "fin.stop_angle = -inf is not a finite number"]


def test_several_inconsistencies_are_reported() -> None:
    reported = check_combinations({**DEFAULTS.values, "fin.stop_angle": 0.1, "fin.start_angle": 0.2,
                                "encoder.multiplier": 3}, ACTUATOR)
    names = [problem.split(" = ")[0] for problem in reported]
    assert names == ["fin.stop_angle", "fin.start_angle", "encoder.multiplier"]


@pytest.mark.parametrize("inside", [True, False], ids=["installed", "checkout"])
def test_models_directory_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: bool) -> None:
    package = tmp_path / "emcas_fmu"
    models = (package if inside else tmp_path) / "models"
    models.mkdir(parents=True)
    (models / "emcas.toml").touch()
    (tmp_path / "models").mkdir(exist_ok=True)  # of another package, if installed
    monkeypatch.setattr(files, "__file__", str(package / "support" / "files.py"))
    assert models_directory() == models


def test_missing_models_directory_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").mkdir()
    monkeypatch.setattr(files, "__file__", str(tmp_path / "emcas_fmu" / "support" / "files.py"))
    with pytest.raises(FileNotFoundError) as caught:
        models_directory()
    for part in ("emcas.toml", str(tmp_path / "models"), str(tmp_path / "emcas_fmu" / "models")):
        assert part in str(caught.value)

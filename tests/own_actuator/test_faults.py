"""Faults that a user's actuator declares, and the general faults of an actuator without a screw."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import degrees, exp, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.actuators.declaration import Actuator, PlantFault
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions import faults as extension
from emcas_fmu.extensions.fault_list import FAULTS, bits, possible
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import simulator
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate
from emcas_fmu.variables import tunable
from tests.simulation import CompiledCore

from .example import MODEL, changed

FAULTY = f"{MODEL}+faults"
PLAIN = load_parameters(model=MODEL)
BASE = load_parameters(model=FAULTY)
NAMES = bits(get(MODEL))
DEMAGNETISED = 2.0 ** len(FAULTS)  # the first bit after those of the general faults
CONSTANTS = ("motor.torque_constant", "motor.back_emf_constant")


def wave(t: float) -> float:
    return 0.15 * sin(19.0 * t)


def gust(t: float) -> float:
    return 40.0 * sin(11.0 * t)


def during(fault: str, begin: float = 0.0, end: float = 1e9, **amounts: float) -> dict[str, float]:
    """Return the values that schedule a fault between two times [s]."""
    return {f"fault.{fault}.begin": begin, f"fault.{fault}.end": end,
            **{f"fault.{fault}.{name}": value for name, value in amounts.items()}}


def run(values: Mapping[str, Any], model: str = FAULTY, stop: float = 0.3, **inputs: Any) -> Mapping[str, Any]:
    """Simulate commands of the wave under loads of the gust, or other inputs."""
    all_values = load_parameters(model=model).with_values(values).values
    return simulate(all_values, stop, model=model, **{"fin_command": wave, "aero_torque": gust, **inputs})


def same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether all outputs of the second run are the same in the first, to the bit."""
    return all(np.array_equal(one[name], column) for name, column in other.items())


def weakened(share: float) -> dict[str, float]:
    return {name: share * PLAIN.values[name] for name in CONSTANTS}


# -- declared faults -------------------------------------------------------------------


def test_a_declared_fault_has_parameters_and_a_bit_of_the_fault_word() -> None:
    assert {name for name in BASE.values if name.startswith("fault.demagnetised.")} == {
        f"fault.demagnetised.{name}" for name in ("active", "begin", "end", "share")}
    (word,) = (v for v in get(FAULTY).outputs if v.name == "fault_word")
    assert word.bits == (*(fault.name for fault in FAULTS), "demagnetised")
    assert f"{DEMAGNETISED:g} demagnetised" in word.description
    assert "demagnetised" not in next(v for v in get("nonlinear+faults").outputs if v.name == "fault_word").bits


def test_without_a_fault_the_response_is_that_of_the_sound_actuator() -> None:
    found = run({})
    assert same(found, run({}, MODEL))
    assert not found["fault_word"].any()


def test_a_fault_from_the_start_equals_changed_parameters_to_the_bit() -> None:
    found = run(during("demagnetised", share=0.5))
    assert same(found, run(weakened(0.5), MODEL))
    assert (found["fault_word"][1:] == DEMAGNETISED).all()


def test_against_the_independent_integration() -> None:
    """The motor has half the flux; with ticks of 0.1 ms the limit is 2e-4 deg, as without a fault."""
    time = np.arange(0.0, 0.3, 1e-3)
    inputs = {"time": time, "fin_command": np.array([wave(t) for t in time]),
              "aero_torque": np.array([gust(t) for t in time])}
    expected = simulator(MODEL)({**PLAIN.values, **weakened(0.5)}, inputs)["fin_angle"]
    found = run(during("demagnetised", share=0.5))["fin_angle"][:len(time)]
    assert degrees(np.abs(found - expected).max()) < 2e-4
    assert degrees(np.abs(found - run({}, MODEL)["fin_angle"][:len(time)]).max()) > 0.1


def test_a_lasting_fault_begins_with_a_sample_and_never_ends() -> None:
    """Before its begin the run equals that without a fault; after its end, that of a fault without an end."""
    found, plain = run(during("demagnetised", 0.1, 0.15)), run({}, MODEL)
    before = found["time"] <= 0.1 + 1e-9
    assert all(np.array_equal(found[name][before], plain[name][before]) for name in ("fin_angle", "motor_current"))
    assert same(found, run(during("demagnetised", 0.1)))
    assert found["fault_word"][-1] == DEMAGNETISED


def test_a_fault_that_does_not_last_ends(tmp_path: Path) -> None:
    model = f"{changed(tmp_path, (', lasting=True', ''))}+faults"
    found = run(during("demagnetised", 0.05, 0.1), model, stop=1.5, fin_command=0.1, aero_torque=-20.0)
    assert found["fault_word"][75] == DEMAGNETISED
    assert not found["fault_word"][102:].any()
    sound = run({}, MODEL, stop=1.5, fin_command=0.1, aero_torque=-20.0)
    assert np.abs(found["fin_angle"] - sound["fin_angle"])[60:100].max() > 1e-4
    # After 1.4 s the closed loop has removed the effect.
    assert found["fin_angle"][-1] == pytest.approx(sound["fin_angle"][-1], abs=1e-6)


def test_a_fault_switched_during_a_run_acts_with_the_next_sample() -> None:
    """A changed amount of the fault acts at once."""
    word, current = ([v.name for v in get(FAULTY).outputs].index(name) for name in ("fault_word", "motor_current"))
    inputs = codegen.inputs_at_rest(0.1, -30.0, 39.0)
    on = BASE.with_values({"fault.demagnetised.active": True})
    core, sound = (codegen.core(BASE.values, FAULTY) for _ in range(2))
    core.run(0.0204, inputs)
    core.bind(codegen.bound_functions(on.values, FAULTY))
    assert core.run(0.0208, inputs) == sound.run(0.0208, inputs)
    assert core.run(0.0212, inputs)[word] == DEMAGNETISED
    assert core.run(0.0304, inputs)[current] != sound.run(0.0304, inputs)[current]
    other = codegen.core(on.values, FAULTY)
    other.state = core.state
    other.bind(codegen.bound_functions(on.with_values({"fault.demagnetised.share": 0.3}).values, FAULTY))
    assert core.run(0.0308, inputs)[current] != other.run(0.0308, inputs)[current]


SECOND = '''
def hot(ops, p, amounts):
    return {"motor.resistance": amounts.factor * p.motor.resistance}


def corroded(ops, p, amounts):
    return {"motor.resistance": p.motor.resistance + 0.25 / amounts.area, "hinge.damping": 3.0 * p.hinge.damping}


ACTUATOR = em.Actuator('''
TWO = '''faults=(
        em.PlantFault("hot", "winding hot", hot, (em.tunable("factor", "1", 1.0, 10.0, "of its resistance"),)),
        em.PlantFault("corroded", "contacts", corroded, (em.tunable("area", "1", 0.0, 1.0, "of the contacts"),)),
        em.PlantFault("jam", "hinge that drags", lambda ops, p, amounts: {"hinge.damping": 50.0 * p.hinge.damping}),
        em.PlantFault.scaling('''


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The direct drive with two faults of the same parameters, and one that replaces a general fault."""
    path = changed(tmp_path_factory.mktemp("several"), ("\nACTUATOR = em.Actuator(", SECOND),
                   ("faults=(em.PlantFault.scaling(", TWO))
    path.with_suffix(".toml").write_text("[fault]\nhot.factor = 2\ncorroded.area = 0.0\n", encoding="utf-8")
    return f"{path}+faults"


def test_a_later_fault_reads_parameters_that_an_earlier_one_changes(several: str) -> None:
    resistance, damping = PLAIN.values["motor.resistance"], PLAIN.values["hinge.damping"]
    both = run({**during("hot"), **during("corroded", area=0.5)}, several)
    assert same(both, run({"motor.resistance": 2.0 * resistance + 0.5, "hinge.damping": 3.0 * damping}, MODEL))
    alone = run(during("corroded", area=0.5), several)
    assert same(alone, run({"motor.resistance": resistance + 0.5, "hinge.damping": 3.0 * damping}, MODEL))


def test_an_inactive_fault_is_not_evaluated(several: str) -> None:
    """Otherwise the shipped amount of 0 would cause a division by zero."""
    assert same(run({}, several), run({}, MODEL))


def test_a_declared_fault_replaces_the_general_one_of_its_name(several: str) -> None:
    """It has the bit of the general fault, but not its effects."""
    assert [fault.name for fault in possible(get(several))].count("jam") == 1
    assert bits(get(several)) == (*(f.name for f in FAULTS), "hot", "corroded", "demagnetised")
    found = run(during("jam"), several)
    assert same(found, run({"hinge.damping": 50.0 * PLAIN.values["hinge.damping"]}, MODEL))
    assert (found["fault_word"][1:] == 1.0).all()


@pytest.mark.parametrize("name", [fault.name for fault in FAULTS])
def test_every_general_fault_may_be_replaced_by_one_without_amounts(name: str, tmp_path: Path) -> None:
    path = changed(tmp_path, ("\nACTUATOR = em.Actuator(", SECOND), ("faults=(em.PlantFault.scaling(", TWO.replace(
        '"jam"', f'"{name}"')))
    path.with_suffix(".toml").write_text("[fault]\nhot.factor = 2\ncorroded.area = 0.0\n", encoding="utf-8")
    found = run(during(name), f"{path}+faults")
    assert same(found, run({"hinge.damping": 50.0 * PLAIN.values["hinge.damping"]}, MODEL))


def test_kernels_agree_from_restored_states_during_every_fault(several: str) -> None:
    changes: dict[str, float] = {"fault.corroded.area": 0.5}
    for i, fault in enumerate(possible(get(several))):
        changes |= during(fault.name, 0.01 + 0.01 * i, 0.025 + 0.01 * i)
    values = load_parameters(model=several).with_values(changes).values
    python, compiled = codegen.core(values, several), CompiledCore(values, several)
    for k in range(1, 181):
        inputs = codegen.inputs_at_rest(wave(k * 1e-3), gust(k * 1e-3), 39.0)
        assert python.run(k * 1e-3 + 3e-4, inputs) == compiled.run(k * 1e-3 + 3e-4, inputs)
        if k % 30 == 0:
            state = python.state
            python = codegen.core(values, several)
            python.state = state


# -- wrong declarations ----------------------------------------------------------------


def nothing(ops: Any, p: Any, amounts: Any) -> Mapping[str, Any]:
    return {}


def declared(*faults: PlantFault) -> Actuator:
    return replace(get(MODEL), faults=faults)


@pytest.mark.parametrize(("make", "message"), [
    (lambda: PlantFault("oil leak", "", nothing), "'oil leak' is not a Python identifier"),
    (lambda: PlantFault("leak", "", nothing, (tunable("end", "1", 0.0, 1.0, ""),)), "every fault has a parameter end"),
    (lambda: declared(*(PlantFault("leak", "", nothing),) * 2), "fault leak is declared twice"),
    (lambda: extension.EXTENSION.over(declared(*(PlantFault(f"f{i}", "", nothing) for i in range(16)))),
     "16 faults are declared; fault_word has room for 15"),
])
def test_wrong_declarations_are_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(EmcasError, match=re.escape(message)):
        make()


@pytest.mark.parametrize(("changes", "message"), [
    ('"motor.torque_konstant": 1.0', "there is no torque_konstant; did you mean torque_constant?"),
    ('"motor": 1.0', "a group of parameters; there is motor.inertia, "),
    ('"motor.resistance": None', "returns motor.resistance = None; return a number or, for an array, a tuple"),
    ('"motor.resistance": (1.0, 2.0)', "return a number or, for an array, a tuple"),
    ('"motor.resistance": amounts.shar', "there is no shar; did you mean share?"),
])
def test_wrong_changes_of_parameters_are_refused(tmp_path: Path, changes: str, message: str) -> None:
    path = changed(
        tmp_path, ("ACTUATOR =", f"def broken(ops, p, amounts):\n    return {{{changes}}}\n\n\nACTUATOR ="),
        ("em.PlantFault.scaling(", "em.PlantFault("), ("their flux\",\n", "their flux\", broken, (\n"),
        ('"of the flux that is left"),\n', '"of the flux that is left"),), lasting=True),),\n'),
        (' ' * 34 + '"motor.torque_constant", "motor.back_emf_constant", lasting=True),),\n', ""))
    with pytest.raises(EmcasError, match=re.escape(message)) as refused:
        codegen.traced(model=f"{path}+faults")
    assert str(path) in str(refused.value)


def test_an_amount_without_a_value_is_refused(tmp_path: Path) -> None:
    """Switch and schedule have default values."""
    path = changed(tmp_path, ('    "fault.demagnetised.share": 0.6,\n', ""))
    load_parameters(model=str(path))
    with pytest.raises(EmcasError, match=re.escape("fault.demagnetised.share: missing")):
        load_parameters(model=f"{path}+faults")


def test_values_of_faults_are_unused_without_the_extension(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text("[fault.demagnetised]\nactive = true\n", encoding="utf-8")
    assert load_parameters(path, model=FAULTY).values["fault.demagnetised.active"] is True
    assert load_parameters(path, model=MODEL).unused == ("fault.demagnetised.active",)


# -- general faults, without a screw ---------------------------------------------------


@pytest.mark.parametrize("fault", [f.name for f in possible(get(MODEL))])
def test_each_fault_changes_the_fin_angle_and_the_fault_word(fault: str) -> None:
    found = run({**during(fault, 0.02, 0.25), "fault.brown_out.share": 0.1})  # the shipped half would not limit
    assert degrees(np.abs(found["fin_angle"] - run({}, MODEL)["fin_angle"]).max()) > 0.01
    assert set(found["fault_word"]) == {0.0, 2.0 ** NAMES.index(fault)}


def test_jam_holds_the_fin_while_the_current_rises() -> None:
    """Without back-EMF i = v/R (1 - exp(-t R/L)). Ticks of 0.1 ms, a tenth of L/R, err by (h R/L)^2/12 < 1e-3."""
    resistance, inductance = PLAIN.values["motor.resistance"], PLAIN.values["motor.inductance"]
    spin: Any = {"angular_rate__x": 30.0, "angular_rate__z": 20.0, "angular_acceleration__y": 50.0}
    found = run({**during("jam"), "controller.ki": 0.0, "loads.gravity": True}, stop=0.02,
                fin_command=0.1, aero_torque=-60.0, **spin)
    assert not found["fin_angle"].any()
    assert not found["fin_rate"].any()
    voltage = PLAIN.values["controller.kp"] * PLAIN.values["controller.setpoint_weight"] * 0.1
    expected = [voltage / resistance * (1.0 - exp(-t * resistance / inductance)) for t in found["time"]]
    assert found["motor_current"] == pytest.approx(expected, abs=1e-3 * voltage / resistance)
    # The jam does not change the hinge torque.
    plain = run({"loads.gravity": True}, MODEL, stop=0.02, fin_command=0.0, aero_torque=-60.0, **spin)
    assert found["hinge_torque"][0] == plain["hinge_torque"][0]


def test_fin_follows_the_command_after_a_jam() -> None:
    found = run(during("jam", 0.05, 0.15), stop=1.0, fin_command=0.2, aero_torque=-30.0)
    assert (found["fin_angle"][51:151] == found["fin_angle"][51]).all()
    assert found["fin_angle"][51] != 0.0
    assert found["fin_angle"][-1] == pytest.approx(0.2, abs=radians(0.1))


def test_loss_of_the_drive_acts_on_the_plant_like_disabling_it() -> None:
    found = run(during("drive_loss", 0.1))
    plain = run({}, MODEL, enable=lambda t: t < 0.0999)
    assert all(np.array_equal(found[name], plain[name]) for name in ("fin_angle", "motor_current", "motor_voltage"))


def test_brown_out_equals_a_lower_supply_voltage() -> None:
    lower = run({}, MODEL, supply_voltage=0.25 * 39.0)
    power = lower["supply_power"][1:]  # the first row is before the fault
    power[power > 0.0] /= 0.25  # consumed at the supply's full voltage; returned power does not change
    assert same(run(during("brown_out", share=0.25)), lower)


def test_encoder_faults_act_on_the_measured_fin_angle() -> None:
    """They are a bias, reversed or no counting, and lost counts of one direction."""
    biased = run(during("encoder_bias", angle=0.02), stop=2.0, fin_command=0.1, aero_torque=0.0)
    assert biased["fin_angle"][-1] == pytest.approx(0.08, abs=1e-4)  # integral action still settles
    # Without a controller only the gust moves the fin. The measurement of a row is that of the last sample.
    free = {"controller.kp": 0.0, "controller.ki": 0.0}
    for fault, gain, missed in (("encoder_reversed", -1.0, 0.0), ("encoder_freeze", 0.0, 0.0),
                                ("encoder_dropped", 1.0, 0.3)):
        amounts = {"share": missed} if missed else {}
        found = run({**free, **during(fault, **amounts)})
        moved = np.diff(found["fin_angle"])
        counted = np.cumsum(gain * (moved - missed * np.maximum(moved, 0.0)))
        assert found["measured_fin_angle"][2:] == pytest.approx(counted[:-1], abs=1e-12)  # rounding of 300 sums
        assert np.abs(found["fin_angle"]).max() > 0.01


def test_command_freeze_and_command_delay() -> None:
    frozen = run(during("command_freeze", 0.1))
    assert np.array_equal(frozen["fin_angle"], run({}, MODEL, fin_command=lambda t: wave(min(t, 0.099)))["fin_angle"])
    late = run(during("command_delay", time=7.4e-3))
    shifted = run({}, MODEL, fin_command=lambda t: wave(t - 7e-3) if t > 6.5e-3 else 0.0)
    # k T - n T and (k - n) T differ by rounding.
    assert late["fin_angle"] == pytest.approx(shifted["fin_angle"], abs=1e-9)

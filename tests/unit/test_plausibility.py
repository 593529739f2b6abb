"""Contradictory parameters give one warning each; the shipped sets give none."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.actuators import EXTENSIONS, NAMES, get
from emcas_fmu.actuators.electromechanical import plausibility
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions import fault_list
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.support.files import named_sets
from emcas_fmu.trace.python_source import python_source
from tests.own_actuator.example import MODEL as DIRECT_DRIVE
from tests.unit.test_sets import MODELS

RULES = (*plausibility.RULES, *plausibility.SUPPLY_RULES)


@pytest.mark.parametrize("model", [*NAMES, DIRECT_DRIVE], ids=lambda model: Path(model).stem)
def test_no_shipped_set_warns(model: str) -> None:
    assert load_parameters(model=model).warnings == ()
    for extension in EXTENSIONS:
        try:
            extended = load_parameters(model=f"{model}+{extension}")
        except EmcasError:
            continue
        assert extended.warnings == ()


@pytest.mark.parametrize("name", sorted(named_sets()))
def test_no_named_set_warns(name: str) -> None:
    warnings = load_parameters(name, model=MODELS.get(name, "nonlinear")).warnings
    assert not [warning for warning in warnings if not warning.endswith("not used")]


# Changes of the default set just within and beyond each rule's limit, and the only warning; limits computed by hand.
@pytest.mark.parametrize(("changes", "message"), [
    ({"inertia.motor": 1.6e-2}, "check the units of inertia"),  # 1e3 times the load's 1.551e-5 kg.m2
    ({"inertia.motor": 1.5e-2}, ""),
    ({"inertia.fin": 113.0}, "check the units of inertia"),  # (l/d)^2 113 kg.m2 is 100.3 times 2.855e-4 kg.m2
    ({"inertia.fin": 112.0}, ""),
    ({"drive.current_limit": 3.7}, "is over half"),  # 0.205 N.m of 0.407 N.m
    ({"drive.current_limit": 3.8}, ""),
    ({"friction.fin_coulomb": 200.0}, "is over half"),  # 200 N.m l/d = 3.18 N.m, and 0.205 N.m, of 6.6 N.m
    ({"friction.fin_coulomb": 190.0}, ""),
    ({"drive.current_limit": 82.0}, "is never reached"),  # of 81.9 A
    ({"encoder.pulses": 7}, "deg of the fin"),  # 360 deg/28 l/d = 0.2046 deg of 0.2 deg
    ({"encoder.pulses": 8}, ""), ({"encoder.pulses": 450, "encoder.on_fin": True}, ""),
    ({"encoder.pulses": 440, "encoder.on_fin": True}, "deg of the fin"),  # 0.2045 deg
    ({"controller.velocity.kp": 0.074}, ""),
    ({"controller.velocity.kp": 0.0753}, "cost 60.7 deg of phase"),  # 60 deg at 0.07444 of 131.4 rad/s at 0.0439
    ({"drive.transport_delay": 7.1e-3}, "will ring"), ({"motor.inductance": 0.045}, ""),
    ({"motor.inductance": 0.047}, "motor.inductance = 0.047 H"),  # 30 times 0.25 Ohm times 6.219 ms is 46.6 mH
    # A longer sample, 6.4 ms, raises the limit to 48 mH. The lower gain keeps the velocity loop's phase margin.
    ({"motor.inductance": 0.047, "controller.sample_time": 6.4e-3, "controller.velocity.kp": 0.03}, ""),
    ({"motor.resistance": 0.0201}, ""),
    ({"motor.resistance": 0.0199}, "1 mH is 1e-3 H"),  # 0.6 mH over 0.02 Ohm is 30 samples
    ({"fin.stop_angle": radians(20.0)}, "by less than 0.01 of that limit"),
    ({"fin.stop_angle": radians(20.19)}, "the stop hides an overshoot"), ({"fin.stop_angle": radians(20.21)}, ""),
    ({"controller.speed_limit": 354.0}, ""),
    ({"controller.speed_limit": 355.0}, "never reaches"),  # 39 V over 0.11 V.s/rad is 354.5 rad/s
    ({"motor.resistance": 0.64}, ""),
    ({"motor.resistance": 0.66}, "needs 39.6 V across motor.resistance"),  # 0.65 Ohm times 60 A is 39 V
])
def test_contradiction_gives_one_warning(changes: dict[str, float], message: str) -> None:
    warnings = load_parameters().with_values(changes).warnings
    if "encoder.pulses" in changes:  # a coarse encoder also gives the warning of the next test
        warnings = tuple(w for w in warnings if "will be noise" not in w)
    assert [message in warning for warning in warnings] == ([True] if message else [])


def test_coarse_encoder_gives_a_warning_about_current_noise() -> None:
    # 2 pi/(4 n) in a millisecond times 0.0439 V.s/rad and 8.19 A/V is 565 A/n: a tenth of 60 A at n = 94.1.
    for pulses, warned in ((94, True), (95, False)):
        warnings = load_parameters().with_values({"encoder.pulses": pulses}).warnings
        assert [("will be noise" in warning) for warning in warnings] == [True] * warned


def test_light_rotor_with_the_shipped_gains_gives_a_warning() -> None:
    warnings = load_parameters().with_values({"inertia.motor": "300 g*cm^2"}).warnings
    assert [("tune the gains" in warning) for warning in warnings] == [True]


@pytest.mark.parametrize(("model", "changes", "message"), [
    ("worm-gear", {"inertia.motor": 5e-5}, "the velocity loop"),
    ("worm-gear", {"encoder.pulses": 7}, "deg of the fin"),  # 360 deg/28/60 = 0.214 deg
    ("worm-gear", {"controller.speed_limit": 355.0}, "never reaches"),
    ("electrohydrostatic", {"inertia.motor": 1e-4}, "the velocity loop"),
    ("electrohydrostatic", {"motor.resistance": 0.66}, "at standstill"),
    ("linear", {"inertia.motor": 1e-4}, "the velocity loop"),
    ("ristanovic", {"inertia.motor": 1e-7, "inertia.screw": 0.0}, "check the units of inertia"),
    ("series-clutch", {"drive.current_limit": 82.0}, "is never reached"),
    ("elastic", {"drive.current_limit": 82.0}, "is never reached"),
    *((model, {"motor.inductance": "0.11 H"}, "check the units (1 mH is 1e-3 H)")
      for model in NAMES if "motor.inductance" in load_parameters(model=model).values),
    *((model, {"fin.stop_angle": "20 deg"}, "the stop hides an overshoot") for model in (*NAMES, DIRECT_DRIVE)),
])
def test_other_actuators_warn_of_contradictions(model: str, changes: dict[str, Any], message: str) -> None:
    warnings = load_parameters(model=model).with_values(changes).warnings
    assert any(message in warning for warning in warnings)


@pytest.mark.parametrize("changes", [{}, {"inertia.motor": 1.6e-2, "encoder.pulses": 7}, {
    "drive.current_limit": 3.0, "controller.velocity.kp": 0.1, "encoder.on_fin": True, "friction.temperature": -20.0}])
def test_generated_rules_agree_to_the_bit(changes: dict[str, float]) -> None:
    """The source of the Python FMU; the C code is printed from the same trace."""
    chosen, rules = load_parameters().with_values(changes), get("nonlinear").all_rules
    space: dict[str, Any] = {}
    exec(python_source(codegen.traced_rules("nonlinear"), "Rules"), space)
    checks = space["make"](dict(chosen.values))
    for rule, check in zip(rules, checks, strict=True):
        assert check(0.0) == rule.check(FLOATS, chosen.nested(), 0.0), rule.message


def test_actuator_has_all_rules_except_those_of_the_supply() -> None:
    assert set(plausibility.RULES) <= set(get("nonlinear").all_rules)
    assert not set(plausibility.SUPPLY_RULES) & set(get("nonlinear").all_rules)
    assert all(rule.warning for rule in RULES)


def test_command_delay_is_limited() -> None:
    parameters = load_parameters(model="nonlinear+faults")
    longest = fault_list.LONGEST_COMMAND_DELAY * parameters.values["controller.sample_time"]
    parameters.with_values({"fault.command_delay.active": True, "fault.command_delay.time": longest})
    with pytest.raises(ParameterError, match=r"fault\.command_delay\.time"):
        parameters.with_values({"fault.command_delay.active": True, "fault.command_delay.time": longest * (1 + 1e-6)})

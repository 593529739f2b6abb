"""Several extensions together: neutral ones change nothing, each finds its own states; refused models and values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import permutations
from math import radians, sin
from typing import Any

import pytest

from emcas_fmu.actuators import EXTENSIONS, NAMES, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.fault_list import possible
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.runtime.codegen import inputs_at_rest
from emcas_fmu.simulation import simulate
from tests.marks import others_slow, slow
from tests.runs import assert_equal, run_both_kernels
from tests.simulation import CompiledCore

from .runs import values_of

# Values with which an extension has no effect; LuGre's bristles and a DC link have no such values.
NEUTRAL: Mapping[str, Mapping[str, Any]] = {
    "stribeck": {"stribeck.static_ratio": 1.0},
    "uneven": {},
    "efficiency": {"efficiency.forward": 1.0, "efficiency.backward": 1.0},
    "saturation": {"saturation.share": 0.0},
    "inverter": {},
    "heat": {"heat.resistance_coefficient": 0.0, "heat.torque_coefficient": 0.0, "heat.peak_time": 1e3},
    "filters": {"filters.speed_bandwidth": 0.0},
    "homing": {"homing.required": False},
    "sensors": {},
    "trajectory": {"trajectory.natural_frequency": 0.0},
    "faults": {},
}


def possible_extensions(model: str, extensions: Iterable[str]) -> tuple[str, ...]:
    """Return the extensions that a model can have."""
    result = []
    for extension in extensions:
        with suppress(EmcasError):
            get(f"{model}+{extension}")
            result.append(extension)
    return tuple(result)


def run(model: str, overrides: Mapping[str, Any], both: bool = False) -> Mapping[str, Any]:
    """Return a run in Python, after a check that `both` kernels agree if requested."""
    parameters, inputs = load_parameters(model=model), dict[str, Any](
        fin_command=lambda t: 0.2 * sin(25.0 * t), aero_torque=lambda t: 60.0 * sin(40.0 * t),
        enable=lambda t: not 0.1 < t < 0.12)
    if supply := get(model).supply:
        full = float(supply.input.initial(parameters.values))
        inputs[supply.input.name] = lambda t: full * (1.0 if t < 0.2 else 24.0 / 39.0)
    values = parameters.with_values(overrides).values
    if both:
        return run_both_kernels(values, 0.3, model, **inputs)
    return simulate(values, 0.3, model=model, kernel="python", **inputs)


# A compiler takes a quarter of a minute for this kernel.
(LARGEST,) = slow("elastic+stribeck+efficiency+heat+homing+supply+faults")


# Tracing the default actuator and an elastic line with every extension takes seconds.
@pytest.mark.parametrize("model", others_slow(
    NAMES, lambda name: name in ("ristanovic", "servo", "electrohydraulic", "second-order")))
def test_neutral_extensions_change_no_bit(model: str) -> None:
    extensions = possible_extensions(model, NEUTRAL)
    assert "faults" in extensions
    name = "+".join((model, *extensions))
    neutral = {key: value for extension in extensions for key, value in NEUTRAL[extension].items()}
    assert_equal(run(name, load_parameters(model=name).having(neutral)), run(model, {}))


@pytest.mark.parametrize("alone", [extension for extension in NEUTRAL if extension != "faults"])
@pytest.mark.parametrize("model", ["nonlinear", *slow("elastic")])
def test_an_extension_beside_neutral_ones_computes_the_same_bits(model: str, alone: str) -> None:
    """Faults make a program twice as long, and are only beside the extensions of the elastic line."""
    extensions = possible_extensions(model, [each for each in NEUTRAL if (model, each) != ("nonlinear", "faults")])
    neutral = {key: value for each in extensions if each != alone for key, value in NEUTRAL[each].items()}
    own = {"homing.required": False} if alone == "homing" else {}
    assert_equal(run("+".join((model, *extensions)), {**neutral, **own}), run(f"{model}+{alone}", own))


@pytest.mark.parametrize("model", [
    "nonlinear+lugre+heat+homing+supply+faults", LARGEST,
    *slow("ristanovic+stribeck+efficiency+heat+homing+supply+faults")])
def test_kernels_agree_with_several_extensions(model: str) -> None:
    run(model, {"homing.required": False, "fault.friction_rise.begin": 0.05, "fault.friction_rise.end": 0.15,
                "fault.encoder_bias.begin": 0.2, "fault.encoder_bias.end": 1.0, "heat.winding_start_rise": 60.0},
        both=True)


@pytest.mark.parametrize("model", ["nonlinear+lugre+heat+homing+supply+faults", LARGEST, "second-order+faults"])
def test_results_do_not_depend_on_the_steps_of_the_host(model: str) -> None:
    """With constant inputs and every fault in turn, steps of 10, 1 and 0.37 ms give the same bits at common times."""
    windows = {f"fault.{fault.name}.{edge}": 0.05 + 0.03 * i + late for i, fault in enumerate(possible(get(model)))
               for edge, late in (("begin", 0.0), ("end", 0.02))}
    parameters = load_parameters(model=model)
    values = parameters.with_values(parameters.having({**windows, "homing.required": False})).values
    inputs = inputs_at_rest(0.1, -30.0, 39.0, True, *(False,) * len(get(model).further_inputs))
    results = []
    for size in (10e-3, 1e-3, 0.37e-3):
        core, time, rows = CompiledCore(values, model), 0.0, []
        for mark in (0.05 * k for k in range(1, 12)):
            while time + size < mark - 1e-9:
                time += size
                core.run(time, inputs)
            time = mark
            rows.append(core.run(mark, inputs))
        results.append(rows)
    assert results[0] == results[1] == results[2]


def test_extensions_may_be_named_in_any_order() -> None:
    names = {get("+".join(("elastic", *order))).name for order in permutations(("heat", "faults", "stribeck"))}
    assert names == {"elastic+stribeck+heat+faults"}


VOLTAGE_LIMIT, COULOMB, REFERENCE_LIMIT = (
    "supply needs a current loop whose voltage the supply limits", "stribeck needs friction.coulomb at the motor; ",
    "homing needs a drive whose analogue reference has a limit; ")
SCREW = (r"model {0}\+efficiency: efficiency needs a screw without losses; {0} has none; "
         "choose nonlinear, ristanovic or elastic")


@pytest.mark.parametrize(("name", "message"), [
    ("nonlinear+heet", "did you mean heat"), ("nonlinear+heat+heat", "appears twice"),
    ("elastc", "did you mean elastic"), ("nonlinear+", "no extension ''"),
    ("heat+faults", r"heat is an extension; name an actuator before it, as in nonlinear\+heat\+faults"),
    ("nonlinear+lugre+efficiency", "efficiency"),
    ("second-order+heat", r"second-order\+heat: heat needs a motor current"),
    ("nonlinear+stribeck+lugre", "lugre needs friction.coulomb at the motor, which stribeck replaces"),
    ("linear+stribeck", f"{COULOMB}linear has none; choose nonlinear, "),
    ("second-order+stribeck", f"{COULOMB}second-order has none"),
    *((f"{model}+lugre", f"lugre needs {need}; {model} has none; choose nonlinear$") for model, need in (
        ("linear", "friction.coulomb at the motor"), ("second-order", "a rigid drive line"),
        ("elastic", "a rigid drive line"), ("ristanovic", "a current loop"), ("habibi", "a rigid drive line"),
        ("ozkan", "a rigid drive line"))),
    *((f"{model}+efficiency", SCREW.format(model)) for model in ("linear", "second-order", "habibi", "ozkan")),
    *((f"{model}+homing", f"{REFERENCE_LIMIT}{model} has none") for model in ("second-order", "linear")),
    *((f"{model}+supply", VOLTAGE_LIMIT) for model in ("linear", "ozkan", "second-order")),
    *((f"{model}+inverter", "inverter needs ") for model in (
        "linear", "ozkan", "ristanovic", "series-clutch", "electrohydrostatic")),
])
def test_an_impossible_model_is_refused(name: str, message: str) -> None:
    with pytest.raises(EmcasError, match=message):
        get(name)


@pytest.mark.parametrize(("name", "value"), [
    ("heat.winding_capacity", 0.0), ("heat.case_to_ambient", -0.1), ("heat.torque_coefficient", 0.001),
    ("heat.resistance_coefficient", -0.004), ("heat.peak_time", 0.0), ("heat.continuous_current", float("nan")),
    ("heat.winding_start_rise", "80 degC"), ("heat.winding_to_case", "0.2 W/K"), ("heat.winding_limit", 1000.0),
    ("lugre.stiffness", 0.0), ("lugre.stiffness", -20.0), ("lugre.stiffness", "20 N/m"), ("lugre.damping", -1e-3),
    ("lugre.damping", 1.01), ("lugre.damping", float("inf")), ("lugre.static_ratio", 0.9),
    ("lugre.stribeck_speed", 0.0), ("stribeck.static_ratio", 0.09), ("stribeck.static_ratio", 11.0),
    ("stribeck.static_ratio", float("nan")), ("stribeck.speed", 0.0), ("stribeck.speed", 0.09),
    ("stribeck.speed", -1.0), ("stribeck.speed", "1 m/s"), ("supply.capacitance", 0.0),
    ("supply.source_resistance", -0.1), ("supply.chopper_resistance", 0.0), ("supply.device_voltage", -0.1),
    ("supply.quiescent_power", float("nan")), ("supply.capacitance", "2 mH")])
def test_a_bad_value_is_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        load_parameters(model=f"nonlinear+{name.partition('.')[0]}").with_values({name: value})


def test_homing_recovers_missed_counts() -> None:
    """After it the fin is at its command, to a count or two."""
    model = "nonlinear+homing+faults"
    values = values_of({"homing.required": False, "fault.encoder_dropped.share": 0.3,
                        "fault.encoder_dropped.end": 0.5}, model=model)
    result = simulate(values, 9.0, model=model, home=lambda t: t > 1.0,
                      fin_command=lambda t: radians(10.0) if t < 1.0 else 0.0)
    assert abs(result["fin_angle"][990]) > radians(11.0)
    assert abs(result["fin_angle"][-1]) < radians(0.05)


def test_neutral_values_are_listed_for_every_extension_that_has_them() -> None:
    assert set(EXTENSIONS) == {*NEUTRAL, "lugre", "supply"}


@pytest.mark.parametrize(("extension", "need"), [
    ("heat", "a motor current that follows from winding parameters"), ("supply", "a current loop whose voltage"),
    ("sensors", "an incremental encoder"), ("homing", "a drive whose analogue reference"),
    ("stribeck", "friction.coulomb at the motor")])
def test_an_error_denies_no_part_of_the_servo(extension: str, need: str) -> None:
    """A servo has a motor current, a limited voltage, an absolute encoder, a limit of its PWM and dry friction."""
    with pytest.raises(EmcasError, match=f"{extension} needs {need}"):
        get(f"servo+{extension}")

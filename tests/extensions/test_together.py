"""Options over each other: neutral ones leave the rest as it is, and each finds its own states behind the others'."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from math import radians, sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import EXTENSIONS, NAMES, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.fault_list import possible
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.codegen import inputs_at_rest
from emcas_fmu.simulation import simulate
from tests.marks import others_slow, slow
from tests.simulation import CompiledCore

# Values with which an option does nothing; LuGre's bristles and a DC link have none.
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


def fitting(model: str, options: tuple[str, ...]) -> tuple[str, ...]:
    """Those that may be laid over a model."""
    found = []
    for option in options:
        try:
            get(f"{model}+{option}")
        except EmcasError:
            continue
        found.append(option)
    return tuple(found)


def run(model: str, overrides: Mapping[str, Any], kernel: str = "python") -> Mapping[str, Any]:
    parameters = load_parameters(model=model)
    line = get(model).supply
    full = float(line.input.initial(parameters.values)) if line else 0.0
    supply: dict[str, Any] = {line.input.name: lambda t: full * (1.0 if t < 0.2 else 24.0 / 39.0)} if line else {}
    return simulate(parameters.with_values(overrides).values, 0.3, model=model, kernel=kernel,
                    fin_command=lambda t: 0.2 * sin(25.0 * t), aero_torque=lambda t: 60.0 * sin(40.0 * t),
                    enable=lambda t: not 0.1 < t < 0.12, **supply)


# Its kernel alone takes a compiler a quarter of a minute.
(LARGEST,) = slow("elastic+stribeck+efficiency+heat+homing+supply+faults")


# The default actuator and an elastic line with every option take seconds to trace.
@pytest.mark.parametrize("model", others_slow(
    NAMES, lambda name: name in ("ristanovic", "servo", "electrohydraulic", "second-order")))
def test_neutral_options_change_nothing(model: str) -> None:
    """All at once, to the bit, in everything the plain model puts out."""
    options = fitting(model, tuple(NEUTRAL))
    assert "faults" in options
    name = "+".join((model, *options))
    neutral = {key: value for option in options for key, value in NEUTRAL[option].items()}
    found, plain = run(name, load_parameters(model=name).having(neutral)), run(model, {})
    assert all(np.array_equal(found[name], plain[name]) for name in plain)


@pytest.mark.parametrize("alone", [o for o in NEUTRAL if o != "faults"])
@pytest.mark.parametrize("model", ["nonlinear", *slow("elastic")])
def test_an_option_among_neutral_ones_is_itself(model: str, alone: str) -> None:
    """With faults, with which a program is twice as long, on the elastic line only."""
    options = fitting(model, tuple(option for option in NEUTRAL if (model, option) != ("nonlinear", "faults")))
    overrides = {key: value for option in options if option != alone for key, value in NEUTRAL[option].items()}
    own = {"homing.required": False} if alone == "homing" else {}
    found, single = run("+".join((model, *options)), {**overrides, **own}), run(f"{model}+{alone}", own)
    assert all(np.array_equal(found[name], single[name]) for name in single)


@pytest.mark.parametrize("model", [
    "nonlinear+lugre+heat+homing+supply+faults", LARGEST,
    *slow("ristanovic+stribeck+efficiency+heat+homing+supply+faults")])
def test_both_kernels_with_all_of_them(model: str) -> None:
    changes = {"homing.required": False, "fault.friction_rise.begin": 0.05, "fault.friction_rise.end": 0.15,
               "fault.encoder_bias.begin": 0.2, "fault.encoder_bias.end": 1.0, "heat.winding_start_rise": 60.0}
    one, other = (run(model, changes, kernel) for kernel in ("compiled", "python"))
    assert all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("model", ["nonlinear+lugre+heat+homing+supply+faults", LARGEST, "second-order+faults"])
def test_steps_of_the_host_do_not_matter(model: str) -> None:
    """Inputs held, every fault in turn: at common times steps of 10, 1 and 0.37 ms give the same, to the bit."""
    windows = {f"fault.{fault.name}.{edge}": 0.05 + 0.03 * i + late for i, fault in enumerate(possible(get(model)))
               for edge, late in (("begin", 0.0), ("end", 0.02))}
    known = {"homing.required": False} if "homing" in model else {}
    parameters = load_parameters(model=model)
    values = parameters.with_values(parameters.having({**windows, **known})).values
    inputs = inputs_at_rest(0.1, -30.0, 39.0, True, *(False,) * len(get(model).further_inputs))
    found = []
    for size in (10e-3, 1e-3, 0.37e-3):
        core, time, rows = CompiledCore(values, model), 0.0, []
        for mark in (0.05 * k for k in range(1, 12)):
            while time + size < mark - 1e-9:
                time += size
                core.run(time, inputs)
            time = mark
            rows.append(core.run(mark, inputs))
        found.append(rows)
    assert found[0] == found[1] == found[2]


def test_order_does_not_matter() -> None:
    names = {get("+".join(("elastic", *order))).name for order in permutations(("heat", "faults", "stribeck"))}
    assert names == {"elastic+stribeck+heat+faults"}


@pytest.mark.parametrize(("name", "said"), [
    ("nonlinear+heet", "did you mean heat"), ("nonlinear+heat+heat", "appears twice"),
    ("elastc", "did you mean elastic"),
    ("nonlinear+stribeck+lugre", "lugre"), ("nonlinear+lugre+efficiency", "efficiency"),
    ("linear+stribeck", "stribeck needs Coulomb friction at the motor; linear has none; choose nonlinear, "),
    ("elastic+lugre", "lugre"),
    ("heat+faults", r"heat is an extension; name an actuator before it, as in nonlinear\+heat\+faults"),
    ("nonlinear+", "no extension ''"), ("second-order+heat", "heat"),
])
def test_what_there_is_not(name: str, said: str) -> None:
    with pytest.raises(EmcasError, match=said):
        get(name)


def test_homing_after_missed_counts() -> None:
    """Another run finds the counts that an encoder has missed: the fin is then at its command, to a count or two."""
    model = "nonlinear+homing+faults"
    values = load_parameters(model=model).with_values({
        "homing.required": False, "fault.encoder_dropped.share": 0.3, "fault.encoder_dropped.end": 0.5,
    }).values
    result = simulate(values, 9.0, model=model, home=lambda t: t > 1.0,
                      fin_command=lambda t: radians(10.0) if t < 1.0 else 0.0)
    assert abs(result["fin_angle"][990]) > radians(11.0)
    assert abs(result["fin_angle"][-1]) < radians(0.05)


def test_every_option_is_here() -> None:
    assert set(EXTENSIONS) == {*NEUTRAL, "lugre", "supply"}

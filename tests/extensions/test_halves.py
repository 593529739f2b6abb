"""An actuator's halves, controllers and plant: their signals, and their trajectory when coupled."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, radians
from typing import Any

import pytest

from emcas_fmu.actuators import EXTENSIONS, HALVES, NAMES, NONLINEAR, full_name, get, get_extension, of_fmu
from emcas_fmu.actuators.capabilities import POSITION_LOOP
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.halves import measured
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.trace.dependencies import Dependence, dependencies, of_parameters
from tests.marks import others_slow, slow

STEP = 1e-3
LOOPED = [name for name in NAMES if POSITION_LOOP in get(name).provides]
EXTENDED = [f"{name}+{extension}" for name in LOOPED for extension in EXTENSIONS
            if get(name).provides.issuperset(get_extension(extension).needs)]
# Worm gears have the controllers of the nonlinear actuator and need half of the total time: they are tested with the
# extensions that add a signal between controllers and plant.
IN_TURN = [model for model in EXTENDED
           if not model.startswith("worm-gear") or model.endswith(("+faults", "+heat", "+homing", "+supply"))]
TOGETHER = ["nonlinear+heat+supply+faults", "elastic+stribeck+heat+homing+faults",
            "nonlinear+stribeck+efficiency+supply"]
OWN = [f"examples/own_actuator/{name}.py" for name in ("direct_drive", "strain_wave", "hot_gas")]


class Part:
    """The core of an actuator or of one of its halves, with inputs by name."""

    def __init__(self, parameters: ParameterSet, model: str, changes: Mapping[str, float]) -> None:
        self.actuator, values = get(model), {**parameters.values, **changes}
        self.core = codegen.core(values, model)
        self.inputs = {v.name: float(v.initial(values)) for v in self.actuator.inputs}

    def set(self, signals: Mapping[str, float]) -> None:
        self.inputs |= {name: value for name, value in signals.items() if name in self.inputs}

    def outputs(self) -> dict[str, float]:
        values = self.core.outputs(codegen.core_inputs(self.core, list(self.inputs.values()), self.actuator))
        return dict(zip((v.name for v in self.actuator.outputs), map(float, values), strict=True))

    def run(self, end: float) -> None:
        self.core.run(end, codegen.core_inputs(self.core, list(self.inputs.values()), self.actuator))


def inputs_at(time: float) -> dict[str, float]:
    """Return inputs that reach limits, disable and enable the drive, and move the vehicle."""
    return {"fin_command": radians(10.0) * (time > 0.02), "aero_torque": -20.0 * (time > 0.1), "home": time > 0.01,
            "acceleration.z": 20.0 * time, "enable": not 0.15 < time < 0.17}


def difference(model: str, step: float = STEP, stop: float = 0.25, in_turn: bool = True, earlier: float = 0.0,
               values: Mapping[str, Any] | None = None) -> float:
    """Return the largest difference of the fin angle [deg] between coupled halves and the whole actuator.

    If they are not stepped `in_turn`, the plant receives the reference one step later. The plant's transport delay is
    `earlier` [s] shorter.
    """
    parameters = load_parameters(model=model).with_values(values or {})
    shorter = {"drive.transport_delay": parameters.values["drive.transport_delay"] - earlier} if earlier else {}
    whole, controllers, plant = (Part(parameters, name, changes) for name, changes in (
        (full_name(model), {}), (of_fmu(model, "controller", ""), {}), (of_fmu(model, "plant", ""), shorter)))
    error, motion = 0.0, 0.0
    for k in range(round(stop / step)):
        for part in (whole, controllers, plant):
            part.set(inputs_at(k * step))
        controllers.set(plant.outputs())
        before = controllers.outputs()
        controllers.run((k + 1) * step)
        plant.set(controllers.outputs() if in_turn else before)
        for part in (plant, whole):
            part.run((k + 1) * step)
        angle = whole.outputs()["fin_angle"]
        error, motion = max(error, abs(plant.outputs()["fin_angle"] - angle)), max(motion, abs(angle))
    assert motion > radians(1.0)
    return degrees(error)


@pytest.mark.parametrize("model", [*LOOPED, *slow(*EXTENDED, *TOGETHER)])
def test_samples_depend_only_on_the_measured_states(model: str) -> None:
    """They are those that the actuator declares; an extension may declare states that some actuators do not have."""
    actuator, tracer = get(model), codegen.traced(False, model)
    sample = next(function for function in tracer.functions if function.name == "sample")
    fixed = of_parameters(tracer, {key: Dependence(names=frozenset({key})) for _, key in tracer.parameters})
    arguments = [Dependence(names=frozenset({name})) for name in sample.arguments]
    known = dependencies(tracer, "sample", arguments, fixed)
    names = frozenset[str]().union(*(each.names for each in known))
    read = {s.name for s in actuator.states if s.name in names}
    assert read <= set(measured(actuator))
    assert model not in NAMES or read == set(measured(actuator))
    assert actuator.controllers_read is not None
    assert "supply" not in names or "supply" in actuator.controllers_read


@pytest.mark.parametrize("model", others_slow([*LOOPED, *IN_TURN, *TOGETHER, *OWN], lambda model: model in (
    NONLINEAR, "servo")))
def test_halves_stepped_in_turn_compute_the_bits_of_the_whole(model: str) -> None:
    assert difference(model, values={"homing.required": True} if "homing" in model else None) == 0.0


@pytest.mark.parametrize("model", [NONLINEAR, *slow("servo", "electrohydraulic", "worm-gear")])
def test_a_shorter_transport_delay_compensates_for_halves_stepped_at_once(model: str) -> None:
    """A master that exchanges signals between steps delays the reference by one step."""
    assert 0.02 < difference(model, in_turn=False) < 1.0  # 1 ms of motion at up to 300 deg/s is 0.3 deg
    assert difference(model, in_turn=False, earlier=STEP) == 0.0


def test_communication_steps() -> None:
    """Several steps in a sample time change nothing; in a step over two samples the second reads an old measurement."""
    assert difference(NONLINEAR, step=2.5e-4, stop=0.1) == 0.0
    assert difference(NONLINEAR, step=2e-3, stop=0.1) > 0.2


@pytest.mark.parametrize("model", LOOPED)
def test_signals_have_the_same_names_and_units_in_both_halves(model: str) -> None:
    parts = {part: get(of_fmu(model, part, "")) for part in HALVES}
    sides = {part: ({v.name: v for v in each.inputs if v.name not in each.hidden}, {v.name: v for v in each.outputs})
             for part, each in parts.items()}
    (into, out), (plant_into, plant_out) = sides["controller"], sides["plant"]
    signals = {*(into.keys() & plant_out), *(out.keys() & plant_into)}
    assert signals == set(parts["plant"].terminals[-1].members) == set(parts["controller"].terminals[-1].members)
    for source, sink in ((plant_out, into), (out, plant_into)):
        assert all(source[name].unit == sink[name].unit for name in source.keys() & sink)
    assert into.keys() - signals == {"fin_command", "enable"}
    assert {"measured_fin_angle", "saturated"} == out.keys() - signals
    assert "fin_command" not in plant_into
    assert {"aero_torque", "acceleration.x", "enable"} <= plant_into.keys()
    whole = {v.name for v in get(model).outputs}
    assert whole - plant_out.keys() == {"measured_fin_angle", "tracking_error", *(out.keys() & plant_into)}


def test_the_halves_have_no_algebraic_loop() -> None:
    """No measured state depends directly on an input, nor an output of the controllers."""
    for model in LOOPED:
        direct = codegen.direct_inputs(of_fmu(model, "plant", ""))
        assert not direct.keys() & set(measured(get(model)))
        assert codegen.direct_inputs(of_fmu(model, "controller", "")) == {}


@pytest.mark.parametrize(("model", "part", "message"), [
    ("second-order", "plant", "model second-order+plant: plant needs a sampled position loop; second-order has none"),
    ("nonlinear+plant", "controller", "plant needs a sampled position loop, which controller replaces"),
    (NONLINEAR, "controllers", "part controllers: there is controller and plant; did you mean controller?"),
])
def test_an_impossible_half_is_refused(model: str, part: str, message: str) -> None:
    with pytest.raises(EmcasError) as caught:
        get(of_fmu(model, part, ""))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)

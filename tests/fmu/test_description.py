"""Attributes of variables in the model description: type, quantity, display unit, nominal value, limits."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import replace
from math import copysign, inf, radians
from typing import Any

import pytest

from emcas_fmu.actuators import fin_port, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi import description, model_description
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import MIXING, FmuInterface, fin_sets, start_values
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.variables import Variable, real_output
from tests.actuators.test_declaration import WITH_EXTENSIONS
from tests.fmu.built import slave_class
from tests.kernels import models
from tests.marks import others_slow, slow

# Actuators whose runs are not marked slow.
QUICK = ("nonlinear", "ristanovic", "servo", "electrohydraulic", "second-order", "elastic")


def is_quick(model: str) -> bool:
    """Return whether a model's runs are not marked slow; these models together have every extension."""
    return model in QUICK or model.startswith(("nonlinear+lugre", "nonlinear+supply", "ristanovic+"))


# Every actuator with each extension that it can have, and with as many extensions as can be combined.
KINDS = tuple(dict.fromkeys((*models(), *WITH_EXTENSIONS)))


@pytest.mark.parametrize("fins", [2, *slow(1)])
def test_every_real_variable_and_enumeration_has_a_type(fins: int) -> None:
    """Quantity and unit agree with the type's, and no type has a variable's name (FMI 2.0.5, section 2.2.3)."""
    units_of: dict[str, set[str]] = {}  # by quantity
    for unit in (FmuInterface(fins, kind) for kind in KINDS):
        types = description.types(unit)
        assert not types.keys() & unit.reference.keys()
        defined = {(u.attrib["name"], d.attrib["name"]) for u in model_description.unit_definitions(unit)
                   for d in u.findall("DisplayUnit")}
        for v in unit.variables:
            if v.kind != "Real":
                assert (description.type_name(v) in types) == bool(v.items)
                continue
            attributes = model_description.typed_attributes(v)
            declared = model_description.real_type(types[str(attributes["declaredType"])])
            assert (declared["quantity"], declared["unit"]) == (attributes["declaredType"], v.unit)
            units_of.setdefault(str(declared["quantity"]), set()).add(v.unit)
            assert all((v.unit, shown) in defined for shown in (attributes["displayUnit"], declared["displayUnit"])
                       if shown)
    assert all(len(units) == 1 for units in units_of.values()), units_of
    assert {"Pressure", "BulkModulus", "AngularVelocity", "AngularFrequency", "TemperatureDifference"} < set(units_of)


@pytest.mark.parametrize("model", ["nonlinear", "nonlinear+controller", "nonlinear+plant", "nonlinear+torque"])
def test_units_and_types_are_those_of_the_variables_of_the_fmu(model: str) -> None:
    """Not those of inputs that a half, or the torque interface, hides."""
    unit = FmuInterface(1, model)
    starts = start_values(unit, [load_parameters(model=model).values])
    root = model_description.model_description(FORMATS["2"], unit, starts, "")
    variables = root.findall("ModelVariables/ScalarVariable/*")
    assert {u.get("name") for u in root.findall("UnitDefinitions/Unit")} == {
        v.get("unit") for v in variables if v.tag == "Real"}
    assert {t.get("name") for t in root.findall("TypeDefinitions/SimpleType")} == {
        v.get("declaredType") for v in variables} - {None}


def test_variable_with_the_name_of_a_type_is_refused() -> None:
    actuator = get("second-order")
    unit = FmuInterface(1)
    unit.__dict__["variables"] = (*actuator.outputs, real_output("Torque", "N.m", "a slip", 1.0))
    with pytest.raises(EmcasError, match="Torque is the name of a type in the model description"):
        description.types(unit)


def test_variable_with_an_unknown_unit_has_no_type() -> None:
    v = real_output("draught", "N/m2", "of a user's actuator", 1.0)
    assert (description.type_name(v), model_description.typed_attributes(v)["unit"]) == (None, "N/m2")


def test_speeds_of_motors_are_shown_in_rpm() -> None:
    shown = {v.name: model_description.typed_attributes(v)["displayUnit"] for v in get("series-clutch").outputs
             if v.unit == "rad/s"}
    assert shown == {"fin_rate": None, "screw_speed": "rpm", "motor_speed": "rpm"}


# -- runs --------------------------------------------------------------------------


class Running:
    """A running Python FMU in this process, with its inputs by name."""

    def __init__(self, unit: FmuInterface, chosen: ParameterSet) -> None:
        sets = [chosen.values] if unit.fins == 1 else [each.values for each in fin_sets(chosen, unit.fins)]
        self.unit, self.time = unit, 0.0
        self.inputs = dict(zip(unit.reference, start_values(unit, sets), strict=True))
        self.slave: Any = slave_class(unit, sets)(instance_name="running")
        self.slave.setup_experiment(0.0)
        self.slave.enter_initialization_mode()
        self.slave.exit_initialization_mode()

    def step(self, size: float) -> Mapping[str, float]:
        """Step by `size` [s], and return the outputs."""
        for i, v in enumerate(self.unit.inputs):
            (self.slave.set_boolean if v.kind == "Boolean" else self.slave.set_real)([i], [self.inputs[v.name]])
        assert self.slave.do_step(self.time, size), self.slave.log_queue[-1].msg
        self.time += size
        kinds = {"Real": self.slave.get_real, "Boolean": self.slave.get_boolean}
        return {v.name: kinds.get(v.kind, self.slave.get_integer)([self.unit.reference[v.name]])[0]
                for v in self.unit.outputs}


# The consumed share of the I2t budget and the power of a closed clutch are far below their nominal values in this run.
SMALL = {"i2t_load", "slip_power"}


@pytest.mark.parametrize("model", others_slow(
    [kind for kind in WITH_EXTENSIONS if not kind.startswith("linear")], is_quick))
def test_nominal_values_have_the_magnitude_of_the_values(model: str) -> None:
    """In a slew against a load the peaks are 0.1 to 10 times nominal, except of the linear actuator without limits."""
    chosen = load_parameters(model=model)
    if "homing.required" in chosen.values:
        chosen = chosen.with_values({"homing.required": False})
    unit = FmuInterface(1, chosen.model)
    running, peaks = Running(unit, chosen), dict.fromkeys((v.name for v in unit.outputs), 0.0)
    for v in unit.inputs:
        if v.kind == "Real" and running.inputs[v.name]:
            assert v.nominal is not None
            assert 1 / 3 < running.inputs[v.name] / v.nominal < 3, v.name
    for k in range(300):
        running.inputs |= {"fin_command": radians(10.0 if k < 150 else -10.0),
                           "aero_torque": -copysign(50.0, 150 - k)}
        peaks = {name: max(peaks[name], abs(value)) for name, value in running.step(2e-3).items()}
    for v in unit.outputs:
        if v.kind == "Real":
            assert v.nominal is not None
            assert (0.0 if v.name in SMALL else 0.1) <= peaks[v.name] / v.nominal <= 10.0, (v.name, peaks[v.name])


# Stops at their maximum distance, a lever that permits it, and a start near a stop.
FAR = {"fin.stop_angle": radians(80.0), "fin.start_angle": radians(79.0), "command.limit": radians(80.0),
       "kinematics.initial_angle": 0.0, "cylinder.dead_volume": 1e-3, "homing.timeout": 100.0,
       "homing.required": False, "drive.reference_limit": 1e3,
       **{f"friction.coulomb.{direction}[{k}]": 0.0 for direction in ("positive", "negative") for k in range(1, 7)}}
SUPPLIES = ("supply_voltage", "supply_pressure")
UNITS = [*(FmuInterface(1, kind) for kind in WITH_EXTENSIONS),
         FmuInterface(2), FmuInterface(2, "nonlinear+supply"), FmuInterface(2, "electrohydraulic")]


def with_faults(chosen: ParameterSet, rng: random.Random, far: bool) -> ParameterSet:
    """Return the parameters with random faults, and `far` with the widest stops."""
    values = {name: value for name, value in FAR.items() if far and name in chosen.values}
    widest = next(v.maximum for v in chosen.actuator.parameters if v.name == "fin.stop_angle")
    if far and widest > FAR["fin.stop_angle"]:  # without a lever
        values |= {"fin.stop_angle": widest, "fin.start_angle": widest - radians(1.0), "command.limit": widest}
    for name in chosen.values:
        if name.startswith("fault.") and name.endswith(".begin") and rng.random() < 0.3:
            values |= {name: rng.uniform(0.4, 0.8), name.replace("begin", "end"): 1e9}
    return chosen.with_values(values)


def random_value(v: Variable, size: float, rng: random.Random) -> Any:
    """Return a random value of an input with a magnitude of about `size`."""
    if v.kind == "Boolean":
        return rng.random() < 0.8
    return size * (rng.choice([0.0, 0.3, 1.0]) if v.minimum == 0.0 else rng.choice([-1.0, 1.0, rng.gauss(0.0, 1.0)]))


@pytest.mark.parametrize("unit", others_slow(UNITS, lambda unit: is_quick(unit.kind)), ids=lambda unit: unit.model)
def test_outputs_remain_within_their_limits(unit: FmuInterface) -> None:
    """Commands, loads, supply and faults are random; stops are the widest possible, then the shipped ones."""
    chosen, widest_angle = load_parameters(model=unit.kind), 0.0
    limited = [v for v in unit.outputs if v.kind == "Real" and (v.minimum > -inf or v.maximum < inf)]
    for seed in range(2):
        rng = random.Random(seed)
        running = Running(unit, with_faults(chosen, rng, far=seed % 2 == 0))
        scales = {"rad": 1.4, "N.m": 100.0, "V": 60.0, "Pa": 3e7}
        for k in range(80):
            for v in unit.inputs:
                if k == 0 or rng.random() < 0.15:
                    running.inputs[v.name] = random_value(v, scales.get(v.unit, 1.0), rng)
            if k < 20:  # at first everything pushes against a stop
                running.inputs |= {v.name: 0.0 if v in MIXING else scales.get(v.unit, True) for v in unit.inputs
                                   if v.name.endswith(("command", "aero_torque", *SUPPLIES, "enable"))}
            outputs = running.step(2e-2 if k < 20 else rng.choice([1e-3, 5e-3, 2e-2]))
            for v in limited:
                assert v.minimum <= outputs[v.name] <= v.maximum, (v.name, outputs[v.name], running.time)
            widest_angle = max(widest_angle, *(abs(value) for name, value in outputs.items()
                                               if name.endswith("fin_angle")))
    assert widest_angle >= 0.999 * min(v.maximum for v in limited if v.limited_by == ("fin.stop_angle",))


def test_output_limits_follow_from_parameter_limits() -> None:
    angle, = (v for v in get("nonlinear").limited_outputs if v.name == "fin_angle")
    stop, = (v for v in get("nonlinear").parameters if v.name == "fin.stop_angle")
    assert angle.maximum == -angle.minimum == 1.397  # 80 deg, rounded up to four digits
    assert stop.maximum == pytest.approx(radians(80.0))
    reference = {kind: next(v.maximum for v in get(kind).limited_outputs if v.name == "drive_reference")
                 for kind in ("nonlinear", "linear")}
    assert reference == {"nonlinear": 1001.0, "linear": inf}  # 1000 V and a margin for rounding
    words = [v for v in get("elastic+faults").outputs if v.bits]
    assert words
    assert all((v.minimum, v.maximum) == (0, 2 ** len(v.bits) - 1) for v in words)
    unlimited = replace(get("second-order"), outputs=(*fin_port.OUTPUTS, replace(fin_port.FIN_ANGLE, name="other",
                                                                                limited_by=("drive.voltage",))))
    assert unlimited.limited_outputs[-1].maximum == inf

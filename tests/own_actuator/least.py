"""The smallest actuator with given capabilities: the fin port, and the variables and states that they need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import NAMES, capabilities, fin_port, get
from emcas_fmu.actuators.declaration import Actuator, State, Supply
from emcas_fmu.parameters import load_parameters
from emcas_fmu.variables import Variable, real_output, tunable

PORT = ("fin_angle", "fin_rate")
GAIN = tunable("controller.kp", "1", 0.0, 1e3, "gain of the position loop")
TEXT = """
from tests.own_actuator.least import least

ACTUATOR = least({provided})
"""


@cache
def shipped() -> dict[str, tuple[str, Variable, Any]]:
    """Return the variables of shipped actuators by name, with their kind and their default value."""
    found: dict[str, tuple[str, Variable, Any]] = {}
    for model in NAMES:
        actuator, values = get(model), load_parameters(model=model).values
        for kind in ("parameters", "outputs", "inputs"):
            for v in getattr(actuator, kind):
                found.setdefault(v.name, (kind, v, values.get(v.name)))
    return found


@cache
def sampled_states() -> frozenset[str]:
    """Return the names of the states of shipped controllers."""
    return frozenset(s.name for model in NAMES for s in get(model).controller_states)


def _needed(provided: Iterable[str]) -> Iterator[tuple[str, Variable, Any]]:
    port = {v.name for v in fin_port.PARAMETERS}
    names = dict.fromkeys(name for each in provided for name in (
        *capabilities.NEEDED_VARIABLES[each], *capabilities.NEEDED_PARAMETERS[each]))
    return (shipped()[name] for name in names if name not in port and name in shipped())


def least(*provided: str) -> Actuator:
    """Return an actuator whose fin follows its reference as a second-order lag, with only the variables needed."""
    variables = {kind: tuple(v for each, v, _ in _needed(provided) if each == kind)
                 for kind in ("parameters", "outputs", "inputs")}
    names = dict.fromkeys(name for each in provided for name in capabilities.NEEDED_STATES[each])
    # With the equations of the screw drive the encoder is on the motor.
    geared = capabilities.SCREW_DRIVE in provided or capabilities.SCREW_EQUATIONS in provided
    encoder = ("motor_angle", "motor_speed") if geared else PORT
    names |= dict.fromkeys(name for name in encoder if name not in PORT)
    sampled = tuple(State(name) for name in names if name in sampled_states())
    further = tuple(State(name) for name in names if name not in sampled_states())
    outputs = tuple(v.name for v in variables["outputs"])
    power = real_output("supply_power", "W", "power", 100.0)
    supply = Supply(variables["inputs"][0], power) if variables["inputs"] else None

    def counted(angle: Any, offset: Any) -> Any:
        """Return the encoder's counts if the actuator has an encoder."""
        return {"counts": 1e3 * angle + (0.0 if offset is None else offset)} if capabilities.ENCODER in provided else {}

    def initial(ops: Any, p: Any, start: Any) -> Any:
        return counted(start.fin_angle, start.encoder_offset)

    looped = capabilities.POSITION_LOOP in provided

    def sample(ops: Any, p: Any, x: Any, inputs: Any) -> Any:
        command = fin_port.clipped_command(ops, p, inputs.command)
        gain = p.controller.kp if looped else 1.0
        return {"reference": ops.where(inputs.enable, x.fin_angle + gain * (command - x.fin_angle), 0.0),
                **{state.name: getattr(x, state.name) for state in sampled},
                **counted(x.fin_angle, inputs.encoder_offset)}

    def derivatives(ops: Any, p: Any, x: Any, u: Any) -> Any:
        torque = fin_port.hinge_torque(ops, p, x.fin_angle, u)
        pull = ops.where(u.enabled, 3600.0 * (u.reference - x.fin_angle), 0.0) - 90.0 * x.fin_rate + 0.01 * torque
        return {"fin_angle": x.fin_rate, "fin_rate": pull,
                **{s.name: 50.0 * (x.fin_rate - getattr(x, s.name)) for s in further}}

    def output_values(ops: Any, p: Any, x: Any, u: Any) -> Any:
        return {"fin_angle": x.fin_angle, "fin_rate": x.fin_rate,
                "hinge_torque": fin_port.hinge_torque(ops, p, x.fin_angle, u),
                "tracking_error": fin_port.clipped_command(ops, p, u.command) - x.fin_angle,
                "measured_fin_angle": u.measured_fin_angle, "saturated": u.limited > 0.0,
                "at_stop": ops.fabs(x.fin_angle) >= fin_port.stop_edge(p),
                **dict.fromkeys(outputs, 10.0 * (u.reference - x.fin_angle)),
                **({"supply_power": 2.0 * ops.fabs(x.fin_rate)} if supply else {})}

    return Actuator(
        name="least", title="a lag", states=(*map(State, PORT), *further), controller_states=sampled,
        parameters=(*fin_port.PARAMETERS, *variables["parameters"], *((GAIN,) if looped else ())),
        outputs=(*fin_port.OUTPUTS, *variables["outputs"], *((power,) if supply else ())), supply=supply,
        encoder=encoder, initial=initial, sample=sample, derivatives=derivatives, output_values=output_values,
        provides=frozenset(provided))


def written(folder: Path, *provided: str) -> str:
    """Write the smallest actuator with given capabilities and its parameter file; return its path."""
    path = folder / "least.py"
    path.write_text(TEXT.format(provided=", ".join(map(repr, provided))), encoding="utf-8")
    rows = ['"inertia.fin" = { value = 0.3, unit = "kg*m^2", source = "estimate" }\n']
    for kind, v, value in _needed(provided):
        if kind == "inputs":
            rows.append(f'"{v.key}" = {{ value = {v.nominal!r}, unit = "{v.unit}", source = "estimate" }}\n')
        elif kind == "parameters":
            unit = "" if v.kind == "Boolean" else f'unit = "{v.unit or 1}", '
            rows.append(f'"{v.name}" = {{ value = {str(value).lower()}, {unit}source = "estimate" }}\n')
    if capabilities.POSITION_LOOP in provided:
        rows.append('"controller.kp" = { value = 1.0, unit = "1", source = "estimate" }\n')
    path.with_suffix(".toml").write_text("".join(rows), encoding="utf-8")
    return str(path)



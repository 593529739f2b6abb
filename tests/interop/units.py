"""The FMUs for the clients, and the inputs of their runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.stored import Stored, load
from emcas_fmu.runtime.compiler import local_platform
from tests.fmu.built import lean

REFERENCES = Path(__file__).parents[2] / "models" / "reference"


@dataclass(frozen=True)
class Unit:
    """An FMU: arguments of `build`, back end, model, and names of its commands and angles.

    Without `loads` its angles are compared with the reference response `EMCAS_step`, which has no encoder. With `loads`
    they are compared with fmpy's run only.
    """

    title: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    model: str = "nonlinear"
    backend: str = "native"
    commands: tuple[str, ...] = ("fin_command",)
    angles: tuple[str, ...] = ("fin_angle",)
    loads: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def reference(self) -> bool:
        """Whether its angles are compared with the reference response."""
        return not self.loads

    @property
    def sources(self) -> bool:
        """Whether it contains sources."""
        return self.backend == "native"

    def build(self, folder: Path) -> Path:
        """Build the FMU for this platform: `native` as users build it, the other native ones without optimisation."""
        parameters, path = load_parameters(model=self.model), folder / "unit.fmu"
        if self.sources and self != UNITS["native"]:
            return lean(parameters, path, **self.arguments)
        local = local_platform()
        assert local is not None
        return build(parameters, path, self.backend, [local.name] if self.sources else None, references=False,
                     **self.arguments).path

    def task(self) -> dict[str, Any]:
        """Return step, parameters and inputs for :class:`.clients.Task`: the reference's commands, and loads."""
        case = step()
        command = case.inputs["fin_command"][:-1].tolist()
        load = [-15.0 if k > len(command) // 3 else 0.0 for k in range(len(command))]  # N.m
        arrays = "fins.fin_command" in self.commands
        return {"step": case.step, "parameters": dict(self.parameters), "inputs": {
            **dict.fromkeys(self.commands, [[angle] * 4 for angle in command] if arrays else command),
            **dict.fromkeys(self.loads, load)}}


@cache
def step() -> Stored:
    """Return the reference response `EMCAS_step`."""
    (case,) = load(REFERENCES, ["step"])
    return case


_ENCODER = "encoder.enabled"
_FINS = [f"fin[{k}]." for k in (1, 2, 3, 4)]
UNITS = {
    "native": Unit("native", parameters={_ENCODER: False}),
    "python": Unit("Python", backend="python", parameters={_ENCODER: False}),
    "four": Unit("native four fins", {"fins": 4}, commands=tuple(f + "fin_command" for f in _FINS),
                 angles=tuple(f + "fin_angle" for f in _FINS), parameters={f + _ENCODER: False for f in _FINS}),
    "options": Unit("native `elastic+heat+homing+faults`", {}, "elastic+heat+homing+faults",
                    loads=("aero_torque",), parameters={"homing.required": False}),
    "flat": Unit("native, `--names flat`", {"names": "flat"}, parameters={"encoder_enabled": False}),
    "fmi3": Unit("FMI 3.0", {"fmi": "3"}, parameters={_ENCODER: False}),
    "four3": Unit("FMI 3.0 four fins", {"fmi": "3", "fins": 4}, commands=("fins.fin_command",),
                  angles=tuple(f"fins.fin_angle[{k}]" for k in (1, 2, 3, 4)),
                  parameters={f"fins.{_ENCODER}": [False] * 4}),
    "scalars": Unit("FMI 3.0 four fins, `--scalars`", {"fmi": "3", "fins": 4, "scalars": True},
                    commands=tuple(f + "fin_command" for f in _FINS), angles=tuple(f + "fin_angle" for f in _FINS),
                    parameters={f + _ENCODER: False for f in _FINS}),
    "minimal": Unit("native, `--inputs minimal`", {"inputs": "minimal"}, parameters={_ENCODER: False}),
    "electrohydraulic": Unit("native `electrohydraulic`", {}, "electrohydraulic", loads=("aero_torque",)),
}

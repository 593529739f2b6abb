"""Running the kernel directly, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from emcas_fmu.actuators import get
from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.namespace import namespace
from emcas_fmu.physics.loads import NONE
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.codegen import inputs_at_rest
from emcas_fmu.runtime.core import Core
from emcas_fmu.simulation import simulate
from tests.default_actuator import OUTPUTS

__all__ = ["NAMES", "acting", "inputs_at_rest", "nested", "new_core", "simulate"]
NAMES = [v.name for v in OUTPUTS]


def new_core(values: Mapping[str, Any]) -> Core:
    """A core at its start."""
    return codegen.core(values)


def acting(reference: float = 0.0, supply: float = 39.0, enabled: bool = True) -> PlantInputs:
    """What acts on an electromechanical plant through a step: a drive's reference [V], and no load."""
    return PlantInputs(reference=reference, **vars(NONE), supply=supply, enabled=enabled, rated_current_limit=None)


def nested(values: Mapping[str, Any], model: str, **structure: Any) -> Any:
    """Parameters as a model's equations take them, some of its structure chosen otherwise."""
    return namespace(values, replace(get(model).structure, **structure))

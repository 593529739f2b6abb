"""Running the kernel directly, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emcas_fmu.kernels import program
from emcas_fmu.kernels.core import Core
from emcas_fmu.simulation import simulate
from tests.default_actuator import OUTPUTS

__all__ = ["NAMES", "new_core", "simulate"]
NAMES = [v.name for v in OUTPUTS]


def new_core(values: Mapping[str, Any]) -> Core:
    """A core at its start."""
    return program.core(values)

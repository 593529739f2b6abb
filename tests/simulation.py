"""Running the kernel directly, for tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from emcas_fmu.kernels import program
from emcas_fmu.kernels.core import Core
from emcas_fmu.variables import OUTPUTS

NAMES = [v.name for v in OUTPUTS]
INPUTS = ("fin_command", "aero_torque", "f_x", "f_z", "supply_voltage", "enable")


def new_core(values: Mapping[str, Any]) -> Core:
    """A core at its start."""
    return Core(program.make()(values), values)


def simulate(values: Mapping[str, Any], stop: float, step: float = 1e-3,
             **inputs: float | bool | Callable[[float], float | bool]) -> dict[str, np.ndarray]:
    """Outputs at the communication points, the first at `step`; inputs by name, constant or of time."""
    defaults = {"fin_command": 0.0, "aero_torque": 0.0, "f_x": 0.0, "f_z": 0.0,
                "supply_voltage": values["drive.supply_voltage"], "enable": True}
    unknown = set(inputs) - set(defaults)
    assert not unknown, unknown
    given = {**defaults, **inputs}
    core = new_core(values)
    rows = []
    for k in range(round(stop / step)):
        now = [v(k * step) if callable(v) else v for v in given.values()]
        core.run((k + 1) * step, now)
        rows.append(((k + 1) * step, *core.outputs(now)))
    return dict(zip(["time", *NAMES], np.array(rows, float).T, strict=True))

"""Running the actuator in this process, without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kernels import program
from .kernels.core import Core
from .variables import INPUTS, OUTPUTS

Signal = float | bool | Callable[[float], float | bool]


def simulate(values: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Signal) -> dict[str, NDArray[Any]]:
    """Outputs of the actuator at its communication points, from 0 to `stop` [s] every `step` [s].

    `values` are the flat parameters in SI. Inputs are given by name with ``__`` for the
    dot (``attitude__roll``), as a constant or a function of time [s], held over a step.
    Gives an array per output and ``time``. Raises TypeError for an unknown input and
    ArithmeticError where the equations cannot be followed.
    """
    signals: dict[str, Signal] = {v.name: values[v.key] if v.key else v.start or 0.0 for v in INPUTS}
    for name, signal in inputs.items():
        if name.replace("__", ".") not in signals:
            raise TypeError(f"there is no input {name!r}; inputs are {', '.join(signals)}")
        signals[name.replace("__", ".")] = signal
    core = Core(program.make()(values))

    def at(time: float) -> tuple[Any, ...]:
        now = {name: s(time) if callable(s) else s for name, s in signals.items()}
        motion = [now[f"acceleration.{axis}"] for axis in "xyz"] + [now["attitude.roll"], now["attitude.pitch"]]
        return now["fin_command"], now["aero_torque"], *core.forces(*motion), now["supply_voltage"], now["enable"]

    now = at(0.0)
    rows = [(0.0, *core.outputs(now))]
    for k in range(round(stop / step)):
        now = at(k * step)
        rows.append(((k + 1) * step, *core.run((k + 1) * step, now)))
    return dict(zip(["time", *(v.name for v in OUTPUTS)], np.array(rows, dtype=float).T, strict=True))

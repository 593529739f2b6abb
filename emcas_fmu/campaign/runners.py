"""What runs a sample's responses: the kernel, or an FMU under fmpy. Both give the same columns."""

from __future__ import annotations

import atexit
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..actuators import NONLINEAR, get
from ..actuators.declaration import Actuator
from ..bench.excitation import STEP
from ..parameters import ParameterError, check_parameters
from ..runtime import codegen, compiled
from ..runtime.core import Core
from ..simulation import Array, respond
from .distributions import CampaignError
from .experiments import INDEX, LOAD, POWER, POWER_ROWS, POWER_STEP, Excitation
from .plan import Plan

_ANGLE, _POWER = ([v.name for v in get(NONLINEAR).outputs].index(name) for name in ("fin_angle", POWER))


class Runner(Protocol):
    """Runs an excitation with flat parameters (SI); raises where the equations cannot be followed."""

    def __call__(self, values: Mapping[str, Any], made: Excitation) -> dict[str, Array]:
        """Columns of outputs at the excitation's times; `supply_power` POWER_ROWS to each, the first at the same."""


def runner(plan: Plan) -> Runner:
    """The kernel, or the FMU of a plan. Raises CampaignError where the FMU is not what the campaign began with."""
    if plan.fmu:
        return _unit(plan.fmu, plan.fmu_sha256, plan.fin, plan.model)
    return by_kernel if plan.model == NONLINEAR else partial(by_kernel, model=plan.model)


def by_kernel(values: Mapping[str, Any], made: Excitation, model: str = NONLINEAR) -> dict[str, Array]:
    """Response of the kernel of a model, compiled if there is a compiler."""
    if not made.stiffness:
        found = respond(values, np.repeat(made.table, POWER_ROWS, axis=0)[:1 - POWER_ROWS], POWER_STEP,
                        model=model)
        return {name: column if name == POWER else column[::POWER_ROWS] for name, column in found.items()}
    core: Any = compiled.CompiledCore(values, model) if compiled.available(model) else _python_core(values, model)
    places = codegen.places(model)

    def at(row: Array) -> tuple[Any, ...]:
        return places.arrange(row.tolist(), core.forces)

    def move(end: float, row: Array) -> tuple[Any, list[float]]:
        acting = at(row)
        powers = [core.run(time, acting)[_POWER] for time in _between(end)]
        return core.run(end, acting), powers

    return _coupled(get(model), made, lambda row: core.outputs(at(row)), move)


def _between(end: float) -> list[float]:
    """Times [s] power is looked at before the end of a step."""
    return [end - (POWER_ROWS - k) * POWER_STEP for k in range(1, POWER_ROWS)]


def _python_core(values: Mapping[str, Any], model: str) -> Core:
    _check(values, model)  # the compiled one does so itself, in a thousandth of the time
    return codegen.core(values, model)


def _check(values: Mapping[str, Any], model: str) -> None:
    if problems := check_parameters({v.name: values[v.name] for v in get(model).parameters}, model):
        raise ParameterError(problems)


def _coupled(actuator: Actuator, made: Excitation, first: Callable[[Array], Any],
             move: Callable[[float, Array], tuple[Any, list[float]]]) -> dict[str, Array]:
    """Step by step, the spring's moment by the fin angle at the beginning of each step.

    `move` gives the outputs at a step's end, and the powers on the way.
    """
    power = np.empty((len(made.table) - 1) * POWER_ROWS + 1)
    outputs = np.empty((len(made.table), len(actuator.outputs)))
    row = made.table[0].copy()
    outputs[0] = first(row)
    for k in range(1, len(made.table)):
        row[:] = made.table[k - 1]
        row[INDEX[LOAD]] -= made.stiffness * outputs[k - 1, _ANGLE]
        outputs[k], power[(k - 1) * POWER_ROWS + 1:k * POWER_ROWS] = move(k * STEP, row)
    power[::POWER_ROWS] = outputs[:, _POWER]
    return {v.name: power if v.name == POWER else outputs[:, i] for i, v in enumerate(actuator.outputs)}


class _FmuRunner:
    """One instance of an FMU, reset between responses and made anew after one that failed."""

    def __init__(self, unit: Any, model: str) -> None:
        self._unit, self._actuator = unit, get(model)
        self._instance: Any = None
        self._said: deque[str] = deque(maxlen=3)
        references = {v.name: v.valueReference for v in unit.description.modelVariables}
        # Those of the fin chosen; another fin of the unit stays at its start values.
        self._in = [references[unit.names[v.name]] for v in self._actuator.inputs]
        self._out = [references[unit.names[v.name]] for v in self._actuator.outputs]
        self._parameters = [(v, references[unit.names[v.name]]) for v in self._actuator.parameters]

    def __call__(self, values: Mapping[str, Any], made: Excitation) -> dict[str, Array]:
        """Response of the FMU."""
        _check(values, self._actuator.name)  # an FMU refuses, too, in words of its own or by not stepping
        self._said.clear()
        try:
            return self._run(values, made)
        except Exception as error:
            self.close()
            raise ArithmeticError("; ".join([str(error), *self._said])) from error

    def _run(self, values: Mapping[str, Any], made: Excitation) -> dict[str, Array]:
        from fmpy.simulation import instantiate_fmu

        if self._instance is None:
            self._instance = instantiate_fmu(str(self._unit.folder), self._unit.description, "CoSimulation",
                                             debug_logging=True, logger=self._log)
        else:
            self._instance.reset()
        unit = self._instance
        unit.setupExperiment(startTime=0.0)
        for v, reference in self._parameters:
            if values[v.name] != self._unit.starts[v.name]:
                {"Real": unit.setReal, "Integer": unit.setInteger, "Boolean": unit.setBoolean}[v.kind](
                    [reference], [values[v.name]])
        self._set(made.table[0], None)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        last: list[Array] = [made.table[0].copy()]

        def move(end: float, row: Array) -> tuple[list[float], list[float]]:
            self._set(row, last[0])
            last[0] = row.copy()
            powers: list[float] = []
            now = round(end / STEP - 1) * STEP
            for then in _between(end):
                unit.doStep(now, then - now)
                powers += unit.getReal([self._out[_POWER]])
                now = then
            unit.doStep(now, end - now)
            return self._get(), powers

        return _coupled(self._actuator, made, lambda _: self._get(), move)

    def _set(self, row: Array, before: Array | None) -> None:
        for i, v in enumerate(self._actuator.inputs):
            if before is None or row[i] != before[i]:
                if v.kind == "Boolean":
                    self._instance.setBoolean([self._in[i]], [bool(row[i])])
                else:
                    self._instance.setReal([self._in[i]], [float(row[i])])

    def _get(self) -> list[float]:
        unit = self._instance
        found: dict[int, float] = {}
        for kinds, read in (("Real",), unit.getReal), (("Boolean",), unit.getBoolean), (
                ("Integer", "Enumeration"), unit.getInteger):
            asked = [r for r, v in zip(self._out, self._actuator.outputs, strict=True) if v.kind in kinds]
            found |= dict(zip(asked, read(asked), strict=True)) if asked else {}
        return [float(found[r]) for r in self._out]

    def _log(self, _component: Any, _instance: bytes, status: int, _category: bytes, message: bytes) -> None:
        if status:
            self._said.append(message.decode(errors="replace").strip())

    def close(self) -> None:
        """Let go of the instance."""
        instance, self._instance = self._instance, None
        if instance is not None:
            instance.freeInstance()


@lru_cache(maxsize=2)
def _unit(path: str, sha256: str, fin: int, model: str) -> _FmuRunner:
    """The FMU of this process, unpacked once."""
    from ..bench.fmu import opened

    stack = ExitStack()
    unit = stack.enter_context(opened(Path(path), fin))
    if unit.sha256 != sha256:
        stack.close()
        raise CampaignError(f"{path}: is not the FMU the campaign began with (SHA-256 {unit.sha256[:16]}, not "
                            f"{sha256[:16]}); every worker must see the same file")
    made = _FmuRunner(unit, model)
    stack.callback(made.close)
    atexit.register(stack.close)
    return made



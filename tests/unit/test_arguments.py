"""Any wrong argument of the Python interface gives an EmcasError of one line that names the argument."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from types import FunctionType, ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import emcas_fmu
from emcas_fmu import Batch, EmcasError, excitations, load_parameters, simulate
from emcas_fmu.studies.tuning import optimise
from tests.marks import others_slow

BASE = load_parameters()
STEP = excitations.step_to(0.1, 0.05)
RESPONSE = simulate(BASE, STEP, kernel="python")
NASTY: tuple[Any, ...] = (
    None, True, -1, 0, 1.5, 10**400, float("nan"), float("inf"), 1e308, 5e-324, 1j, "", "x", "10 deg", "a\0b", "\ud800",
    "x" * 5000, b"x", [], {}, (), [1.0, [2.0]], [None], {"x": None}, {1: 2}, object(), lambda *_: 0, Path("nowhere"),
    Path("a\0b"), np.zeros((2, 3)), np.zeros(0), np.array("x"), np.array(None), np.float64("nan"))
LONGEST = 20.0  # s, for a call: a reference case or a build takes 2 s on an idle machine

# Valid arguments, one of which at a time is replaced; chosen for short runs.
SOUND: dict[str, dict[str, Any]] = {
    "simulate": {"parameters": BASE, "stop": 0.01, "step": 1e-3, "kernel": "python", "fin_command": 0.1},
    "simulate excitation": {"parameters": BASE, "excitation": STEP, "kernel": "python"},
    "simulate fins": {"parameters": [BASE, BASE], "stop": 2e-3, "line": {"bus.source_resistance": 0.1}},
    "validate": {"subject": BASE, "cases": ["nothing"], "inside": False},
    "analyse": {"parameters": BASE, "fin_angle": 0.0, "aero_torque": 0.0, "locus": "nothing", "rod": None},
    "tune": {"parameters": BASE, "study": None, "seed": 1, "generations": 1, "workers": 1},
    "calibrate": {"records": ["x.csv"], "parameters": BASE, "free": ["motor.resistance"], "hold_out": [], "compare": [],
                  "priors": [], "delays": False, "robust": False, "seed": 1},
    "build": {"parameters": BASE, "output": "EMCAS.fmu", "backend": "python", "references": False},
    "fin_sets": {"base": BASE, "fins": 2, "layout": "plus", "files": {}},
    "load_parameters": {"files": [], "base": BASE, "model": "linear"},
    "Batch": {"sets": BASE, "count": 2, "varied": {}, "threads": 1}, "Batch.run": {"end": 1e-3, "fin_command": 0.1},
    "Response": {"unit": RESPONSE.unit, "sets": RESPONSE.sets, "excitation": STEP, "columns": RESPONSE.columns},
    "Response.__getitem__": {"name": "time"}, "Response.metrics": {"fin": 0},
    "Response.in_unit": {"name": "fin_angle", "unit": "deg"}, "Response.write_csv": {"path": "response.csv"},
    "Response.plot": {"path": "response.svg"}, "Response.as_dict": {}, "Response.lines": {},
    "Response.to_dataframe": {},
    "ParameterSet": {"entries": BASE.entries, "model": "nonlinear", "unused": (), "files": ()},
    "ParameterSet.with_values": {"controller.position.kp": 70.0}, "ParameterSet.having": {"values": {}},
    "ParameterSet.nested": {}, "ParameterSet.estimates_in": {"names": ["heat."]},
    "Excitation": {"title": "t", "columns": {"fin_command": np.zeros(3)}, "begin": 0.0, "step": 1e-3,
                   "start_values": {}, "spring": 0.0},
    "Excitation.judged": {"time": STEP.time}, "Excitation.holding": {"columns": {"aero_torque": 1.0}},
    "Excitation.of": {"runs": 0}, "Excitation.with_start_values": {"values": {}},
    "Built": {"path": Path("x"), "size": 1, "guid": "", "platforms": (), "warnings": ()},
    "excitations.times": {"stop": 0.1, "step": 1e-3},
    "excitations.motion": {"kind": "slew", "amplitude": 0.1, "duration": 0.1, "torque": 1.0, "settle": 0.1,
                           "step": 1e-3},
    "excitations.step_to": {"level": 0.1, "duration": 0.1, "load": 1.0, "step": 1e-3},
    "excitations.slew_to": {"level": 0.1, "duration": 0.1, "load": 1.0, "settle": 0.1},
    "excitations.sweep": {"amplitude": 0.1, "duration": 0.5, "low": 1.0, "high": 2.0},
    "excitations.sine": {"amplitude": 0.1, "frequency": 10.0, "cycles": 1.0, "settle": (1.0, 0.1), "variable": "x"},
    "excitations.sine_from_rest": {"amplitude": 0.1, "frequency": 10.0, "duration": 0.1},
    "excitations.load_ramp": {"moment": 1.0, "duration": 0.1},
    "excitations.staircase": {"levels": [0.0, 1.0], "holds": [0.1, 0.1], "step": 1e-3},
    "excitations.reference_case": {"name": "step_plus1", "exact": True, "supply": 39.0},
    "excitations.of_case": {"title": "t", "inputs": {"fin_command": np.zeros(3)}, "step": 1e-3, "start_values": {}},
    "excitations.with_encoder": {"excitation": STEP},
    "excitations.csv_file": {"path": Path("x.csv"), "step": 1e-3, "stop": 0.1, "model": "nonlinear", "fins": 1},
    "actuators.get": {"name": "linear"},
}
OBJECTS: dict[str, Any] = {"Response": RESPONSE, "ParameterSet": BASE, "Excitation": STEP}


def _public() -> dict[str, Callable[..., Any]]:
    """Return the interface's functions, classes and methods by name, including functions that return an excitation."""
    public: dict[str, Callable[..., Any]] = {"excitations.times": excitations.times}
    for name in emcas_fmu.__all__:
        each = getattr(emcas_fmu, name)
        if isinstance(each, ModuleType):
            public |= {f"{name}.{key}": member for key, member in vars(each).items()
                      if isinstance(member, FunctionType) and not key.startswith("_")
                      and member.__module__ == each.__name__
                      and member.__annotations__.get("return") in ("Excitation", "Actuator")}
            continue
        public[name] = each
        public |= {f"{name}.{key}": member for key, member in vars(each).items() if isinstance(member, FunctionType)
                  and (not key.startswith("_") or key == "__getitem__")} if isinstance(each, type) else {}
    return public


PUBLIC = _public()
# Users catch errors, and get a Validation from validate(); its methods have no argument.
UNTESTED = {"EmcasError", "ParameterError", "Validation"}


def test_every_public_function_is_tested() -> None:
    assert {name.partition(" ")[0] for name in SOUND} == set(PUBLIC) - UNTESTED
    assert not any(inspect.signature(each).parameters.keys() - {"self"}
                   for name, each in PUBLIC.items() if name.startswith("Validation."))


def _call(name: str, arguments: dict[str, Any]) -> Any:
    owner, _, _ = name.partition(".")
    function = PUBLIC[name.partition(" ")[0]]
    if name == "Batch.run":
        return Batch(BASE, 2).run(**arguments)
    if name == "ParameterSet.with_values":
        return BASE.with_values(arguments)
    return function(OBJECTS[owner], **arguments) if "." in name and owner in OBJECTS else function(**arguments)


@pytest.mark.kernel("nonlinear")
@pytest.mark.parametrize("name", others_slow(SOUND, lambda name: name not in ("analyse", "build", "simulate fins")))
@pytest.mark.filterwarnings("ignore::RuntimeWarning", "ignore::UserWarning")  # 1e308 overflows and is clipped
def test_any_argument_gives_a_result_or_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every call ends within bounded time, with a result or an EmcasError."""
    monkeypatch.chdir(tmp_path)
    parameters = inspect.signature(PUBLIC[name.partition(" ")[0]]).parameters
    varied = (parameters.keys() | SOUND[name].keys()) - {"self", "inputs", "more", "overrides"}
    wrong = []
    with patch.object(optimise, "tune", lambda *_: None):  # the optimisation takes minutes
        for argument in sorted(varied):
            for nasty in (*NASTY, iter([object()])):
                begun = perf_counter()
                try:
                    _call(name, {**SOUND[name], argument: nasty})
                except EmcasError as error:
                    text = str(error)
                    if "\n" in text or not text:
                        wrong.append(f"{argument} = {nasty!r}: {text!r}")
                except ArithmeticError as error:  # as Batch.run promises
                    if name != "Batch.run":
                        wrong.append(f"{argument} = {nasty!r}: {error!r}")
                except Exception as error:  # noqa: BLE001
                    wrong.append(f"{argument} = {nasty!r}: {error!r}")
                if perf_counter() - begun > LONGEST:
                    wrong.append(f"{argument} = {nasty!r}: {perf_counter() - begun:.0f} s")
    assert not wrong, "\n".join(each[:300] for each in wrong)

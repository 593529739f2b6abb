"""Actuators that are not shipped: from a user's Python file, or from an installed package."""

from __future__ import annotations

import hashlib
import importlib.util
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from math import degrees, inf, radians
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import EmcasError, declared_in, location
from ..support.bounded import Endless, bounded
from ..support.progress import announce
from ..units import UnitError, to_base
from . import EXTENSIONS, NAMES
from .declaration import Actuator

GROUP = "emcas.actuators"
_NAME = re.compile("[A-Za-z][A-Za-z0-9_-]*")
_TURN = radians(360.1)  # a limit above a full turn looks like degrees
# Longest time [s] for importing a file, or for calling one of its functions with symbols; usually less than a second.
LONGEST_IMPORT = 60.0
# Remedies for errors of Python and NumPy about a traced value. Each pattern is searched in "MESSAGE | LINE", where LINE
# is the line of the user's file.
_REMEDIES = tuple((re.compile(pattern), remedy) for pattern, remedy in (
    (r"operand type\(s\) for %", "write x - y * ops.floor(x / y)"),
    (r"operand type\(s\) for //", "write ops.floor(x / y)"),
    (r"operand type\(s\) for \*\*", "write ops.pow(x, y)"),
    (r"^int\(\)", "write ops.floor(x)"),
    (r"^float\(\) [^|]*\| .*(?<!\.)\bfloat\(", "leave float() out"),
    (r"__round__", "write ops.floor(x + 0.5)"),
    (r"not subscriptable \| .*\b(\w+)\[['\"]([\w.]+)['\"]\]", r"write \1.\2"),
    (r"not subscriptable", "parameters, states and inputs have names, as in p.motor.resistance and x.fin_angle"),
    (r"tuple index out of range \| .*\b(p(?:\.\w+)+)\[", r"\1 has fewer values, counted from 0"),
    (r"indices must be|as an integer", "a list or a loop needs a fixed number; choose between values by ops.where"),
    (r"\| .*\b(?:np|numpy|math)\.(sin|cos|tan|atan2?|tanh|exp|log|sqrt|fabs|floor|minimum|maximum|clip|where|interp"
     r"|sign|pow)\(", r"use ops.\1"),
    (r"\| .*\b(?:np|numpy)\.(?:abs|absolute)\(", "use ops.fabs"),
    (r"\| .*(?<!\.)\b(min|max)\(", r"use ops.\1imum"),
    (r"\bExpr\b|real number", "equations are traced: use functions of ops, as in ops.sin(x)"),
))


@cache
def installed() -> Mapping[str, EntryPoint]:
    """Return the entry points of installed actuators by the actuators' names."""
    return {point.name: point for point in entry_points(group=GROUP)}


def load_module(path: Path) -> ModuleType:
    """Import a Python file, which may import modules beside it, and return its module.

    Raises EmcasError with file and line if the import fails or takes more than LONGEST_IMPORT.
    """
    name = f"emcas_file_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise EmcasError(f"{path}: cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name], imported_before = module, set(sys.modules)
    sys.path.insert(0, str(path.parent))
    try:
        with bounded(LONGEST_IMPORT):
            spec.loader.exec_module(module)
    except (Exception, Endless) as error:
        del sys.modules[name]
        raise refusal(error, path) from error
    finally:
        sys.path.remove(str(path.parent))
        # The next file may import another module of the same name from its folder.
        for other in set(sys.modules) - imported_before:
            if Path(getattr(sys.modules[other], "__file__", None) or "").parent == path.parent:
                del sys.modules[other]
    return module


def load(path: Path) -> Actuator:
    """Return the actuator that a Python file declares as ACTUATOR.

    Unless it declares parameter files, it has the one beside the Python file with the same name and the ending .toml,
    if there is one. Raises EmcasError with file and line if the file cannot be used.
    """
    if not path.is_file():
        raise EmcasError(f"{path}: there is no such file; a model is an actuator's name, or a Python file that defines "
                         "ACTUATOR")
    module = load_module(path)
    actuator = getattr(module, "ACTUATOR", None)
    if not isinstance(actuator, Actuator):
        raise EmcasError(f"{path}: defines no ACTUATOR; end it with ACTUATOR = Actuator(name=..., ...)")
    parameter_file = path.with_suffix(".toml")
    _check_name(actuator, path)
    reference = actuator.reference
    if isinstance(reference, str) and reference.endswith(".py"):
        reference = path.parent / reference
    files = actuator.files or ((parameter_file,) if parameter_file.is_file() else ())
    chosen = replace(actuator, files=files, modules=actuator.modules or (module,), reference=reference, source=path)
    _check_units(chosen, path)
    return chosen


def _check_name(actuator: Actuator, path: Path) -> None:
    """Raise EmcasError for a name that cannot be part of an FMU's name, or that a shipped actuator or extension has."""
    if not _NAME.fullmatch(actuator.name):
        raise EmcasError(f"{declared_in(path, actuator.name)}: name {actuator.name!r}: use letters, digits, _ and -, a "
                         "letter first: it is part of the FMU's name")
    if actuator.name in (*NAMES, *EXTENSIONS):
        raise EmcasError(f"{declared_in(path, actuator.name)}: name {actuator.name!r} is that of a shipped actuator or "
                         "extension; choose another name")


def _check_units(actuator: Actuator, source: Path) -> None:
    """Raise EmcasError for a unit that is unknown or is not an SI unit; warn of limits that look like degrees."""
    states = (*actuator.states, *actuator.controller_states, *actuator.sampled_states)
    variables = (*actuator.inputs, *actuator.outputs, *actuator.parameters)
    for name, unit in (*((s.name, s.unit) for s in states), *((v.name, v.unit) for v in variables)):
        try:
            _, factor, _ = to_base(unit)
        except UnitError as error:
            raise EmcasError(f"{declared_in(source, name)}: {name}: {error}") from error
        if factor != 1.0:
            raise EmcasError(f"{declared_in(source, name)}: {name}: {unit} is {factor:g} times the SI unit, in which "
                             f"equations compute; declare the SI unit (display={unit!r} shows a variable in {unit})")
    for v in actuator.parameters:
        if v.unit == "rad" and _TURN < (limit := max(-v.minimum, v.maximum)) < inf:
            announce(f"{declared_in(source, v.name)}: {v.name} may be up to {limit:g} rad, {degrees(limit):.4g} deg; "
                     f"if {limit:g} deg is meant, write radians({limit:g})")


def of_function(actuator: Actuator, name: str) -> str:
    """Return the location of the user's function that the traced function `name` calls; without one the file's path."""
    behind: dict[str, tuple[Callable[..., Any] | None, ...]] = {
        "initial": (actuator.initial,), "sample": (actuator.sample,), "outputs": (actuator.output_values,),
        "step": (actuator.derivatives, actuator.step)}
    locations = (location(function) for function in behind.get(name, ()) if function is not None)
    return next((each for each in locations if each.startswith(str(actuator.source))), str(actuator.source))


def refusal(error: BaseException, path: Path) -> EmcasError:
    """Return the EmcasError for an `error` in a user's file or a module beside it: file, line and, if known, remedy."""
    frames = [each for each in traceback.extract_tb(error.__traceback__) if Path(each.filename).parent == path.parent]
    file, number, line = (frames[-1].filename, frames[-1].lineno, frames[-1].line) if frames else (path, None, "")
    if isinstance(error, SyntaxError) and error.filename == str(path):
        number = error.lineno
    what = str(error) if isinstance(error, EmcasError) else f"{type(error).__name__}: {error}"
    if isinstance(error, Endless):
        what = (f"{frames[-1].name if frames else 'the file'} has not ended in {LONGEST_IMPORT:g} s; a loop needs a "
                "fixed end, as in for i in range(10)")
    if isinstance(error, (TypeError, IndexError)):
        found = ((match, remedy) for pattern, remedy in _REMEDIES if (match := pattern.search(f"{error} | {line}")))
        what += next((f"; {match.expand(remedy)}" for match, remedy in found), "")
    return EmcasError(f"{file}{f', line {number}' if number else ''}: {what}")

"""The actuators by name: shipped ones, those of installed packages, and those in a user's file.

A shipped actuator has a module here with its ACTUATOR, a line in `_MODULES`, and a parameter file in
``models/actuators`` (nonlinear: ``models/emcas.toml``). An extension (:mod:`emcas_fmu.extensions`) extends any actuator
that provides the capabilities that it needs. A model's name combines both: ``elastic+heat``, ``my_actuator.py+faults``.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import EmcasError, hint
from ..support.arguments import checked
from ..support.files import models_directory

if TYPE_CHECKING:  # the help of every command lists the names of models without loading any
    from collections.abc import Sequence

    from ..extensions.declaration import Extension
    from ..variables import Variable
    from .declaration import Actuator

NONLINEAR = "nonlinear"
_MODULES = {
    NONLINEAR: "electromechanical.nonlinear", "linear": "electromechanical.linear", "second-order": "second_order",
    "ristanovic": "electromechanical.ristanovic", "elastic": "electromechanical.elastic",
    "habibi": "electromechanical.habibi", "ozkan": "electromechanical.ozkan",
    "worm-gear": "electromechanical.worm_gear", "worm-gear-elastic": "electromechanical.worm_gear_elastic",
    "clutch": "electromechanical.clutch",
    "series-clutch": "electromechanical.series_clutch",
    "servo": "electromechanical.servo",
    "electrohydrostatic": "hydraulic.electrohydrostatic",
    "electrohydraulic": "hydraulic.electrohydraulic",
}
NAMES = tuple(_MODULES)
_OVER = {"worm-gear-elastic": "worm-gear"}  # shipped actuators whose parameter file overrides another actuator's
# Names of the extensions, in the order in which they are applied to an actuator.
EXTENSIONS: tuple[str, ...] = ("stribeck", "lugre", "uneven", "efficiency", "saturation", "inverter", "sensors", "heat",
                               "filters", "homing", "trajectory", "supply", "faults")
HALVES: tuple[str, ...] = ("controller", "plant")
"""Halves of an actuator, its controllers or its plant alone (:mod:`emcas_fmu.extensions.halves`)."""
TORQUE = "torque"
"""Interface of an actuator whose fin the host simulates (:mod:`emcas_fmu.extensions.torque`)."""
FMU_ONLY = (*HALVES, TORQUE)
"""Halves and interface that only FMUs can have: in a name they follow the extensions."""
_SEPARATOR = "+"
_NAME = re.compile(r"(.*\.py|[^+]*)((?:\+[^+]*)*)", re.DOTALL)


def split(name: str) -> tuple[str, list[str]]:
    """Return the actuator and the extensions in a name, as written; the path of a file may contain a +."""
    actuator, extensions = _NAME.fullmatch(name).groups()  # type: ignore[union-attr]  # every text matches
    return actuator, extensions.split(_SEPARATOR)[1:]


def parts(name: str) -> tuple[str, tuple[str, ...]]:
    """Return the actuator and the extensions in a name such as ``elastic+faults+heat``, in the order of EXTENSIONS.

    A file becomes its absolute path. Raises EmcasError for an unknown actuator or extension, and for an extension that
    appears twice; whether a file exists is not checked.
    """
    actuator, extensions = split(name)
    if actuator in EXTENSIONS:
        raise EmcasError(f"model {name}: {actuator} is an extension; name an actuator before it, as in "
                         f"{_SEPARATOR.join((NONLINEAR, name))}")
    for extension in extensions:
        if extension not in (*EXTENSIONS, *FMU_ONLY):
            raise EmcasError(f"model {name}: there is no extension {extension!r}{hint(extension, EXTENSIONS)}; "
                             f"there is {', '.join(EXTENSIONS)}")
        if extensions.count(extension) > 1:
            raise EmcasError(f"model {name}: extension {extension!r} appears twice")
    return _known(actuator, name), tuple(each for each in (*EXTENSIONS, *FMU_ONLY) if each in extensions)


def _known(actuator: str, name: str) -> str:
    from . import external

    if actuator in _MODULES:
        return actuator
    if actuator.endswith(".py"):
        return str(Path(actuator).resolve())
    installed = external.installed()
    if actuator not in installed:
        there_is = (*NAMES, *installed)
        raise EmcasError(f"model {name}: there is no actuator {actuator!r}{hint(actuator, there_is)}; there is "
                         f"{', '.join(there_is)}, or a file of yours that ends in .py")
    return actuator


def is_shipped(name: str) -> bool:
    """Return whether a name, with or without extensions, is that of a shipped actuator."""
    return split(name)[0] in _MODULES


def is_named(text: str) -> bool:
    """Return whether a text names an actuator: shipped, installed or in a Python file, with or without extensions."""
    from . import external

    actuator, _ = split(text)
    return actuator in _MODULES or actuator.endswith(".py") or actuator in external.installed()


def full_name(name: str) -> str:
    """Return the unambiguous name of a model, its :func:`parts` joined by +. Raises EmcasError as :func:`parts`."""
    actuator, extensions = parts(name)
    return _SEPARATOR.join((actuator, *extensions))


def with_extension(name: str, extension: str) -> str:
    """Return the full name of a model with an additional extension. Raises EmcasError as :func:`parts`."""
    return full_name(_SEPARATOR.join((name, extension)))


def of_fmu(name: str, part: str | None, interface: str) -> str:
    """Return the name of the model in an FMU: `name` with the half `part`, or with `interface` if it is TORQUE.

    Raises EmcasError for an unknown part, and, if `name` is extended by a half or TORQUE, for an unknown name.
    """
    if part and part not in HALVES:
        raise EmcasError(f"part {part}: there is {' and '.join(HALVES)}{hint(part, HALVES)}")
    addition = part or (TORQUE if interface == TORQUE else "")
    return with_extension(name, addition) if addition else name


@checked
def get(name: str) -> Actuator:
    """Return the actuator with a name, whose extensions may be in any order.

    Raises EmcasError as :func:`parts`, for a file that cannot be used, and if an extension needs a missing capability.
    """
    return _get(*parts(name))


def get_extension(name: str) -> Extension:
    """Return the extension, half or interface with a `name` in EXTENSIONS or FMU_ONLY."""
    module, attribute = ("halves", name.upper()) if name in HALVES else (name, "EXTENSION")
    extension: Extension = getattr(import_module(f"..extensions.{module}", __name__), attribute)
    return extension


@cache
def _get(name: str, extensions: tuple[str, ...]) -> Actuator:
    if extensions:
        *below, last = extensions
        return _extended(_get(name, tuple(below)), get_extension(last), _SEPARATOR.join((name, *extensions)))
    if name in _MODULES:
        shipped: Actuator = import_module(f".{_MODULES[name]}", __name__).ACTUATOR
        return shipped
    from . import external

    return external.load(Path(name)) if name.endswith(".py") else external.installed()[name].load()


def _extended(actuator: Actuator, extension: Extension, name: str) -> Actuator:
    """Return the actuator with an extension, the last one in the model's `name`."""
    for need in extension.needs:
        if need not in actuator.provides and (
                replacing := [each for each in split(name)[1][:-1] if need in get_extension(each).replaces]):
            raise EmcasError(f"model {name}: {extension.name} needs {need}, which {replacing[0]} replaces")
    require(name, extension.name, *extension.needs, actuator=actuator)
    return extension.over(actuator)


def require(name: str, purpose: str, *needs: str, actuator: Actuator | None = None, extension: str = "") -> None:
    """Raise EmcasError, with the actuators that qualify, if actuator `name` lacks a capability that `purpose` needs.

    If `purpose` also needs an `extension`, the error names these actuators with it.
    """
    chosen = get(name) if actuator is None else actuator
    if missing := [need for need in needs if need not in chosen.provides]:
        having = [_SEPARATOR.join(filter(None, (each, extension))) for each in NAMES
                  if get(each).provides.issuperset(needs)]
        shown, remedy = missing[:1], f"{chosen.name} has none; choose"
        if not is_shipped(name):  # a user can add all of them
            shown, remedy = missing, f"let {chosen.name} provide {_to_declare(chosen, missing)}, or choose"
        choices = " or ".join(filter(None, (", ".join(having[:-1]), *having[-1:])))
        raise EmcasError(f"model {name}: {purpose} needs {', '.join(shown)}; {remedy} {choices}")


def _to_declare(actuator: Actuator, needs: Sequence[str]) -> str:
    """Return, for a message, the capabilities as Python names, and the variables and states that `actuator` lacks."""
    from . import capabilities

    constants = {words: key for key, words in vars(capabilities).items() if isinstance(words, str)}
    has = {v.name for v in (*actuator.inputs, *actuator.outputs, *actuator.file_entries)}
    has |= {f"state {s.name}" for s in (*actuator.states, *actuator.controller_states, *actuator.sampled_states)}
    of_needs = (name for need in needs for name in (
        *capabilities.NEEDED_VARIABLES[need], *(f"state {each}" for each in capabilities.NEEDED_STATES[need])))
    declared = [name for name in dict.fromkeys(of_needs) if name not in has]
    return (", ".join(f"em.capabilities.{constants[need]}" for need in needs)
            + (f" and declare {', '.join(declared)}" if declared else ""))


def extension_outputs(name: str) -> tuple[Variable, ...]:
    """Return the outputs that the extensions in a name add to those of the actuator."""
    actuator, _ = parts(name)
    plain = {v.name for v in get(actuator).outputs}
    return tuple(v for v in get(name).outputs if v.name not in plain)


def extension_inputs(name: str) -> dict[str, frozenset[str]]:
    """Return, for each Real output that an extension in a name adds, the parameters that the same extension adds."""
    actuator, extensions = parts(name)
    found: dict[str, frozenset[str]] = {}
    for k in range(len(extensions)):
        below, over = _get(actuator, extensions[:k]), _get(actuator, extensions[:k + 1])
        parameters = frozenset(v.name for v in over.file_entries) - {v.name for v in below.file_entries}
        old = {v.name for v in below.outputs}
        found |= {v.name: parameters for v in over.outputs if v.name not in old and v.kind == "Real"}
    return found


def default_files(name: str) -> tuple[Path, ...]:
    """Return the files of a model's defaults, without ``models/emcas.toml``; later files override earlier ones.

    Raises EmcasError for an unknown name.
    """
    base, extensions = parts(name)
    folder = models_directory()
    files = get(base).files
    if base in _MODULES and base != NONLINEAR:
        names = (_OVER[base], base) if base in _OVER else (base,)
        files = tuple(folder / "actuators" / f"{each}.toml" for each in names)
    return (*files, *(folder / "extensions" / f"{each}.toml" for each in extensions if each in EXTENSIONS))

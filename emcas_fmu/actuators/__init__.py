"""The actuators there are: a model, each a module here, and options over it (:mod:`emcas_fmu.options`).

A module wires the physics into the functions of nonlinear.py, over the operations namespace, and tells its title,
state and own parameters. A further actuator, electrohydraulic or worm-geared, is a further module and a line in
`_MODULES`; what may be added to any of them is a further option. They are named together: ``elastic+heat+faults``.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module

from ..errors import EmcasError, hint
from ..variables import Variable
from .model import Actuator, of_module

NONLINEAR = "nonlinear"
_MODULES = {NONLINEAR: "nonlinear", "linear": "linear", "second-order": "second_order", "ristanovic": "ristanovic",
            "elastic": "elastic", "habibi": "habibi", "ozkan": "ozkan"}
NAMES = tuple(_MODULES)
# In the order in which one is laid over the other, the first next to the model.
OPTIONS: tuple[str, ...] = ("stribeck", "lugre", "efficiency", "heat", "homing", "faults")
_SEPARATOR = "+"


def parts(name: str) -> tuple[str, tuple[str, ...]]:
    """The model and the options, in their order, of a name such as ``elastic+faults+heat``. Raises EmcasError."""
    model, *options = name.split(_SEPARATOR)
    if model in OPTIONS:
        raise EmcasError(f"--model {name}: {model} is an option over a model: {_SEPARATOR.join((NONLINEAR, name))}")
    if model not in _MODULES:
        raise EmcasError(f"--model {name}: there is no model {model!r}{hint(model, NAMES)}; there is "
                         f"{', '.join(NAMES)}")
    for option in options:
        if option not in OPTIONS:
            raise EmcasError(f"--model {name}: there is no option {option!r}{hint(option, OPTIONS)}; there is "
                             f"{', '.join(OPTIONS)}")
        if options.count(option) > 1:
            raise EmcasError(f"--model {name}: option {option!r} is given twice")
    return model, tuple(option for option in OPTIONS if option in options)


def get(name: str) -> Actuator:
    """The actuator of that name, its options in any order. Raises EmcasError."""
    return _get(*parts(name))


@cache
def _get(model: str, options: tuple[str, ...]) -> Actuator:
    module = import_module(f".{_MODULES[model]}", __name__)
    modules, made, title = [module], of_module(module), [module.TITLE]
    name = _SEPARATOR.join((model, *options))
    for option in options:
        extension = import_module(f"..options.{option.replace('-', '_')}", __name__)
        if problem := extension.unfit(model, options):
            raise EmcasError(f"--model {name}: {option} {problem}")
        modules.append(extension)
        made = extension.extended(made)
        title.append(extension.TITLE)
    return Actuator(name, "; ".join(title), tuple(modules), made)


def every_own() -> tuple[Variable, ...]:
    """Own parameters of all models and options; some may share one."""
    found = [v for name in NAMES for v in get(name).own]
    found += [v for option in OPTIONS for v in import_module(f"..options.{option}", __name__).PARAMETERS]
    return tuple({v.name: v for v in found}.values())

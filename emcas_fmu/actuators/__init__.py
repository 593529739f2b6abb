"""The actuators there are, each a wiring of the physics in a module of its own.

A module has the functions of `FUNCTIONS`, over the operations namespace, and tells its state, title and own
parameters. A further actuator, electrohydraulic or worm-geared, is a further module and a line in `_MODULES`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from ..errors import EmcasError
from ..variables import PARAMETERS, Variable

NONLINEAR = "nonlinear"
_MODULES = {NONLINEAR: "nonlinear", "linear": "linear", "second-order": "second_order", "ristanovic": "ristanovic",
            "elastic": "elastic", "habibi": "habibi", "ozkan": "ozkan"}
NAMES = tuple(_MODULES)
# initial() gives the plant, integral, counts and measured fin angle; sample() takes the first two of the plant,
# integral, counts, command and enable; step() and outputs() the plant and what follows it in nonlinear.py.
FUNCTIONS = ("initial", "sample", "forces", "step", "outputs")


@dataclass(frozen=True)
class Actuator:
    """A model to choose: `plant` names its states, `own` are the parameters it has besides the variable table's.

    Parameters of the table that it does not read stay in its interface, so that a host may exchange one model for
    another.
    """

    name: str
    title: str
    module: ModuleType
    functions: tuple[Callable[..., Any], ...]
    plant: tuple[str, ...]
    own: tuple[Variable, ...]

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """All parameters of its interface."""
        return PARAMETERS + self.own


@cache
def get(name: str) -> Actuator:
    """The actuator of that name. Raises EmcasError."""
    if name not in _MODULES:
        raise EmcasError(f"--model {name}: there is {', '.join(NAMES)}")
    module = import_module(f".{_MODULES[name]}", __name__)
    return Actuator(name, module.TITLE, module, tuple(getattr(module, f) for f in FUNCTIONS), module.PLANT, module.OWN)


def every_own() -> tuple[Variable, ...]:
    """Own parameters of all actuators; some may share one."""
    return tuple({v.name: v for name in NAMES for v in get(name).own}.values())

"""The declaration of an extension: its needs, its additions, and how it extends the actuator."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..actuators.declaration import Actuator
from ..rules import Rule
from ..variables import Variable, with_outputs


def also_read(actuator: Actuator, *names: str) -> tuple[str, ...] | None:
    """Return `controllers_read` of an actuator with these names added; None stays None."""
    return None if actuator.controllers_read is None else (*actuator.controllers_read, *names)


@dataclass(frozen=True)
class Extension:
    """An extension of actuators; the defaults of its parameters are in ``models/extensions/NAME.toml``.

    It `needs` capabilities of the actuator (:mod:`emcas_fmu.actuators.capabilities`); those that it `replaces` are not
    available to later extensions. `extend(actuator)` returns the actuator with more states and other equations, to
    which `parameters(actuator)`, `outputs`, `rules(actuator)` and `imperfections(actuator)` are appended. `references`
    names the independent integrations that include the extension. An extension in the path of the command names its
    `command_switch`, a parameter that removes it at 0: tools that open the loops set it to 0. If it is above 0 in
    another actuator than the default one, a warning names the values that are still those for the default actuator.
    """

    name: str
    title: str
    extend: Callable[[Actuator], Actuator]
    needs: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    parameters: Callable[[Actuator], tuple[Variable, ...]] = lambda actuator: ()
    outputs: tuple[Variable, ...] = ()
    rules: Callable[[Actuator], tuple[Rule, ...]] = lambda actuator: ()
    imperfections: Callable[[Actuator], Mapping[str, Mapping[str, Any]]] = lambda actuator: {}
    references: tuple[str, ...] = ()
    command_switch: str = ""

    def over(self, actuator: Actuator) -> Actuator:
        """Return the extended actuator."""
        extended = self.extend(actuator)
        return replace(
            extended,
            name=f"{actuator.name}+{self.name}",
            title=f"{actuator.title}; {self.title}",
            parameters=extended.parameters + self.parameters(actuator),
            outputs=with_outputs(extended.outputs, self.outputs),
            rules=extended.rules + self.rules(actuator),
            imperfections={**extended.imperfections, **self.imperfections(actuator)},
            provides=extended.provides - set(self.replaces),
            reference=actuator.reference if actuator.reference in self.references else None,
            modules=(sys.modules[self.extend.__module__], *extended.modules),
        )

"""What an extension declares: what it needs of an actuator, what it adds, and the actuator it makes of another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ..actuators.declaration import Actuator, with_outputs
from ..rules import Rule
from ..variables import Variable


@dataclass(frozen=True)
class Extension:
    """Something laid over an actuator; its default values are in ``models/options/NAME.toml``.

    It `needs` these capabilities of the actuator (:mod:`emcas_fmu.actuators.capabilities`), and `replaces` some, which
    those laid over it then miss. `parameters(actuator)` and `outputs` come behind those there are; `extend` gives the
    actuator with further states and other equations. `replaces`, `parameters`, `outputs` and `rules` are added to what
    it gives.
    """

    name: str
    title: str
    extend: Callable[[Actuator], Actuator]
    needs: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    parameters: Callable[[Actuator], tuple[Variable, ...]] = lambda actuator: ()
    outputs: tuple[Variable, ...] = ()
    rules: Callable[[Actuator], tuple[Rule, ...]] = lambda actuator: ()
    module: Any = None

    def over(self, actuator: Actuator) -> Actuator:
        """Return the actuator with this extension laid over it."""
        extended = self.extend(actuator)
        return replace(
            extended,
            name=f"{actuator.name}+{self.name}",
            title=f"{actuator.title}; {self.title}",
            parameters=extended.parameters + self.parameters(actuator),
            outputs=with_outputs(extended.outputs, self.outputs),
            rules=extended.rules + self.rules(actuator),
            provides=extended.provides - set(self.replaces),
            reference=None,
            modules=(self.module, *extended.modules),
        )

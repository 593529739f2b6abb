"""The versions of FMI: their differences in the model description, the C code and the files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from .fmi3.arrays import CLOCK, TIME, Array, arrays
from .interface import FmuInterface


@dataclass(frozen=True)
class Format:
    """A version of FMI, with the options of an FMU.

    `options` are attributes of the CoSimulation element of the native back end. With `clock` an FMU of FMI 3.0 has a
    clock of the controllers' samples, with `scalars` it has no arrays.
    """

    version: int
    options: Mapping[str, str]
    clock: bool = False
    scalars: bool = False

    @property
    def main(self) -> str:
        """The name of the C file to compile."""
        return f"fmi{self.version}.c"

    @property
    def is_3(self) -> bool:
        """Whether it is FMI 3.0."""
        return self.version > 2

    @property
    def arrays(self) -> bool:
        """Whether variables can be arrays."""
        return self.is_3 and not self.scalars

    @property
    def prefix(self) -> str:
        """The standard's macro with the prefix of the functions' names."""
        return f"FMI{self.version}_FUNCTION_PREFIX"

    @property
    def no_prefix(self) -> str:
        """The standard's macro that is defined for a shared library, whose functions have no prefix."""
        return f"FMI{self.version}_OVERRIDE_FUNCTION_PREFIX"

    def standard_headers(self) -> dict[str, str]:
        """Return the headers of the FMI standard that fmpy ships, by name; those of FMI 2.0 never add a prefix."""
        headers = (Path(fmpy.__file__).parent / "c-code").glob(f"fmi{self.version}*.h")
        return {header.name: header.read_text(encoding="utf-8") for header in headers}

    def variables(self, interface: FmuInterface) -> tuple[Array, ...]:
        """Return the inputs, outputs and parameters that a host sees, in the order of their value references."""
        joined = arrays(interface) if self.is_3 else ()  # also checks the names of scalars
        listed = joined if self.arrays else tuple(Array(v, i) for i, v in enumerate(interface.variables))
        return tuple(each for each in listed if each.variable.name not in interface.actuator.hidden)

    def references(self, interface: FmuInterface) -> tuple[tuple[int, Array], ...]:
        """Return all variables with their value references: in FMI 2.0 indices among the scalars, in 3.0 from 1 on.

        FMI 3.0 does not begin at 0, since some hosts read the references in dependencies as indices from 1.
        """
        return tuple((k if self.is_3 else each.first, each) for k, each in enumerate(self.listed(interface), 1))

    def listed(self, interface: FmuInterface) -> tuple[Array, ...]:
        """Return all variables in the order of their value references: in FMI 3.0 also time and the clock."""
        more = (TIME, *([CLOCK] if self.clock else ())) if self.is_3 else ()
        return (*self.variables(interface), *(Array(v, len(interface.variables)) for v in more))

    def in_files(self, interface: FmuInterface, fins: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return columns or values of all fins by their names in the FMU; an array's last dimension counts fins."""
        if not self.arrays:
            return {name if name == "time" else interface.spelt(interface.name(name, fin)): value
                    for fin, each in enumerate(fins) for name, value in each.items()}
        arrayed = {name: name if name == "time" else interface.array_name(name) for name in fins[0]}
        return {interface.spelt(array): value if array == name else np.stack([each[name] for each in fins], axis=-1)
                for (name, array), value in zip(arrayed.items(), fins[0].values(), strict=True)}


FORMATS = {
    "2": Format(2, {
        "needsExecutionTool": "false", "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "true", "maxOutputDerivativeOrder": "0", "canRunAsynchronuously": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false", "canNotUseMemoryManagementFunctions": "false",
        "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "false"}),
    "3": Format(3, {
        "needsExecutionTool": "false", "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "providesDirectionalDerivatives": "false",
        "canHandleVariableCommunicationStepSize": "true", "maxOutputDerivativeOrder": "0",
        "providesIntermediateUpdate": "false", "mightReturnEarlyFromDoStep": "true", "hasEventMode": "true"})}

"""The interface of an FMU of one or several actuators, from the actuator's declaration.

The FMU of a single actuator has the actuator's variables. With several, the variables of each are under ``fin[1].``,
``fin[2].`` and so on. Vehicle motion and supply are then inputs that all share; mixing inputs and, if the actuators
have a supply, outputs and parameters of the supply line are added.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..actuators import NONLINEAR, fin_port, get
from ..actuators.declaration import Actuator
from ..actuators.positional import identifier
from ..actuators.supply_line import SupplyLine
from ..errors import EmcasError
from ..parameters import ParameterSet, load_parameters
from ..support.arguments import checked
from ..variables import Variable, real_input

MOST_FINS = 8
SPELLINGS = ("structured", "flat")
"""Naming conventions of FMI: ``fin[2].fault.jam.begin`` or ``fin2_fault_jam_begin``."""
LAYOUTS = ("plus", "cross")
INPUT_SETS = ("all", "minimal")
"""Inputs of an FMU: all of the actuator's, or fin_command and aero_torque alone; the others are tunable parameters."""
CONNECTIONS = ("angle", "torque")
"""What an FMU computes: the fin's angle under a load, or the torque on a fin that the host models."""
MINIMAL = (fin_port.COMMAND.name, fin_port.AERO_TORQUE.name)
AZIMUTH = "mounting.azimuth"
FINS = "fins."
"""Prefix of the name of an array with an element for each fin (FMI 3.0)."""
_IDENTIFIER = re.compile(r"[A-Za-z_]\w{0,63}", re.ASCII)
# In texts: a variable's name, or a group's prefix as in heat.*; and a fin's prefix.
_NAME = re.compile(r"(?<!\w)[a-z_]\w*(?:\.[a-z_]\w*)*(?:\[\w\]|\.(?=\*))?")
_OF_FIN = re.compile(r"\bfin\[\d\]\.?")
VEHICLE = tuple(v.name for v in fin_port.VEHICLE_MOTION)


def _mixing(axis: str, along: str) -> Variable:
    return real_input(f"{axis}_command", "rad",
                      f"deflection of tail fins for a positive moment about body {along}; added to the fins' commands: "
                      "-(roll + pitch cos(azimuth) + yaw sin(azimuth))", nominal=0.1)


MIXING = (_mixing("roll", "x (right side down)"), _mixing("pitch", "y (nose up)"), _mixing("yaw", "z (nose right)"))


def model_name(actuator: str, fins: int = 1) -> str:
    """Return the model's name: EMCAS (nonlinear), EMCAS4 (4 fins), EMCAS_second_order, EMCAS_heat (nonlinear+heat)."""
    several = "" if fins == 1 else f"{fins}"
    return f"EMCAS{several}" + (
        "" if actuator == NONLINEAR else f"_{identifier(actuator.removeprefix(f'{NONLINEAR}+'))}")


def flat(name: str) -> str:
    """Return a variable's name with _ for dots, without brackets: ``fin[2].fin.stop_angle`` is fin2_fin_stop_angle."""
    return re.sub(r"[\[\]]", "", name).replace(".", "_")


@dataclass(frozen=True)
class FmuInterface:
    """The interface of an FMU of `fins` actuators of a `kind` (a name for :func:`emcas_fmu.actuators.get`).

    Names here are structured; names in the FMU have the `spelling` (:data:`SPELLINGS`). `connected` is one of
    :data:`INPUT_SETS`. An `own_identifier` replaces the model's name as model identifier. A variable's index in
    `variables` is its value reference in FMI 2.0: inputs, outputs, parameters; each group begins with the shared
    variables, followed by those of each fin in the actuator's order. Raises EmcasError for an invalid argument.
    """

    fins: int
    kind: str = NONLINEAR
    spelling: str = SPELLINGS[0]
    connected: str = INPUT_SETS[0]
    own_identifier: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.fins <= MOST_FINS:
            raise EmcasError(f"fins {self.fins}: an FMU has 1 to {MOST_FINS} fins")
        for option, value, choices in (("names", self.spelling, SPELLINGS), ("inputs", self.connected, INPUT_SETS)):
            if value not in choices:
                raise EmcasError(f"{option} {value}: choose {' or '.join(choices)}")
        if self.own_identifier is not None and not _IDENTIFIER.fullmatch(self.own_identifier):
            raise EmcasError(f"identifier {self.own_identifier!r}: it is not a C identifier, which names functions and "
                             "library: choose 1 to 64 letters, digits and _, not beginning with a digit")
        by_flat: dict[str, str] = {}
        for name in self.reference if self.spelling == "flat" else ():
            if by_flat.setdefault(flat(name), name) != name:
                raise EmcasError(f"names flat: {by_flat[flat(name)]} and {name} would both be {flat(name)}; rename one "
                                 "of them, or build with structured names")

    @property
    def model(self) -> str:
        """The name of the model (:func:`model_name`)."""
        return model_name(self.actuator.name, self.fins)

    @property
    def identifier(self) -> str:
        """The model identifier: the name of the library, and the prefix of functions compiled into a program."""
        return self.model if self.own_identifier is None else self.own_identifier

    @property
    def actuator(self) -> Actuator:
        """The actuator of each fin."""
        return get(self.kind)

    def name(self, variable: str, fin: int) -> str:
        """Return the name of a variable of fin 0, 1, ... in the interface."""
        return variable if self.fins == 1 or variable in self.shared else f"fin[{fin + 1}].{variable}"

    def spelt(self, name: str) -> str:
        """Return a variable's structured name in the FMU's spelling."""
        return flat(name) if self.spelling == "flat" else name

    def respelt(self, text: str) -> str:
        """Return a text with its structured names in the FMU's spelling."""
        if self.spelling != "flat":
            return text

        def flattened(match: re.Match[str]) -> str:
            if match[0] in self._names_in_texts:
                return flat(match[0])
            name, bracket, rest = match[0].partition("[")
            return flat(name) + bracket + rest if name.rstrip(".") in self._names_in_texts else match[0]

        return _OF_FIN.sub(lambda match: flat(match[0]), _NAME.sub(flattened, text))

    @cached_property
    def _names_in_texts(self) -> frozenset[str]:
        """The names of variables and arrays, and prefixes of groups, that may occur in texts."""
        line = self.line.parameters if self.line else ()
        names = [v.name for v in (*self.actuator.inputs, *self.actuator.outputs, *self.actuator.parameters, *line)]
        parts = [name.partition("[")[0].split(".") for name in (*names, *map(self.array_name, names))]
        return frozenset((*names, *(".".join(each[:i]) for each in parts for i in range(1, len(each) + 1))))

    def of_fin(self, number: object) -> str:
        """Return the name of a fin in messages; its `number` begins at 1."""
        return f"fin{number}" if self.spelling == "flat" else f"fin[{number}]"

    def array_name(self, variable: str) -> str:
        """Return a variable's name in FMI 3.0: that of the array over the fins, unless it has no element per fin."""
        return variable if self.fins == 1 or variable in self.shared else f"{FINS}{variable}"

    @cached_property
    def shared(self) -> tuple[str, ...]:
        """Names of the inputs that all fins share: vehicle motion and, if they have one, the supply."""
        supply = self.actuator.supply
        return VEHICLE if supply is None else (*VEHICLE, supply.input.name)

    @property
    def line(self) -> SupplyLine | None:
        """The supply line that several fins share; None for a single fin or without a supply."""
        supply = self.actuator.supply
        return None if supply is None or self.fins == 1 else supply.line

    @cached_property
    def line_outputs(self) -> tuple[Variable, ...]:
        """Outputs of the line, if any: voltage or pressure at the fins; current or flow, and power, of all fins."""
        supply = self.actuator.supply
        if self.line is None or supply is None:
            return ()
        return (*self.line.outputs, replace(supply.power, description=self.line.power))

    @cached_property
    def groups(self) -> tuple[tuple[tuple[Variable, ...], tuple[Variable, ...]], ...]:
        """For inputs, outputs and parameters: the variables that fins share (none for a single fin), then one fin's."""
        actuator, supply = self.actuator, self.actuator.supply
        if self.fins == 1:
            inputs = self._connected(actuator.inputs)
            return tuple(((), each) for each in (inputs, actuator.limited_outputs, actuator.parameters))
        source = {} if supply is None else {supply.input.name: supply.line.source}
        shared = tuple(replace(v, description=source.get(v.name, v.description))
                       for v in actuator.inputs if v.name in self.shared)
        each = tuple(v for v in actuator.inputs if v.name not in self.shared)
        return ((self._connected(shared + MIXING), self._connected(each)),
                (self.line_outputs, actuator.limited_outputs),
                (self.line.parameters if self.line else (), actuator.parameters))

    def is_input(self, name: str) -> bool:
        """Return whether an input of the actuator, by its name there, is also an input of the FMU."""
        return self.connected != "minimal" or name in MINIMAL

    def _connected(self, inputs: tuple[Variable, ...]) -> tuple[Variable, ...]:
        """Return inputs of the actuator as inputs or tunable parameters of the FMU."""
        return tuple(v if self.is_input(v.name) else replace(v, causality="parameter", variability="tunable")
                     for v in inputs)

    def _scalars(self, group: int) -> tuple[Variable, ...]:
        shared, each = self.groups[group]
        return shared + tuple(replace(v, name=self.name(v.name, fin)) for fin in range(self.fins) for v in each)

    @cached_property
    def inputs(self) -> tuple[Variable, ...]:
        """The inputs, shared and mixing ones, then those of each fin; with ``minimal`` most are tunable parameters."""
        return self._scalars(0)

    @cached_property
    def outputs(self) -> tuple[Variable, ...]:
        """The outputs: those of the line, then those of each fin."""
        return self._scalars(1)

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The parameters: those of the line, then those of each fin."""
        return self._scalars(2)

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """All variables in the order of their value references."""
        return self.inputs + self.outputs + self.parameters

    @cached_property
    def reference(self) -> Mapping[str, int]:
        """Index of each name in `variables`."""
        return {v.name: i for i, v in enumerate(self.variables)}

    @property
    def fin_inputs(self) -> tuple[tuple[int, ...], ...]:
        """For each fin, the indices in `variables` of its actuator's inputs."""
        return tuple(tuple(self.reference[self.name(v.name, fin)] for v in self.actuator.inputs)
                     for fin in range(self.fins))


def azimuths(fins: int, layout: str) -> tuple[float, ...]:
    """Return azimuths [deg] of equally spaced fins: the first is 0 (``plus``) or half of the spacing (``cross``).

    Raises EmcasError for another layout.
    """
    if layout not in LAYOUTS:
        raise EmcasError(f"layout {layout}: choose {' or '.join(LAYOUTS)}")
    spacing = 360.0 / fins
    return tuple(spacing * (k + (0.5 if layout == "cross" else 0.0)) for k in range(fins))


def fin_files(arguments: Sequence[str]) -> dict[int, Path]:
    """Return the parameter files of arguments ``N=FILE`` by the number of the fin.

    Raises EmcasError for an argument of another form, or two with the same number.
    """
    files: dict[int, Path] = {}
    for text in arguments:
        number, separator, file = text.partition("=")
        if not separator or not file or not number.isdigit():
            raise EmcasError(f"--fin {text}: expected a fin's number from 1 on and a file, as in --fin 2=second.toml")
        if int(number) in files:
            raise EmcasError(f"--fin {text}: fin {number} appears twice")
        files[int(number)] = Path(file)
    return files


@checked
def fin_sets(base: ParameterSet, fins: int, layout: str = "cross",
             files: Mapping[int, Path | str] = MappingProxyType({})) -> tuple[ParameterSet, ...]:
    """Return each fin's parameters: `base` with the azimuth of the `layout`, overridden by the fin's file if any.

    `layout` is ``plus`` or ``cross``; the keys of `files` are fin numbers, from 1. Raises EmcasError for an unknown fin
    or layout, or fins that differ in the start value of a shared input; ParameterError for a file's problems.
    """
    FmuInterface(fins)  # raises EmcasError for a wrong number
    angles = azimuths(fins, layout)
    for fin in files:
        if not 1 <= fin <= fins:
            raise EmcasError(f"fin {fin}={files[fin]}: the FMU has fins 1 to {fins}")
    turned = [base.with_values({AZIMUTH: f"{azimuth} deg"}) for azimuth in angles]
    # If the azimuth is already that of `base`, `base` itself is used: it keeps the source of the azimuth.
    sets = tuple(load_parameters(files.get(fin), base if each.values == base.values else each)
                 for fin, each in enumerate(turned, 1))
    require_shared(sets, ", ".join(map(str, files.values())))
    return sets


def require_shared(sets: Sequence[ParameterSet], where: str) -> None:
    """Raise EmcasError, naming the files `where`, if fins differ in the start value of a shared input."""
    interface = FmuInterface(1, sets[0].model)
    for name in (v.key for v in interface.inputs if v.key is not None and v.name in interface.shared):
        if len({each.values[name] for each in sets}) > 1:
            raise EmcasError(f"{where}: {name} differs between fins, which share it; change it for every fin")


def start_values(interface: FmuInterface, sets: Sequence[Mapping[str, Any]]) -> tuple[Any, ...]:
    """Return the start value of every variable, in the order of `variables`; 0 or False for outputs.

    `sets` are the fins' parameters by name [SI]; shared inputs start at the values of the first fin.
    """
    entries = {v.name: v.key or v.name for v in (*interface.actuator.inputs, *interface.actuator.parameters)
               if v.causality == "parameter" or v.key}
    known = {v.name: False if v.kind == "Boolean" else 0.0 for v in interface.outputs} | {
        interface.name(name, fin): values[entry] for fin, values in reversed(list(enumerate(sets)))
        for name, entry in entries.items()} | dict(interface.line.values if interface.line else {})
    return tuple(known.get(v.name, v.start) for v in interface.variables)

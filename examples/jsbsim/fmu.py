"""Actuators of the fins from FMUs of any model, run by fmpy: one FMU of four fins, or four instances of one fin's."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from contextlib import ExitStack
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu

from emcas_fmu.bench.fmu import model_of, opened
from emcas_fmu.errors import EmcasError

from .actuators import Demand, Response
from .vehicle import AZIMUTHS, FINS, STATION, Array

WIRED: Mapping[str, bool | float] = {"loads.gravity": True, "mounting.station": STATION}
"""Parameters of an FMU that reads the vehicle's motion: its parts have weight, and the hinges their position."""
BUS_RESISTANCE = 0.02
"""Resistance of battery and cables [Ohm], an estimate."""
# Source, variable, unit, and index of the value in `flattened` (of each fin's own inputs: the index for fin 1).
OWN_INPUTS = (("autopilot", "fin_command", "rad", 0), ("rocket", "aero_torque", "N.m", 4))
SHARED_INPUTS = (*(("rocket", f"acceleration.{n}", "m/s2", 8 + k) for k, n in enumerate("xyz")),
                 *(("rocket", f"attitude.{n}", "rad", 11 + k) for k, n in enumerate(("roll", "pitch", "yaw"))),
                 *(("rocket", f"angular_rate.{n}", "rad/s", 14 + k) for k, n in enumerate("xyz")),
                 *(("rocket", f"angular_acceleration.{n}", "rad/s2", 17 + k) for k, n in enumerate("xyz")))
_MIXING = tuple(("autopilot", f"{n}_command", "rad", 20 + k) for k, n in enumerate(("roll", "pitch", "yaw")))
VOLTAGE = "supply_voltage"
LINES = {VOLTAGE: (("bus_voltage", "V"), ("bus_current", "A")),
         "supply_pressure": (("line_pressure", "Pa"), ("line_flow", "m3/s"))}
"""By the supply's input, the outputs of an FMU of four with the line's level and the current or flow from it.

They have the names in `Response`; the input has the unit of the first.
"""
_MOVED = (("fin_angle", "rad"), ("fin_rate", "rad/s"))
_POWER = ("supply_power", "W")
OUTPUTS = (*_MOVED, _POWER)
FLAG = "saturated"
_AZIMUTH, _RESISTANCE = "mounting.azimuth", "bus.source_resistance"
_REMEDY = {True: "one of `emcas build --fins 4` is needed", False: "an FMU of `emcas build` is needed"}


def flattened(demand: Demand) -> Array:
    """Return commands, hinge moments and vehicle motion, then the axes if there are any, in shape (20,) or (23,)."""
    axes = () if demand.axes is None else demand.axes
    return np.concatenate([demand.commands, demand.hinge_moments, demand.acceleration, demand.attitude,
                           demand.body_rates, demand.angular_acceleration, axes])


def line_of(names: Container[str]) -> str | None:
    """Return the supply's input, one of LINES, among the variables' names; None if there is none."""
    return next((supply for supply in LINES if supply in names), None)


def require_supply(path: Path, supply: str, level: float) -> float:
    """Return the `level` of a supply [V] or [Pa]. Raises EmcasError unless it is finite and above 0."""
    if not (isfinite(level) and level > 0.0):
        if supply == VOLTAGE:
            raise EmcasError(f"{path}: a bus voltage of {level:g} V: must be above 0; pass another by --bus-voltage")
        raise EmcasError(f"{path}: {supply} starts at {level:g} {LINES[supply][0][1]}: must be above 0; build the FMU "
                         "with another start value")
    return level


def require_bus(path: Path, supply: str | None, voltage: float | None = None, resistance: float | None = None) -> None:
    """Raise EmcasError if a bus voltage [V] or a bus resistance [Ohm] is passed for an FMU without a bus."""
    if supply != VOLTAGE and (voltage is not None or resistance):
        raise EmcasError(f"{path}: {f'its supply is {supply}' if supply else 'has no supply'}, not a bus: leave "
                         f"{'--bus-resistance' if voltage is None else '--bus-voltage'} out")


def on_line(supply: str, level: float, power: float) -> dict[str, float]:
    """Return level and current or flow of a stiff line that supplies a `power` [W], by the names of LINES."""
    return {name: value for (name, _), value in zip(LINES[supply], (level, power / level), strict=True)}


def fins_of(names: Mapping[str, Any]) -> int:
    """Return the number of fins of an FMU of several, by the names of its variables; 0 for a single actuator."""
    matches = (re.fullmatch(r"fin\[(\d+)\]\..*", name) for name in names)
    return max((int(match[1]) for match in matches if match), default=0)


class Fmu:
    """Four fins: one FMU with fin[1].fin_command ... fin[4].fin_command, or four instances of one with fin_command."""

    def __init__(self, path: Path, guid: str | None = None, parameters: Mapping[str, bool | float] = WIRED, *,
                 bus_resistance: float | None = None, bus_voltage: float | None = None,
                 mixing: bool = False) -> None:
        """Load and initialize the FMU with each fin's mounting.azimuth and other `parameters` in the FMU's units.

        The supply is the one of LINES that the FMU has as an input. A supply has the FMU's start value, a bus
        `bus_voltage` [V] if passed. An FMU of four on a bus has the source resistance `bus_resistance` [Ohm], by
        default 0. With `mixing` an FMU of four reads the demand's axes instead of its commands. Raises EmcasError, with
        the connection's name, if a variable is missing or has another unit, and for an option that the FMU lacks.
        """
        if bus_resistance is not None and not (isfinite(bus_resistance) and 0.0 <= bus_resistance <= 1.0):
            raise EmcasError(f"a bus resistance of {bus_resistance:g} Ohm: must be 0 to 1")
        with ExitStack() as stack:
            unit = stack.enter_context(opened(path))
            if guid is not None and guid.strip("{}") != unit.description.guid.strip("{}"):
                raise EmcasError(f"{path}: has GUID {unit.description.guid}, not {guid}: its interface is not "
                                 "the requested one; build the requested FMU, or leave --guid out")
            self.file, self.guid = f"{unit.description.modelName}.fmu", str(unit.description.guid)
            self.model = model_of(unit.description.modelName) or str(unit.description.modelName)
            """Model for `emcas build --model`; for another tool's FMU its modelName."""
            known = {v.name: v for v in unit.description.modelVariables}
            count = fins_of(known)
            if count > len(FINS):
                raise EmcasError(f"{path}: has {count} fins, and the rocket {len(FINS)}: {_REMEDY[True]}")
            self.whole = count > 0
            """Whether this is one FMU of four fins."""
            if not self.whole and (bus_resistance or mixing):
                raise EmcasError(f"{path}: is a single actuator, without {'mixing' if mixing else 'a shared bus'}: "
                                 f"{_REMEDY[True]}, or leave {'--mixing' if mixing else '--bus-resistance'} out")
            self.line = line_of(known)
            """The supply's input; None without one: the power is then mechanical."""
            if self.line is None and known.keys() & {_POWER[0], f"fin[1].{_POWER[0]}"}:
                raise EmcasError(f"{path}: connection source -> supply: has {_POWER[0]} and no {' or '.join(LINES)}")
            require_bus(path, self.line, bus_voltage, bus_resistance)
            groups = [[(k, f"fin[{k + 1}].") for k in range(4)]] if self.whole else [[(k, "")] for k in range(4)]
            self._path, self._mixing = path, mixing
            self._instances = [_Instance(stack, _Wiring(path, known, self.whole), unit, group, parameters, self.line,
                                         bus_resistance or 0.0, bus_voltage, mixing) for group in groups]
            self.supply = self._instances[0].supply
            """Level of the supply [V] or [Pa]; None without one."""
            self._stack = stack.pop_all()

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Return the response to one fmi2DoStep of each FMU, with the inputs held for `step` [s]."""
        if self._mixing and demand.axes is None:
            raise EmcasError("mixing by the FMU needs the axes of the demand")
        flat = flattened(demand)
        reals, flags = np.empty((4, self._instances[0].width)), np.empty(4, dtype=bool)
        try:
            levels = [instance.step(time, step, flat, reals, flags) for instance in self._instances]
        except FMICallException as error:
            raise EmcasError(f"{self._path}: refuses the step at {time:g} s ({error})") from error
        angles, rates = reals[:, 0], reals[:, 1]
        if self.line is None or self.supply is None:
            return Response(angles, rates, -float(rates @ demand.hinge_moments), flags)
        power = float(reals[:, 2].sum())
        # Each of four single actuators has the supply's level: a stiff line.
        line = (dict(zip((name for name, _ in LINES[self.line]), levels[0], strict=True)) if self.whole
                else on_line(self.line, self.supply, power))
        return Response(angles, rates, power, flags, **line)

    def close(self) -> None:
        """Terminate and free the instances, and delete the unpacked files."""
        self._stack.close()


class _Wiring:
    """The variables of an FMU, looked up for connections."""

    def __init__(self, path: Path, known: Mapping[str, Any], whole: bool) -> None:
        self._path, self._known, self._whole = path, known, whole

    def __call__(self, name: str, kind: str, unit: str | None, connection: str) -> int:
        """Return the value reference of a variable. Raises EmcasError unless it has this type and unit (None: any)."""
        label, variable = f"{self._path}: connection {connection}", self._known.get(name)
        if variable is None:
            raise EmcasError(f"{label}: has no variable {name}; {_REMEDY[self._whole]}")
        if variable.type != kind or (unit is not None and variable.unit != unit):
            raise EmcasError(f"{label}: {name} is {variable.type} in {variable.unit or 'no unit'}, not {kind} in "
                             f"{unit or 'no unit'}; {_REMEDY[self._whole]}")
        return int(variable.valueReference)


class _Instance:
    """One instance of an FMU and the fins that it moves."""

    def __init__(self, stack: ExitStack, wire: _Wiring, unit: Any, fins: Sequence[tuple[int, str]],
                 parameters: Mapping[str, bool | float], line: str | None, bus_resistance: float,
                 bus_voltage: float | None, mixing: bool) -> None:
        self._fins = [fin for fin, _ in fins]
        sources = {wire(prefix + name, "Real", si, f"{origin} -> {prefix}{name}"): index + fin
                   for fin, prefix in fins for origin, name, si, index in OWN_INPUTS
                   if not (mixing and name == "fin_command")}
        sources |= {wire(name, "Real", si, f"{origin} -> {name}"): index
                    for origin, name, si, index in (*SHARED_INPUTS, *(_MIXING if mixing else ()))}
        self._inputs, self._sources = list(sources), np.array(list(sources.values()))
        self._outputs = [wire(prefix + name, "Real", si, f"{prefix}{name} -> rocket")
                         for _, prefix in fins for name, si in (OUTPUTS if line else _MOVED)]
        self.width = len(self._outputs) // len(fins)
        """Number of Real outputs of a fin."""
        self._flags = [wire(prefix + FLAG, "Boolean", None, f"{prefix}{FLAG} -> figures") for _, prefix in fins]
        reals, flags = {}, {}
        for fin, prefix in fins:
            reals[wire(prefix + _AZIMUTH, "Real", "rad", f"layout -> {prefix}{_AZIMUTH}")] = float(AZIMUTHS[fin])
            for name, value in parameters.items():
                if isinstance(value, bool):
                    flags[wire(prefix + name, "Boolean", None, f"setting -> {prefix}{name}")] = value
                else:
                    reals[wire(prefix + name, "Real", None, f"setting -> {prefix}{name}")] = value
        supply = wire(line, "Real", LINES[line][0][1], f"source -> {line}") if line else None
        if line and len(fins) > 1:
            self._outputs += [wire(name, "Real", si, f"{name} -> figures") for name, si in LINES[line]]
            if line == VOLTAGE:
                reals[wire(_RESISTANCE, "Real", "Ohm", f"setting -> {_RESISTANCE}")] = bus_resistance
        if supply is not None and bus_voltage is not None:
            reals[supply] = require_supply(unit.path, VOLTAGE, bus_voltage)
        try:
            self._slave = slave = instantiate_fmu(str(unit.folder), unit.description, "CoSimulation")
            stack.callback(slave.freeInstance)
            slave.setupExperiment(startTime=0.0)
            slave.setReal(list(reals), list(reals.values()))
            slave.setBoolean(list(flags), list(flags.values()))
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            stack.callback(slave.terminate)
            level = None if supply is None else float(slave.getReal([supply])[0])
        # fmpy reports a failed load or instantiation as OSError or as a bare Exception.
        except Exception as error:
            raise EmcasError(f"{unit.path}: does not start ({error})") from error
        self.supply = None if line is None or level is None else require_supply(unit.path, line, level)

    def step(self, time: float, step: float, flat: Array, reals: Array, flags: Array) -> list[float]:
        """Step, write the outputs to the rows of the fins, and return level and current or flow of the line, if any."""
        self._slave.setReal(self._inputs, flat[self._sources].tolist())
        self._slave.doStep(currentCommunicationPoint=time, communicationStepSize=step)
        outputs = self._slave.getReal(self._outputs)
        of_fins = len(self._fins) * self.width
        reals[self._fins] = np.reshape(outputs[:of_fins], (len(self._fins), -1))
        flags[self._fins] = np.array(self._slave.getBoolean(self._flags), dtype=bool)
        return list(outputs[of_fins:])

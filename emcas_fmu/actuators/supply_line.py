"""The supplies that several fins may share: a voltage bus, or a pressure line.

The last parameter of a line is its update time: at this interval its states are updated. If the first parameter is 0,
the line is stiff: each fin has the source's voltage or pressure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from inspect import signature
from types import ModuleType
from typing import Any

from ..errors import EmcasError
from ..namespace import namespace
from ..ops.base import Ops, Value
from ..ops.floats import FLOATS
from ..physics import bus, pressure_line
from ..rules import SLACK, Rule, check_rules, rule, when
from ..variables import Variable, parameter, real_input, real_output


@dataclass(frozen=True)
class SupplyLine:
    """A kind of line: its parameters, outputs and equations for several actuators.

    `level(ops, source, *states)` returns the voltage [V] or pressure [Pa] at the actuators; `following(ops, p, source,
    states, flow, mean, inverse_inductance, keeps_power)` returns the states after an update. `p` are the parameters of
    the group, `flow` is the current [A] or flow [m3/s] to all actuators from now on, `mean` its mean since the last
    update (equal to `flow` unless actuators have a `course`), `inverse_inductance` the sum of :meth:`Supply.within`
    [1/H]. `keeps_power` is true if the supply's input is in `without_effect` of the actuator's declaration.
    """

    name: str  # in messages
    group: str  # of its parameters; also the name of its terminal
    supply: str  # description of the terminal
    source: str  # description of the fins' common input
    power: str  # description of the output of the power that all fins consume
    outputs: tuple[Variable, Variable]  # the level at the actuators, and their total current or flow
    parameters: tuple[Variable, ...]
    values: Mapping[str, float]  # defaults of the parameters
    states: tuple[str, ...]
    start: Callable[[Ops, Any], tuple[Value, ...]]  # start values of the states, from the parameters of the group
    sags: bool  # whether the first state is a sag below the source, also while the source ramps
    level: Callable[..., Value]
    following: Callable[..., tuple[Value, ...]]
    equations: ModuleType
    rules: tuple[Rule, ...] = ()  # for its parameters

    def broken_rules(self, values: Mapping[str, float], warnings: bool = False) -> list[str]:
        """Return a message for each broken rule that refuses parameters, or with `warnings` for each that only warns.

        Parameters that are not in `values` [SI] have their defaults; all values must be within their limits.
        """
        p = namespace({**self.values, **values})
        return check_rules([(partial(one.check, FLOATS, p), *one[1:]) for one in self.rules], warnings)


def drawn(ops: Ops, power: Value, level: Value) -> Value:
    """Return the current [A] or flow [m3/s] of a power [W] at a `level` [V or Pa]; 0 unless the level is above 0."""
    return ops.branch(level > 0.0, lambda: (power / level,), lambda: (0.0,))[0]


@rule("bus.charge_used = %.6g A.s must be at most bus.charge = %.6g A.s")
def used_within_charge(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    charge, used = p.bus.charge, p.bus.charge_used
    return when(ops, ops.both(charge > 0.0, used > charge * (1.0 + SLACK))), used, charge


@rule("bus.charge = %.6g A.s and bus.capacitance = %.6g F have no effect at bus.source_resistance = 0: raise this "
      "resistance", warning=True)
def fed_through_resistance(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    charge, capacitance = p.bus.charge, p.bus.capacitance
    unused = ops.both(p.bus.source_resistance <= 0.0, charge + capacitance > 0.0)
    return when(ops, unused), charge, capacitance


BUS = SupplyLine(
    name="bus",
    group="bus",
    supply="electrical supply",
    source="voltage of the bus's source",
    power="electrical power from the bus to all drives (with DC links its mean over the last update); negative while "
          "regenerating",
    outputs=(
        real_output("bus_voltage", "V", "voltage at the drives: the source's less the sag, or that of the common DC "
                    "link", 30.0, minimum=0.0),
        real_output("bus_current", "A", "current from the bus to all drives (with DC links its mean over the last "
                    "update); negative while regenerating", 30.0)),
    parameters=(
        parameter("bus.source_resistance", "Ohm", 0.0, 1.0,
                  "resistance between supply_voltage and the drives (0: stiff bus)"),
        parameter("bus.charge", "A.s", 0.0, 1e7, "charge of the full battery (0: unlimited)"),
        parameter("bus.charge_used", "A.s", 0.0, 1e7, "charge that the battery has lost before the start"),
        parameter("bus.polarisation", "V", 0.0, 100.0,
                  "fall of the battery's open-circuit voltage when half of its charge is used"),
        parameter("bus.capacitance", "F", 0.0, 10.0, "capacitance of the common DC link, behind a diode (0: no link, "
                  "the source absorbs returned power)"),
        parameter("bus.chopper_voltage", "V", 1.0, 1e5,
                  "voltage of the DC link above which its brake chopper conducts (1e5: never)"),
        parameter("bus.chopper_resistance", "Ohm", 1e-3, 1e6, "resistance of the brake chopper"),
        parameter("bus.update_time", "s", 1e-5, 1e-2, "interval between two updates of the bus voltage", display="ms")),
    # A value of 0, for the chopper_voltage 1e5 V, leaves the component out; the other values are estimates.
    values={"bus.source_resistance": 0.0, "bus.charge": 0.0, "bus.charge_used": 0.0, "bus.polarisation": 0.5,
            "bus.capacitance": 0.0, "bus.chopper_voltage": 1e5, "bus.chopper_resistance": 1.0, "bus.update_time": 1e-4},
    states=("sag", "link", "drawn"),
    start=bus.start,
    sags=True,
    level=bus.voltage,
    following=bus.following,
    equations=bus,
    rules=(used_within_charge, fed_through_resistance),
)
PRESSURE_LINE = SupplyLine(
    name="pressure line",
    group="line",
    supply="hydraulic supply",
    source="absolute pressure to which the pump's regulator is set",
    power="hydraulic power from the line to all actuators; negative while they return oil",
    outputs=(
        real_output("line_pressure", "Pa", "absolute pressure at the actuators", 1e7, minimum=0.0),
        real_output("line_flow", "m3/s", "flow from the line to all actuators; negative while they return oil", 1e-4)),
    parameters=(
        parameter("line.accumulator_volume", "m3", 0.0, 1.0,
                  "gas volume of the accumulator without oil (0: stiff line, the actuators get supply_pressure)"),
        parameter("line.precharge_pressure", "Pa", 1e4, 1e8,
                  "absolute gas pressure of the accumulator without oil; 12.6 MPa is an estimate"),
        parameter("line.polytropic_exponent", "1", 1.0, 3.0,
                  "polytropic exponent of the gas: 1 at constant temperature; 1.4, without heat flow, is an estimate"),
        parameter("line.pump_gain", "m3/(s.Pa)", 0.0, 1e-6,
                  "flow of the pump per pressure below its setting; 1.5e-10 is an estimate"),
        parameter("line.pump_flow", "m3/s", 0.0, 1.0, "largest flow of the pump; 1.5e-4 is an estimate"),
        parameter("line.update_time", "s", 1e-5, 1e-2, "interval between two updates of the line pressure",
                  display="ms")),
    # Estimates: a precharge of 0.6 times 21 MPa; a pump that delivers its 9 l/min from 1 MPa below its setting.
    values={"line.accumulator_volume": 0.0, "line.precharge_pressure": 12.6e6, "line.polytropic_exponent": 1.4,
            "line.pump_gain": 1.5e-10, "line.pump_flow": 1.5e-4, "line.update_time": 1e-4},
    states=("pressure",),
    start=lambda ops, p: (pressure_line.AT_SOURCE,),
    sags=False,
    level=pressure_line.pressure,
    following=lambda ops, p, source, states, flow, *_: (pressure_line.next_pressure(ops, p, source, states[0], flow),),
    equations=pressure_line,
)
LINES: Mapping[str, SupplyLine] = {"V": BUS, "Pa": PRESSURE_LINE}
"""The kinds of line by the unit of the supply's input."""


@dataclass(frozen=True)
class Supply:
    """Supply of an actuator: its input, its power, and the actuator's load on a line that feeds several fins.

    The unit of `input` chooses the kind of line (:data:`LINES`); `power` is the output of the power [W] from the line.
    For a bus, `inverse_inductance(ops, p)` returns 1/L [1/H] of the circuit at the bus voltage, 0 if the current does
    not follow this voltage; with a third argument `interval` [s] it returns the effective value within that time, which
    is 1/(R interval) for a winding with the resistance R and without inductance. An actuator that stores charge
    has a `course(ops, p, x, current, before, interval)`. It returns the charge [A.s] consumed from the start to the
    states `x`, and the mean current [A] of the next interval [s] at the same voltage; `current` [A] is the present
    one, `before` the charge [A.s] an interval ago.

    Raises EmcasError if the input is not in V or Pa, the power is not supply_power [W], or inverse_inductance has
    other arguments.
    """

    input: Variable
    power: Variable
    inverse_inductance: Callable[..., Value] = lambda ops, p: 0.0
    course: Callable[[Ops, Any, Any, Value, Value, Value], tuple[Value, Value]] | None = None

    def __post_init__(self) -> None:
        if self.input.kind != "Real" or self.input.unit not in LINES:
            raise EmcasError(f"supply {self.input.name} [{self.input.unit}]: a supply is a voltage [V] or a pressure "
                             "[Pa]; declare other inputs in further_inputs")
        if (self.power.name, self.power.unit) != ("supply_power", "W"):
            raise EmcasError(f"supply {self.input.name}: its power is {self.power.name} [{self.power.unit}]; declare "
                             "supply_power [W]")
        if (count := len(signature(self.inverse_inductance).parameters)) not in (2, 3):
            raise EmcasError(f"supply {self.input.name}: inverse_inductance has {count} argument{'s'[:count != 1]}; "
                             "write a function of (ops, p) or of (ops, p, interval)")

    @classmethod
    def voltage(cls, key: str = "drive.supply_voltage", description: str = "supply voltage",
                inverse_inductance: Callable[..., Value] = lambda ops, p: 0.0) -> Supply:
        """Return a supply with the input supply_voltage [V]; its start value is the parameter-file entry `key`."""
        return cls(real_input("supply_voltage", "V", description, minimum=0.0, maximum=1000.0, nominal=10.0, start=None,
                              key=key),
                   real_output("supply_power", "W", "electrical power from the supply; negative while regenerating",
                               100.0), inverse_inductance)

    @classmethod
    def pressure(cls, key: str, description: str = "supply pressure") -> Supply:
        """Return a supply with the input supply_pressure [Pa]; its start value is the parameter-file entry `key`."""
        return cls(real_input("supply_pressure", "Pa", description, minimum=0.0, maximum=1e9, nominal=1e7, start=None,
                              key=key),
                   real_output("supply_power", "W", "supply pressure times the volume flow from it", 1000.0))

    def within(self, ops: Ops, p: Any, interval: Value) -> Value:
        """Return the effective 1/L [1/H] of the actuator's circuit within an interval [s]."""
        third = (interval,) if len(signature(self.inverse_inductance).parameters) == 3 else ()
        return self.inverse_inductance(ops, p, *third)

    @property
    def line(self) -> SupplyLine:
        """The kind of line that may feed several of these actuators."""
        return LINES[self.input.unit]

"""The supplies that several fins may share: a voltage bus, or a pressure line.

A line is stepped every update time, its last parameter, and constant in between. If its first parameter is 0, it is
stiff: it is not stepped, and each fin has the source's voltage or pressure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
class Line:
    """A kind of line: its parameters, outputs and equations for several actuators.

    `level(ops, source, *states)` returns the actuators' voltage [V] or pressure [Pa]; `following(ops, p, source,
    states, drawn, mean, inverse_inductance)` returns the next states, from the parameters `p` of the group, the current
    [A] or flow [m3/s] that all actuators draw from now on, its mean since the last instant (the same but for actuators
    with a `course`), and the sum of their :meth:`Supply.within`.
    """

    name: str  # in messages
    group: str  # of its parameters; the name of its terminal
    supply: str  # description of the terminal
    source: str  # descriptions of the fins' common input and of the power that they draw together
    power: str
    outputs: tuple[Variable, Variable]  # the actuators' level, and their total current or flow
    parameters: tuple[Variable, ...]
    values: Mapping[str, float]  # defaults of the parameters
    states: tuple[str, ...]
    start: Callable[[Ops, Any], tuple[Value, ...]]  # of the states, from the parameters of the group
    sags: bool  # whether the level is the source's minus the first state: it then follows a ramp of the source
    level: Callable[..., Value]
    following: Callable[[Ops, Any, Value, Sequence[Value], Value, Value, Value], tuple[Value, ...]]
    equations: ModuleType
    rules: tuple[Rule, ...] = ()  # for its parameters

    def broken_rules(self, values: Mapping[str, float], warnings: bool = False) -> list[str]:
        """Return the messages of rules that values within their limits break, beside defaults; or of the `warnings`."""
        p = namespace({**self.values, **values})
        return check_rules([(partial(one.check, FLOATS, p), *one[1:]) for one in self.rules], warnings)


def drawn(ops: Ops, power: Value, level: Value) -> Value:
    """Return the current [A] or flow [m3/s] of a power [W] at a voltage [V] or pressure [Pa]; 0 at 0."""
    return ops.branch(level > 0.0, lambda: (power / level,), lambda: (0.0,))[0]


@rule("bus.charge_used = %.6g A.s must be at most bus.charge = %.6g A.s")
def used_within_charge(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """No more is used than the battery had; an unlimited one has no charge."""
    charge, used = p.bus.charge, p.bus.charge_used
    return when(ops, ops.both(charge > 0.0, used > charge * (1.0 + SLACK))), used, charge


@rule("bus.charge = %.6g A.s and bus.capacitance = %.6g F have no effect at bus.source_resistance = 0: raise this "
      "resistance", warning=True)
def fed_through_resistance(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """A stiff bus has the source's voltage, whatever battery and link."""
    charge, capacitance = p.bus.charge, p.bus.capacitance
    unused = ops.both(p.bus.source_resistance <= 0.0, charge + capacitance > 0.0)
    return when(ops, unused), charge, capacitance


BUS = Line(
    name="bus",
    group="bus",
    supply="electrical supply",
    source="voltage of the source of the bus",
    power="electrical power drawn by all drives, its mean over the last update if they have DC links; negative while "
          "regenerating",
    outputs=(
        real_output("bus_voltage", "V", "voltage at the drives: the supply's less the sag", 30.0, minimum=0.0),
        real_output("bus_current", "A", "current all drives draw, its mean over the last update if they have DC links; "
                    "negative while regenerating", 30.0)),
    parameters=(
        parameter("bus.source_resistance", "Ohm", 0.0, 1.0,
                  "resistance between supply_voltage and the drives (0: stiff)"),
        parameter("bus.charge", "A.s", 0.0, 1e7, "charge of the full battery (0: unlimited)"),
        parameter("bus.charge_used", "A.s", 0.0, 1e7, "charge that has been drawn before the start"),
        parameter("bus.polarisation", "V", 0.0, 100.0,
                  "fall of the battery's open-circuit voltage where half of its charge is drawn"),
        parameter("bus.capacitance", "F", 0.0, 10.0, "capacitance of the common DC link, behind a diode (0: none, the "
                  "source absorbs returned power)"),
        parameter("bus.chopper_voltage", "V", 1.0, 1e5,
                  "voltage of the DC link above which its brake chopper conducts (out of reach: none)"),
        parameter("bus.chopper_resistance", "Ohm", 1e-3, 1e6, "resistor of that chopper"),
        parameter("bus.update_time", "s", 1e-5, 1e-2, "interval at which the sag follows the drives' current",
                  display="ms")),
    # All but the resistance are estimates: of a battery that empties, of a link that overcharges.
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
PRESSURE_LINE = Line(
    name="pressure line",
    group="line",
    supply="hydraulic supply",
    source="pressure that the pump's regulator is set to, absolute",
    power="hydraulic power drawn by all actuators; negative while they return oil",
    outputs=(
        real_output("line_pressure", "Pa", "pressure at the actuators, absolute", 1e7, minimum=0.0),
        real_output("line_flow", "m3/s", "flow all actuators draw; negative while they return oil", 1e-4)),
    parameters=(
        parameter("line.accumulator_volume", "m3", 0.0, 1.0,
                  "gas in the accumulator without oil (0: stiff, the actuators get supply_pressure)"),
        parameter("line.precharge_pressure", "Pa", 1e4, 1e8, "of that gas, absolute; 12.6 MPa is an estimate"),
        parameter("line.polytropic_exponent", "1", 1.0, 3.0,
                  "of the gas: 1 where it keeps its temperature; 1.4, without heat flow, is an estimate"),
        parameter("line.pump_gain", "m3/(s.Pa)", 0.0, 1e-6,
                  "flow of the pump for a pressure below its setting; 1.5e-10 is an estimate"),
        parameter("line.pump_flow", "m3/s", 0.0, 1.0, "largest flow of the pump; 1.5e-4 is an estimate"),
        parameter("line.update_time", "s", 1e-5, 1e-2, "interval at which the pressure follows the actuators' flow",
                  display="ms")),
    # Estimates: a precharge of 0.6 of 21 MPa; a pump of 9 l/min, all of it 1 MPa below its setting.
    values={"line.accumulator_volume": 0.0, "line.precharge_pressure": 12.6e6, "line.polytropic_exponent": 1.4,
            "line.pump_gain": 1.5e-10, "line.pump_flow": 1.5e-4, "line.update_time": 1e-4},
    states=("pressure",),
    start=lambda ops, p: (pressure_line.AT_SOURCE,),
    sags=False,
    level=pressure_line.pressure,
    following=lambda ops, p, source, states, flow, mean, inverse_inductance: (pressure_line.next_pressure(
        ops, p, source, states[0], flow),),
    equations=pressure_line,
)
LINES: Mapping[str, Line] = {"V": BUS, "Pa": PRESSURE_LINE}
"""The kinds of line by the unit of the supply's input."""


@dataclass(frozen=True)
class Supply:
    """What feeds the actuator: its input, and how the actuator loads a line that feeds several fins.

    The input's unit chooses the kind of line (:data:`LINES`). `power` is the output of the power drawn [W]. For a
    bus, `inverse_inductance(ops, p)` is 1/L [1/H] of the circuit that its voltage drives, 0 if the current follows at
    once; `inverse_inductance(ops, p, interval)` is its effective value within an interval [s]. An actuator that stores
    charge has a `course(ops, p, x, current, before, interval)`: the charge [A.s] that it has drawn since the start, in
    its states `x`, and the mean current [A] that it will draw in the next interval at the same voltage, from its
    `current` now and its charge an interval `before`.
    """

    input: Variable
    power: Variable
    inverse_inductance: Callable[..., Value] = lambda ops, p: 0.0
    course: Callable[[Ops, Any, Any, Value, Value, Value], tuple[Value, Value]] | None = None

    def __post_init__(self) -> None:
        if self.input.kind != "Real" or self.input.unit not in LINES:
            raise EmcasError(f"supply {self.input.name} [{self.input.unit}]: the line that feeds an actuator is one of "
                             "voltage [V] or of pressure [Pa]; declare another input among further_inputs")
        if (self.power.name, self.power.unit) != ("supply_power", "W"):
            raise EmcasError(f"supply {self.input.name}: its power is called {self.power.name} [{self.power.unit}]; "
                             "every actuator's is supply_power [W]")
        if (count := len(signature(self.inverse_inductance).parameters)) not in (2, 3):
            raise EmcasError(f"supply {self.input.name}: inverse_inductance has {count} argument{'s'[:count != 1]}; "
                             "give a function of (ops, p) or of (ops, p, interval)")

    @classmethod
    def voltage(cls, key: str = "drive.supply_voltage", description: str = "supply voltage",
                inverse_inductance: Callable[..., Value] = lambda ops, p: 0.0) -> Supply:
        """Return a supply with the input supply_voltage [V], whose start value is the entry `key`."""
        return cls(real_input("supply_voltage", "V", description, minimum=0.0, maximum=1000.0, nominal=10.0, start=None,
                              key=key),
                   real_output("supply_power", "W", "electrical power from the supply; negative while regenerating",
                               100.0), inverse_inductance)

    @classmethod
    def pressure(cls, key: str, description: str = "supply pressure") -> Supply:
        """Return a supply with the input supply_pressure [Pa], whose start value is the entry `key`."""
        return cls(real_input("supply_pressure", "Pa", description, minimum=0.0, maximum=1e9, nominal=1e7, start=None,
                              key=key),
                   real_output("supply_power", "W", "supply pressure times the volume flow from it", 1000.0))

    def within(self, ops: Ops, p: Any, interval: Value) -> Value:
        """Return the effective 1/L [1/H] within an interval [s]."""
        within = (interval,) if len(signature(self.inverse_inductance).parameters) == 3 else ()
        return self.inverse_inductance(ops, p, *within)

    @property
    def line(self) -> Line:
        """The kind of line."""
        return LINES[self.input.unit]

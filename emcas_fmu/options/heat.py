"""Heat: winding and case get warm, resistance and torque constant follow, the drive folds its current back (I2t).

The equations are :mod:`emcas_fmu.physics.heat`'s. Over a step the motor is that of the temperatures at its middle,
which the current at its start leads to, and the heat is what the current's own equation loses in that resistance: of
second order. The current limit errs to the safe side instead, by less than a tick of its folding back. The controllers
do not know of any of it: friction compensation keeps the torque constant it was told.

The mean of i^2 follows the course :mod:`emcas_fmu.integrate` gives the current between the ends of a step, an
exponential. Models that wire another current loop from it (linear, ristanovic, ozkan) have the same ends and a
course a little different from it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators.model import Asked, Model, Sampled, Shown, State, Values, split
from ..integrate import Boundary, Plant, electrical_mode
from ..ops.base import Ops, Value
from ..physics import heat
from ..tree import changed
from ..variables import Variable

TITLE = "motor heat and I2t limit"
_CURRENT = "motor current"  # third of every plant that has one, as of integrate.Plant
_OWN = ("winding temperature", "case temperature", "I2t load")


def _parameter(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"heat.{name}", "Real", "parameter", "fixed", unit, description, minimum, maximum)


def _output(name: str, unit: str, description: str, nominal: float) -> Variable:
    return Variable(name, "Real", "output", "continuous", unit, description, nominal=nominal)


PARAMETERS = (
    _parameter("winding_capacity", "J/K", 1e-2, 1e6, "heat capacity of the winding"),
    _parameter("case_capacity", "J/K", 1e-2, 1e7, "heat capacity of the case with stator iron and magnets"),
    _parameter("winding_to_case", "K/W", 1e-4, 1e4, "thermal resistance between winding and case"),
    _parameter("case_to_ambient", "K/W", 1e-4, 1e4, "thermal resistance between case and ambient "
               "(friction.temperature)"),
    _parameter("winding_start_rise", "K", -100.0, 250.0, "winding temperature at the start above ambient"),
    _parameter("case_start_rise", "K", -100.0, 250.0, "case temperature at the start above ambient"),
    _parameter("reference_temperature", "degC", -100.0, 200.0, "temperature that resistance and constants of motor.* "
               "are told for"),
    _parameter("resistance_coefficient", "1/K", 0.0, 0.01, "rise of the winding resistance with its temperature"),
    _parameter("torque_coefficient", "1/K", -0.01, 0.0, "change of torque and back-EMF constant with the case "
               "temperature (magnets)"),
    _parameter("winding_limit", "degC", -100.0, 400.0, "largest winding temperature, for the torque-speed envelope: "
               "nothing acts on it in the simulation"),
    _parameter("continuous_current", "A", 1e-3, 1e4, "current the drive allows for any time (I2t); that and above "
               "drive.current_limit: no I2t limit"),
    _parameter("peak_time", "s", 0.05, 1e4, "time for which I2t allows drive.current_limit, from rest"),
)
OUTPUTS = (
    _output("winding_temperature", "degC", "winding temperature", 100.0),
    _output("case_temperature", "degC", "case temperature", 100.0),
    _output("i2t_load", "1", "share of the I2t budget that is spent; the current limit folds back from "
            f"{heat.FOLDING:g} to 1", 1.0),
    _output("current_limit", "A", "limit of the current reference that I2t, and a derated drive, leaves", 10.0),
)


def unfit(model: str, options: tuple[str, ...]) -> str:
    """Why it cannot be laid over a model; nothing if it can."""
    from ..actuators import get

    return "" if _CURRENT in get(model).plant else "needs a motor current: this model has none"


def _followed(ops: Ops, p: Any, winding: Value, case: Value, load: Value) -> Any:
    return changed(heat.at_temperatures(ops, p, winding, case),
                   {"drive.current_limit": heat.current_limit(ops, p, load)})


def _through(ops: Ops, p: Any, own: Values, current: Value, h: Value) -> Any:
    """Parameters through a step of `h` [s] that starts with a current [A].

    Temperatures are those of its middle. The limit is that of its end if all of the limit at its start flowed: so the
    reference is never above what the limit is at any time of the step.
    """
    winding, case, load = own
    loss = heat.resistance(ops, p, winding) * current * current
    most = heat.current_limit(ops, p, load)
    later = ops.maximum(load, heat.loaded(ops, p, load, most * most, h))
    return _followed(ops, p, *heat.warmed(p, winding, case, loss, 0.5 * h), later)


def extended(inner: Model) -> Model:
    """`inner` with heat."""
    count = len(_OWN)

    def initial(ops: Ops, p: Any) -> tuple[State, Value]:
        state, measured = inner.initial(ops, p)
        ambient = p.friction.temperature
        own = (ambient + p.heat.winding_start_rise, ambient + p.heat.case_start_rise, 0.0)
        return state._replace(plant=(*state.plant, *own)), measured

    def sample(ops: Ops, p: Any, s: State, a: Asked) -> Sampled:
        return inner.sample(ops, p, s._replace(plant=split(s.plant, count)[0]), a)

    def step(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, h: Value) -> tuple[Values, Value]:
        plant, own = split(plant, count)
        s = Plant(*plant[:4])
        current = ops.where(b.enabled, s.current, 0.0)  # a disabled drive's bridge is open
        q = _through(ops, p, own, current, h)
        moved, used = inner.step(ops, q, plant, held, b, h)
        tau = electrical_mode(ops, q, s, b).tau
        square = heat.mean_square(ops, current, Plant(*moved[:4]).current, used / tau)
        winding, case, load = own
        warmed = heat.warmed(p, winding, case, q.motor.resistance * square, used)
        return (*moved, *warmed, heat.loaded(ops, p, load, square, used)), used

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, s: Shown) -> Values:
        plant, (winding, case, load) = split(plant, count)
        q = _followed(ops, p, winding, case, load)
        return *inner.put_out(ops, q, plant, held, b, s), winding, case, load, q.drive.current_limit

    return replace(inner, plant=inner.plant + _OWN, initial=initial, sample=sample, step=step, put_out=put_out,
                   parameters=inner.parameters + PARAMETERS, outputs=inner.outputs + OUTPUTS)

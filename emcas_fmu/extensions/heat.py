"""Heat: temperatures of winding and case, which change the motor's resistance and constants, and the drive's I2t limit.

The equations are those of :mod:`emcas_fmu.physics.heat`. During a step the motor has the temperatures at mid-step,
predicted from the current at the start; the heat is the loss in the resistance at that temperature. The error of both
is of second order in the tick. The current limit errs to the safe side, by less than its change in one tick. The
controllers do not know the temperatures: friction compensation uses the torque constant of the parameters.

The mean of i^2 is that of an exponential course of the current between the ends of a step
(:mod:`emcas_fmu.steppers.rigid`), or of a constant current with an ideal current loop. If the motor is not stepped by
these equations, the course is a line: the error is also of second order if the tick is short compared with the
winding's time constant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..physics import heat
from ..variables import in_group, parameter, real_output, tunable
from .currents import flowing, lossy_resistance, mean_square
from .declaration import Extension, also_read

STATES = (State("winding_temperature", "degC"), State("case_temperature", "degC"))
I2T_LOAD = State("i2t_load", "1")

PARAMETERS = in_group(
    "heat",
    parameter("winding_capacity", "J/K", 1e-2, 1e6, "heat capacity of the winding",
              sheet="motor: heat capacity of the winding, its time constant over its thermal resistance"),
    parameter("case_capacity", "J/K", 1e-2, 1e7, "heat capacity of the case with stator iron and magnets",
              sheet="motor: heat capacity of the case, its time constant over its thermal resistance"),
    parameter("winding_to_case", "K/W", 1e-4, 1e4, "thermal resistance between winding and case",
              sheet="motor: thermal resistance, winding to case"),
    parameter("case_to_ambient", "K/W", 1e-4, 1e4, "thermal resistance between case and ambient "
              "(friction.temperature)", sheet="motor: thermal resistance, case to ambient"),
    parameter("winding_start_rise", "K", -100.0, 250.0, "winding temperature at the start above ambient"),
    parameter("case_start_rise", "K", -100.0, 250.0, "case temperature at the start above ambient"),
    parameter("reference_temperature", "degC", -100.0, 200.0, "temperature at which resistance and constants of "
              "motor.* apply"),
    parameter("resistance_coefficient", "1/K", 0.0, 0.01, "rise of the winding resistance with its temperature"),
    parameter("torque_coefficient", "1/K", -0.01, 0.0, "change of torque and back-EMF constant with the case "
              "temperature (magnets)"),
    parameter("winding_limit", "degC", -100.0, 400.0, "largest winding temperature, for the torque-speed envelope; "
              "it has no effect in the simulation", sheet="motor: permitted winding temperature"),
)
AMBIENT = replace(tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature"), start=24.0)
"""The ambient temperature, for an actuator that does not declare one."""
I2T_PARAMETERS = in_group(
    "heat",
    parameter("continuous_current", "A", 1e-3, 1e4, "current that the drive allows indefinitely (I2t); at or above "
              "drive.current_limit: no I2t limit",
              sheet="drive: continuous (rated) current, or the motor's if that is less"),
    parameter("peak_time", "s", 0.05, 1e4, "time for which I2t allows drive.current_limit after zero current",
              sheet="drive: time at peak current"),
)
OUTPUTS = (
    real_output("winding_temperature", "degC", "winding temperature", 100.0),
    real_output("case_temperature", "degC", "case temperature", 100.0),
)
I2T_OUTPUTS = (
    real_output("i2t_load", "1", "used share of the I2t budget; from "
            f"{heat.FOLDING:g} on the current limit is reduced", 1.0, minimum=0.0),
    real_output("current_limit", "A", "limit of the current reference, reduced by I2t and by a derated drive", 30.0,
                minimum=0.0, limited_by=("drive.current_limit",)),
)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with heat and, if its drive has a current limit, with the I2t limit."""
    limits = capabilities.CURRENT_LIMIT in actuator.provides
    ambient = () if capabilities.AMBIENT_TEMPERATURE in actuator.provides else (AMBIENT,)

    def at(ops: Ops, p: Any, u: PlantInputs, winding: Value, case: Value, load: Value) -> Any:
        warm = heat.at_temperatures(ops, p, winding, case)
        return warm if not limits else with_values(
            warm, {"drive.current_limit": heat.current_limit(ops, p, load, u.rated_current_limit)})

    def through(ops: Ops, p: Any, x: Record, u: PlantInputs, current: Value, h: Value) -> Any:
        """Return the parameters for a step of `h` [s] that starts with a current [A].

        Temperatures are those at mid-step. The current limit is the one that would hold at the end of the step if the
        current were at the limit throughout, so that the reference never exceeds the limit.
        """
        winding, case, later = x.winding_temperature, x.case_temperature, None
        loss = heat.resistance(ops, p, winding) * current * current
        if limits:
            load, rated = x.i2t_load, u.rated_current_limit
            most = heat.current_limit(ops, p, load, rated)
            later = ops.maximum(load, heat.loaded(ops, p, load, most * most, h, rated))
        return at(ops, p, u, *heat.warmed(ops, p, winding, case, loss, 0.5 * h), later)

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        begun, ambient = actuator.initial(ops, p, start), p.friction.temperature
        return {**begun, "winding_temperature": ambient + p.heat.winding_start_rise,
                "case_temperature": ambient + p.heat.case_start_rise}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        """Return the result of a sample of the controllers; their anti-windup uses the present current limit."""
        limit = heat.current_limit(ops, p, x.i2t_load)
        return actuator.sample(ops, with_values(p, {"drive.current_limit": limit}), x, inputs)

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        current = flowing(ops, actuator, p, x, u)
        q = through(ops, p, x, u, current, h)
        moved, used = actuator.step(ops, q, x, u, h)
        square = mean_square(ops, actuator, q, x, u, h, moved, used)
        loss = lossy_resistance(ops, actuator, q, x, u) * square
        winding, case = heat.warmed(ops, p, x.winding_temperature, x.case_temperature, loss, used)
        moved = {**moved, "winding_temperature": winding, "case_temperature": case}
        if limits:
            moved["i2t_load"] = heat.loaded(ops, p, x.i2t_load, square, used, u.rated_current_limit)
        return moved, used

    def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return d/dt of the states at constant temperatures, which change over seconds only."""
        return actuator.rates(ops, heat.at_temperatures(ops, p, x.winding_temperature, x.case_temperature), x, u)

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        load = x.i2t_load if limits else None
        q = at(ops, p, u, x.winding_temperature, x.case_temperature, load)
        outputs = {**actuator.output_values(ops, q, x, u), "winding_temperature": x.winding_temperature,
                   "case_temperature": x.case_temperature}
        return {**outputs, "i2t_load": load, "current_limit": q.drive.current_limit} if limits else outputs

    return replace(
        actuator, states=(*actuator.states, *STATES, *((I2T_LOAD,) if limits else ())),
        outputs=actuator.outputs + (OUTPUTS + I2T_OUTPUTS if limits else OUTPUTS),
        controllers_read=also_read(actuator, I2T_LOAD.name) if limits else actuator.controllers_read,
        parameters=(*actuator.parameters, *ambient), provides=actuator.provides | {capabilities.AMBIENT_TEMPERATURE},
        initial=initial,
        sample=sample if limits else actuator.sample, derivatives=derivatives if actuator.derivatives else None,
        step=step, output_values=output_values)


EXTENSION = Extension(
    "heat", "motor heat and I2t limit", extend, needs=(capabilities.MOTOR_CURRENT,),
    parameters=lambda actuator: (*PARAMETERS, *(
        I2T_PARAMETERS if capabilities.CURRENT_LIMIT in actuator.provides else ())))

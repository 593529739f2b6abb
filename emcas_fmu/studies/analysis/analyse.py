"""The analysis of a parameter set: linear models, margins, locus, steps, sweeps, natural frequencies, capability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, isfinite
from pathlib import Path
from typing import Any

from ...actuators import capabilities, get, get_extension, parts
from ...bench.frequency_response import FrequencyResponse
from ...bench.linear import frequency
from ...bench.linear.actuator import LinearActuator, sound
from ...bench.linear.systems import ROUNDING, Array, System, cleared, decays, largest_pole, reaches
from ...bench.requirements import load_requirements
from ...bench.runs import Columns
from ...bench.subject import ParameterSubject
from ...errors import EmcasError
from ...parameters import ParameterSet
from ...reference.linear import obstacle
from ...support.progress import Progress, silent
from . import capability, final_values, locus, steps, sweep, thesis
from .modes import load_rod, modes_at, thesis_modes

_SWEPT = 3.0  # highest frequency of the amplitude sweep, as a multiple of the larger linear bandwidth
_STEPS = 7  # number of steps in the progress display
# Title and required capabilities of each section that not every actuator has.
SECTIONS = {
    "thesis_linear": ("the thesis's linear model", (
        capabilities.SCREW_AND_LEVER, capabilities.CASCADE, capabilities.CURRENT_LOOP, capabilities.RIGID_DRIVE_LINE,
        capabilities.DRIVE_STEP, capabilities.SCREW_EQUATIONS)),
    "modes": ("natural frequencies of the rod", (capabilities.SCREW_AND_LEVER, capabilities.MOTOR_SHAFT)),
    "limits": ("limits in the amplitude sweep", sweep.NEEDS),
    "capability": ("torque-speed capability", capability.NEEDS),
}


@dataclass(frozen=True)
class ClosedLoop:
    """A linear model: closed loop, responses to command and load (None if no load moves the fin), loops and margins."""

    system: System
    command: FrequencyResponse
    load: FrequencyResponse | None
    loops: Mapping[str, System]
    margins: Mapping[str, frequency.Margins]


@dataclass(frozen=True)
class Analysis:
    """The results; those of a section that is left out are None or empty.

    ``left_out`` has the reasons why SECTIONS or hidden modes are omitted. ``thesis`` is also None if the thesis's model
    is unstable. ``parameters`` are those without faults and homing. The keys of ``final_values``, ``modes`` and
    ``envelope`` are those of the JSON file.
    """

    parameters: ParameterSet
    actuator: LinearActuator
    linear: ClosedLoop
    left_out: Mapping[str, str]
    thesis: ClosedLoop | None
    final_values: Mapping[str, Mapping[str, Any]]
    load: float
    """The rated load [N.m]."""
    sweeps: list[sweep.Sweep]
    modes: Mapping[str, Any] | None
    """Natural frequencies with the inertia of the parameter set and, at the key ``thesis``, those of the thesis."""
    envelope: Mapping[str, Any] | None
    cases: Mapping[str, Columns]
    """Motor speed [rad/s] and torque [N.m] in each reference case by name."""
    capability: capability.Capability | None
    locus: locus.Locus
    steps: list[steps.StepComparison]


def analyse(parameters: ParameterSet, fin_angle: float = 0.0, aero_torque: float = 0.0, rod: Path | None = None,
            locus_name: str | None = None, progress: Progress = silent) -> Analysis:
    """Analyse a parameter set at rest at `fin_angle` [rad] under `aero_torque` [N.m]; `rod` overrides models/rod.toml.

    `locus_name` is the parameter of the root locus, by default the first gain other than 0. Raises EmcasError for an
    actuator without a sampled position loop, an operating point that it cannot hold, an unstable loop, an invalid file
    or an invalid locus.
    """
    parameters = sound(parameters)
    values, model = parameters.values, parameters.model
    left_out = _left_out(model, values)
    progress("linear models", 0, _STEPS)
    beam = load_rod(rod)
    actuator = LinearActuator(values, fin_angle, aero_torque, model)
    _require_stable(actuator)
    if len(actuator.hidden):
        left_out["hidden_modes"] = _hidden(actuator.hidden)
    linear = _closed_loop(actuator.closed, {name: actuator.loop(name) for name in actuator.loops})
    progress("root locus", 1, _STEPS)
    poles = locus.locus(parameters, locus_name, fin_angle, aero_torque)
    load = load_requirements(None, parameters).rated_load
    try:
        progress("final values", 2, _STEPS)
        finals = final_values.final_values(values, fin_angle, aero_torque, model, load)
        progress("capability", 3, _STEPS)
        has_capability = "capability" not in left_out
        envelope = capability.envelope(values, model) if has_capability else None
        cases = capability.case_points(parameters) if has_capability else {}
        fin_capability = capability.capability(values, model) if has_capability else None
        progress("steps", 4, _STEPS)
        compared = steps.comparisons(values, actuator, "thesis_linear" not in left_out)
        crossings = [f for f in linear.command.bandwidths if isfinite(f)]
        highest = _SWEPT * max(crossings, default=linear.command.frequency[-1] / _SWEPT)
        swept = sweep.sweeps(ParameterSubject(parameters), highest, fin_angle, aero_torque,
                             progress=lambda name, done, total: progress(name, 5, _STEPS))
    except (ArithmeticError, ValueError) as error:
        raise EmcasError(f"the response cannot be computed: {error}") from error
    progress("thesis", 6, _STEPS)
    thesis_model = None if "thesis_linear" in left_out else _thesis(values)
    modes = None if "modes" in left_out else {
        **modes_at(beam, values, fin_angle, model), "thesis": thesis_modes()}
    return Analysis(parameters, actuator, linear, left_out, thesis_model, finals, load, swept, modes, envelope, cases,
                    fin_capability, poles, compared)


def _left_out(model: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the reason why each of SECTIONS is left out, without those that are not."""
    actuator = get(model)
    reasons = {}
    for section, (title, needs) in SECTIONS.items():
        if missing := [need for need in needs if need not in actuator.provides]:
            replacing = [each for each in parts(model)[1] if missing[0] in get_extension(each).replaces]
            lacks = f"the extension {replacing[0]} replaces" if replacing else f"{actuator.name} does not have"
            reasons[section] = f"{title} left out: needs {missing[0]}, which {lacks}"
    for extension, why in (("heat", "assumes a motor at one temperature; see emcas envelope"),
                           ("efficiency", "assumes a screw without losses")):
        if extension in parts(model)[1]:
            reasons.setdefault("capability", f"{SECTIONS['capability'][0]} left out: it {why}")
    if "thesis_linear" not in reasons and (why := obstacle(values)):
        reasons["thesis_linear"] = f"{SECTIONS['thesis_linear'][0]} left out: {why}"
    return reasons


def _require_stable(actuator: LinearActuator) -> None:
    """Raise EmcasError for a loop that is unstable, or whose fin does not react to the command."""
    if actuator.stable and not actuator.idle:
        return
    where = f"the linearised loop at {degrees(actuator.point.fin_angle):g} deg"
    values, remedy = actuator.values, "the gains of its controller"
    if capabilities.CASCADE in actuator.actuator.provides:
        if values["controller.velocity.kp"] <= 0.0 or values["controller.position.kp"] <= 0.0:
            raise EmcasError(f"{where} does not hold the fin: controller.velocity.kp and controller.position.kp must "
                             "both be above 0")
        remedy = ("controller.velocity.kp, controller.position.kp or controller.position.ki, or shorten "
                  "drive.transport_delay")
    if actuator.idle:
        raise EmcasError(actuator.idle)
    growth = cleared(largest_pole(actuator.closed) - 1.0, ROUNDING)
    change = f"grows by {100.0 * growth:.2g} % a sample" if growth else "neither decays nor grows"
    raise EmcasError(f"{where} is unstable (a mode {change}): lower {remedy}")


def _hidden(poles: Array) -> str:
    growth = ", ".join(f"{100.0 * cleared(abs(pole) - 1.0, ROUNDING):.2g} %" for pole in poles)
    modes = f"{len(poles)} mode{'s' * (len(poles) > 1)}"
    return (f"{modes} left out of stability, final values and root locus: command and load do not excite them, or fin "
            f"angle and reference do not show them; growth per sample {growth}")


def _thesis(values: Mapping[str, Any]) -> ClosedLoop | None:
    system = thesis.closed(values)
    if not decays(system):
        return None
    return _closed_loop(system, {"reference": thesis.reference_loop(values)})


def _closed_loop(system: System, loops: Mapping[str, System]) -> ClosedLoop:
    """Return the model of a system whose inputs are the command and perhaps the hinge moment."""
    moving = [name for name in system.input_labels if reaches(system, [name], system.output_labels)]
    command, *load = (frequency.response(system[:, name]) for name in moving)
    return ClosedLoop(system, command, load[0] if load else None, loops,
                      {name: frequency.margins(loop) for name, loop in loops.items()})

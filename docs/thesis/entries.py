"""The entries of the thesis's lists of figures and tables, in their order, with titles in words of this package."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from emcas_fmu.errors import EmcasError, hint

from . import drive, friction, kinematics, listings, loading, loops, others, performance
from .entry import DRAWING, HARDWARE, PHOTOGRAPH, REASONS, SCREENSHOT, TEST_DATA, UNSEEN, Entry, Show, Shown
from .runs import COLD, WARM


def _entry(kind: str, number: str, title: str, what: Show | str, note: str = "", structure: bool = False,
           met: str = "") -> Entry:
    """Return an entry; `what` returns its content, or is the reason why the entry is not shown."""
    if isinstance(what, str):
        assert what in REASONS
        return Entry(kind, number, title, reason=what, note=note)
    return Entry(kind, number, title, what, note=note, structure=structure, met=met)


_figure, _table = partial(_entry, "Figure"), partial(_entry, "Table")


def _with(show: Callable[..., Shown], *arguments: Any) -> Show:
    """Return a function of runs that calls `show` with these further arguments."""
    return lambda runs: show(runs, *arguments)


FIGURES = (
    _figure("1.1", "Kinds of control actuation systems", DRAWING),
    _figure("1.2", "A control section with its fins", DRAWING),
    _figure("1.3", "An actuator with screw and lever", DRAWING, "The lever to scale: Figure 2.1."),
    _figure("1.4", "Ristanović's model", others.author("ristanovic", "Ristanović"), structure=True),
    _figure("1.5", "Özkan's model", others.author("ozkan", "Özkan"), structure=True),
    _figure("1.6", "Habibi's model", others.author("habibi", "Habibi"), structure=True),
    _figure("1.7", "An actuator with a clutch", others.kind("a clutch between motor and screw, or two", "series-clutch",
                                                            "clutch"), structure=True),
    _figure("1.8", "An actuator with a worm gear", others.kind("a worm gear", "worm-gear"), structure=True),
    _figure("1.9", "An electrohydrostatic system", others.circuit("electrohydrostatic", (
        ("motor_speed", "pump [rad/s]", 1.0), ("motor_current", "motor current [A]", 1.0))), structure=True),
    _figure("1.10", "An electrohydrostatic actuator", others.kind("a pump", "electrohydrostatic"), structure=True),
    _figure("1.11", "A hydraulic circuit with a valve", others.circuit("electrohydraulic", (
        ("valve_position", "spool / stroke", 1.0), ("supply_flow", "supply / l/min", 6e4))), structure=True),
    _figure("1.12", "An electrohydraulic servo mechanism", others.kind("a servovalve", "electrohydraulic"),
            structure=True),
    _figure("2.1", "The lever as it is mounted", kinematics.assembly),
    _figure("2.2", "The lever in motion", kinematics.ratio, met="angle and ratio of (2.5) and (2.6)"),
    _figure("2.3", "Forces on motor and screw", DRAWING, "Equations (2.8), (2.9): emcas_fmu/physics/mechanics.py."),
    _figure("2.4", "Forces on screw and nut", DRAWING, "Equations (2.10) to (2.12): emcas_fmu/physics/mechanics.py."),
    _figure("2.5", "Forces on fin and fork", DRAWING, "Equations (2.13), (2.14): emcas_fmu/physics/mechanics.py."),
    _figure("2.6", "Axes of earth and missile", DRAWING, "Axes and signs: docs/use/hosts.md."),
    _figure("2.7", "Block diagram of the nonlinear model", DRAWING, "A step in words: docs/develop/architecture.md."),
    _figure("2.8", "Dimensions of motor shaft and screw", DRAWING, "In numbers: models/rod.toml; Table 1."),
    _figure("3.1", "The actuator", DRAWING),
    _figure("3.2", "Motor torque over speed", drive.torque_speed),
    _figure("3.3", "The servo drive", PHOTOGRAPH),
    _figure("3.4", "Motor current over the drive's reference", drive.current_gain,
            met="8.19 A/V and -0.015 A, for the reference current"),
    _figure("3.5", "Block diagram of the current loop", DRAWING, "Its equations: emcas_fmu/physics/drive.py."),
    _figure("3.6", "Step of the current loop", drive.current_loop),
    _figure("3.7", "The real-time computer", PHOTOGRAPH),
    _figure("3.8", "The encoder", PHOTOGRAPH, "Its reading: Figure 5.15."),
    _figure("3.9", "Zero position of the fin", DRAWING, "In numbers: Table 7."),
    _figure("3.10", "Zero position of the fin shaft", DRAWING, "In numbers: Table 8."),
    _figure("3.11", "Zero position of the fork", DRAWING, "In numbers: Table 9."),
    _figure("3.12", "Zero position of screw and nut", DRAWING, "In numbers: Table 10."),
    _figure("3.13", "Friction measurement test setup", UNSEEN, "The simulated setup: Table 12."),
    _figure("3.14", "Rig's motor at 50 rpm, 24 °C", _with(friction.sweep, 50, WARM)),
    _figure("3.15", "Rig's motor at 500 rpm, 24 °C", _with(friction.sweep, 500, WARM)),
    _figure("3.16", "Rig's motor at 1000 rpm, 24 °C", _with(friction.sweep, 1000, WARM)),
    _figure("3.17", "Rig's motor at 1500 rpm, 24 °C", _with(friction.sweep, 1500, WARM)),
    _figure("3.18", "Rig's motor at 2000 rpm, 24 °C", _with(friction.sweep, 2000, WARM)),
    _figure("3.19", "Rig's motor at 50 rpm, -6 °C", _with(friction.sweep, 50, COLD)),
    _figure("3.20", "Rig's motor at 500 rpm, -6 °C", _with(friction.sweep, 500, COLD)),
    _figure("3.21", "Rig's motor at 1000 rpm, -6 °C", _with(friction.sweep, 1000, COLD)),
    _figure("3.22", "Rig's motor at 1500 rpm, -6 °C", _with(friction.sweep, 1500, COLD)),
    _figure("3.23", "Rig's motor at 2000 rpm, -6 °C", _with(friction.sweep, 2000, COLD)),
    _figure("3.24", "Friction over motor speed, 24 °C", _with(friction.against_speed, WARM)),
    _figure("3.25", "Friction over motor speed, -6 °C", _with(friction.against_speed, COLD)),
    _figure("3.26", "Friction over motor speed at both temperatures", _with(friction.against_speed, WARM, COLD)),
    _figure("3.27", "Viscous friction from a straight line", friction.viscous_fit),
    _figure("3.28", "Rig's motor at 25 rpm with its position, 24 °C", _with(friction.sweep, friction.SLOW, WARM)),
    _figure("3.29", "Coulomb friction over the fin angle, 24 °C", _with(friction.against_angle, WARM)),
    _figure("3.30", "Rig's motor at 25 rpm with its position, -6 °C", _with(friction.sweep, friction.SLOW, COLD)),
    _figure("3.31", "Coulomb friction over the fin angle, -6 °C", _with(friction.against_angle, COLD)),
    _figure("3.32", "Coulomb friction over the fin angle, both temperatures",
            _with(friction.against_angle, WARM, COLD)),
    _figure("3.33", "Polynomial of Coulomb friction, positive direction", _with(friction.curve_fit, 1)),
    _figure("3.34", "Polynomial of Coulomb friction, negative direction", _with(friction.curve_fit, -1)),
    _figure("3.35", "Polynomials of both directions", _with(friction.curve_fit, 1, -1)),
    _figure("3.36", "Encoders for the measurement of backlash", DRAWING),
    _figure("3.37", "Fin angle from two encoders", kinematics.two_encoders),
    _figure("3.38", "Backlash", kinematics.backlash),
    _figure("3.39", "Design of the loading test setup", DRAWING, "The simulated setup: Figure 5.17, Table 16."),
    _figure("3.40", "The actuator on the loading test setup", PHOTOGRAPH),
    _figure("4.1", "The linear model", loops.linear_model),
    _figure("4.2", "Anti-windup on and off", loops.antiwindup, structure=True),
    _figure("4.3", "Entering requirements for a response", SCREENSHOT, "The requirements here: Table 17."),
    _figure("4.4", "A search for gains", loops.search),
    _figure("5.1", "Block diagram of the whole nonlinear model", DRAWING, "See Figure 2.7."),
    _figure("5.2", "Block diagram of the controllers", DRAWING, "Their equations: emcas_fmu/control/controllers.py."),
    _figure("5.3", "Block diagram of motor and drive", DRAWING, "Their equations: emcas_fmu/physics/drive.py."),
    _figure("5.4", "Block diagram of the screw", DRAWING, "Its equations: emcas_fmu/physics/mechanics.py."),
    _figure("5.5", "Block diagram of the nut", DRAWING, "Its equations: emcas_fmu/physics/mechanics.py."),
    _figure("5.6", "Block diagram of the fin", DRAWING, "Its equations: emcas_fmu/physics/mechanics.py."),
    _figure("5.7", "Block diagram of the kinematics", DRAWING, "Its curves: Figure 2.2."),
    _figure("5.8", "Linear and nonlinear model, step of 1°", loops.linear_steps(1.0)),
    _figure("5.9", "Linear and nonlinear model, steps of 10° and 20°", loops.linear_steps(10.0, 20.0)),
    _figure("5.10", "The prototype under test", PHOTOGRAPH),
    _figure("5.11", "Block diagram of the real-time test", DRAWING),
    _figure("5.12", "Homing", loops.homing),
    _figure("5.13", "Setup of the controller's modules", SCREENSHOT),
    _figure("5.14", "Settings of the modules", SCREENSHOT),
    _figure("5.15", "The encoder's reading", kinematics.encoder, structure=True),
    _figure("5.16", "Friction compensation on and off", loops.compensation, structure=True),
    _figure("5.17", "The torque loop of the loading test setup", loading.torque_loop),
    _figure("5.18", "Steps without load", performance.steps),
    _figure("5.19", "Step test, difference of simulation and test", TEST_DATA),
    _figure("5.20", "Fin rate of steps without load", performance.step_rate),
    _figure("5.21", "Command of the modified square wave", performance.square_command),
    _figure("5.22", "Response to the modified square wave", performance.square),
    _figure("5.23", "Sine sweep", performance.sweep()),
    _figure("5.24", "Sine sweep, enlarged", performance.sweep(6.5, 7.5)),
    _figure("5.25", "Sine sweep, difference of simulation and test", TEST_DATA),
    _figure("5.26", "Frequency response", performance.bode),
    _figure("5.27", "Fin angle and command of the loaded test", loading.commanded),
    _figure("5.28", "Applied moment in the loaded test", loading.applied),
    _figure("5.29", "Results of the loaded test", loading.results),
    _figure("5.30", "Results of the loaded test, enlarged", loading.zoomed),
)
TABLES = (
    _table("1", "Natural frequencies of the rod", kinematics.natural_frequencies,
           met="42 to 139 times the bandwidth, rad/s divided by Hz"),
    _table("2", "Required performance", performance.required, met="its limits, by which this set is judged"),
    _table("3", "Motor", drive.motor),
    _table("4", "Units of the drive's gains", drive.conversion, met="0.208 and 0.018"),
    _table("5", "Servo drive", listings.parameters(*drive.GAINS, unknown="in which units the gains are (Figure 3.6)."),
           met="8.19 A/V, -0.015 A, 3.7 ms, 5 and 0.1"),
    _table("6", "Modules of the real-time computer", HARDWARE),
    _table("7", "Fin", listings.parameters("inertia.fin", "mass.fin", "center_of_mass.fin")),
    _table("8", "Fin shaft", listings.parameters("inertia.shaft", "mass.shaft", "center_of_mass.shaft")),
    _table("9", "Fork", listings.parameters("inertia.fork", "mass.fork", "center_of_mass.fork")),
    _table("10", "Screw and nut", listings.parameters("screw.", "inertia.screw", "mass.nut")),
    _table("11", "Parts of the friction measurement test setup", HARDWARE, "The simulated setup: Table 12."),
    _table("12", "Motor of the friction measurement test setup", listings.rig("friction_motor")),
    _table("13", "Effect of temperature on friction", friction.temperatures),
    _table("14", "Friction at 24 °C", friction.summary),
    _table("15", "Coefficients of the polynomials", friction.coefficients),
    _table("16", "Loading test setup", listings.rig("loading")),
    _table("17", "Requirements of the position controller", loops.requirements),
    _table("18", "Optimised parameters", loops.tunables),
    _table("19", "Gains of this set", loops.optimised),
    _table("20", "Realised performance", performance.realised),
)
ENTRIES = (*FIGURES, *TABLES)


def find(names: Iterable[str]) -> tuple[Entry, ...]:
    """Return the entries with these names (``5.18``, ``Figure 5.18``, ``Table 4``) in the order of the lists.

    Without names all entries are returned. Raises EmcasError for an unknown name.
    """
    known = {_key(entry.name): entry for entry in ENTRIES}
    chosen = set()
    for name in names:
        key = _key(name) if name[:1].isalpha() else _key(f"Figure {name}")
        if key not in known:
            table = _key(f"Table {name}")
            near = f"; did you mean Table {name}?" if table in known else hint(
                name, [entry.name if name[:1].isalpha() else entry.number for entry in ENTRIES])
            raise EmcasError(f"--only {name}: the thesis's lists have no such entry: name a figure by number, 5.18, "
                             f"a table as in \"Table 4\"{near}")
        chosen.add(key)
    return tuple(entry for key, entry in known.items() if key in chosen or not chosen)


def _key(name: str) -> str:
    return name.lower().replace(" ", "")

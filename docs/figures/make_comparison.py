"""Tables and picture of docs/model/comparison.md: kinds of actuation side by side, each with its default parameters.

The script also makes the table of power in docs/model/worm_gear.md.

    python docs/figures/make_comparison.py           # writes tables and picture, in some minutes
    python docs/figures/make_comparison.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from math import degrees, nan, radians

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.bench.excitation import COMMAND, LOAD, Excitation, slew_to, step_to, sweep
from emcas_fmu.bench.frequency_response import FrequencyResponse, sweep_response
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.metrics import motion_figures
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.extensions.fault_list import possible
from emcas_fmu.pages.numbers import with_unit
from emcas_fmu.parameters import Scalar, load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.studies.compare import sets
from emcas_fmu.studies.report import mission, stiffness
from emcas_fmu.studies.report.outcome import Rig

KINDS = {NONLINEAR: "ball screw", "worm-gear": "worm gear", "clutch": "clutch, dual", "series-clutch": "clutch, series",
         "electrohydrostatic": "electrohydrostatic", "electrohydraulic": "electrohydraulic"}
FORMS = {"worm-gear-elastic": ("worm gear, elastic mesh", "worm-gear")}  # forms of a kind with additional faults
FALLING = "worm-falling-friction"
COLORS = dict(zip(KINDS, plots.COLORS, strict=False))
LOADS = np.arange(-150.0, 151.0, 50.0)  # N.m along the motion
SLEW, RAMP = radians(100.0), radians(19.0)  # rad/s and rad: rate and half travel of the power's ramp
HELD = 100.0  # N.m
ENABLE = "enable"
_SETTLED = 1.0  # s, time after which a held fin has settled


@dataclass(frozen=True)
class Kind:
    """An actuator with its default parameters, or with shipped sets over them, and its figures."""

    name: str
    sets: tuple[str, ...] = ()

    @cached_property
    def subject(self) -> ParameterSubject:
        """The subject whose runs are measured."""
        return ParameterSubject(load_parameters(self.sets, model=self.name))

    @cached_property
    def rig(self) -> Rig:
        """The rig for tests of `emcas report`."""
        return Rig(self.subject)

    def run(self, excitation: Excitation) -> Run:
        """Return the finished response."""
        run = self.subject.run(excitation)
        run.finished()
        return run

    def step(self, size: float) -> Mapping[str, float]:
        """Return the figures of a step [deg]."""
        return motion_figures(self.run(step_to(radians(size), 0.6)), -1)

    @cached_property
    def response(self) -> FrequencyResponse:
        """The frequency response at 1 deg."""
        return self.swept(1.0)

    def swept(self, size: float) -> FrequencyResponse:
        """Return the frequency response at an amplitude [deg]."""
        return sweep_response(self.run(sweep(radians(size), 12.0)))

    @property
    def margins(self) -> str:
        """Return gain and phase margin of the loop opened at the drive's reference, as text."""
        (margins,) = measure(Test("linear"), self.subject, [{}], ("gain_margin", "phase_margin"), ("minimum",) * 2)
        gain, phase = margins
        return f"{gain:.1f} dB, {degrees(phase):.0f}°"

    def rate(self, load: float) -> float:
        """Return the mean rate [deg/s] of a slew from -20 to 20 deg under a load [N.m] along it; nan if it stalls."""
        return degrees(motion_figures(self.run(slew_to(radians(20.0), 1.0, load)), -1)["sustained_rate"])

    def ramp(self, load: float, output: str = "supply_power") -> float:
        """Return the mean of an output, by default supply power [W], between -10 and 10 deg of a ramp of 100 deg/s.

        The load [N.m] acts along the ramp.
        """
        time = np.arange(2001) * 1e-3
        angle = np.clip(SLEW * (time - 1.5) - RAMP, -RAMP, RAMP)
        columns = self.run(Excitation("ramp", {COMMAND: angle, LOAD: np.where(time > 0.5, load, 0.0)}, 1.5)).columns
        inside = np.abs(columns["fin_angle"]) < radians(10.0)
        return float(np.mean(columns[output][inside & (time > 1.5)]))

    @cached_property
    def holding(self) -> Run:
        """The response of a fin held at 0 to a load step of 100 N.m."""
        rest = step_to(0.0, 2.0)
        return self.run(rest.holding({LOAD: np.where(rest.judged(rest.time), -HELD, 0.0)}))

    @property
    def dip(self) -> float:
        """Return the largest deflection [deg] in the response `holding`."""
        return degrees(float(np.abs(self.holding.columns["fin_angle"]).max()))

    @property
    def yields(self) -> str:
        """Return the motion [deg] of the disabled fin in 0.2 s under 100 N.m, as text."""
        load = self.holding.excitation
        run = self.run(load.holding({ENABLE: np.zeros(len(load.time))}))
        angle = np.abs(np.degrees(run.columns["fin_angle"]))[run.columns["time"] <= load.begin + 0.2]
        return "to the stop" if run.columns["at_stop"][len(angle) - 1] > 0.5 else f"{angle[-1]:.2g}°"

    @property
    def heat(self) -> float:
        """Return the mean supply power [W] while the fin holds 100 N.m: all of it becomes heat, since nothing moves."""
        columns = self.holding.columns
        return float(np.mean(columns["supply_power"][columns["time"] > self.holding.excitation.begin + _SETTLED]))

    @cached_property
    def mission(self) -> Mapping[str, Scalar]:
        """Figures of the synthetic mission profile of `emcas report`."""
        return mission.measure(self.rig).figures["synthetic"]

    @cached_property
    def stiffness(self) -> Mapping[str, Mapping[str, Scalar]]:
        """Figures of the dynamic stiffness of `emcas report`."""
        return stiffness.measure(self.rig).figures

    @property
    def breakaway(self) -> float:
        """Return the moment [N.m] that moves the disabled fin, the smaller of both directions; nan beyond 100 N.m."""
        broke = [abs(float(value)) for value in self.stiffness["breakaway"].values()]
        return min(broke) if np.isfinite(broke).all() else nan


@cache
def kinds() -> Mapping[str, Kind]:
    """Return the kinds by name."""
    return {name: Kind(name) for name in KINDS}


def _rows(rows: Mapping[str, Callable[[Kind], str]]) -> str:
    return markdown(("", *KINDS.values()), [(title, *map(show, kinds().values())) for title, show in rows.items()])


def table2() -> str:
    """Return the table of Table 2 for every kind, bold if a limit is missed."""
    comparison = sets.compare(sets.load_sets(list(KINDS), NONLINEAR))
    rows = [(row[0].title.replace("N.m", "N·m"), f"{'≥' if row[0].sense == '>=' else '≤'} "
             f"{with_unit(row[0].limit, row[0].unit)}",
             *(("" if j.passed else "**") + j.more + with_unit(j.measured, j.unit) + ("" if j.passed else "**")
               for j in row)) for row in comparison.rows if "Table 2" in row[0].source]
    return markdown(("", "required", *KINDS.values()), rows)


def _least_stiffness(kind: Kind) -> str:
    """Return the least dynamic stiffness as text; "does not move" for a fin that friction locks."""
    least = kind.stiffness["powered"].get("least_stiffness_n_m_per_rad")
    return "does not move" if least is None else f"{least:.0f} N·m/rad"


def motions() -> str:
    """Return the table of steps, frequency responses and the effects of a load."""
    return _rows({
        "overshoot, step of 1°": lambda k: f"{100.0 * k.step(1.0)['overshoot']:.1f} %",
        "overshoot, step of 10°": lambda k: f"{100.0 * k.step(10.0)['overshoot']:.1f} %",
        "settling of a step of 10° within 2 %": lambda k: f"{1e3 * k.step(10.0)['settling_time']:.0f} ms",
        "settling of a step of 20° within 0.2°": lambda k: f"{1e3 * k.step(20.0)['time_to_accuracy']:.0f} ms",
        "−3 dB at 0.1°": lambda k: f"{k.swept(0.1).stated[0]} Hz",
        "frequency of 90° lag at 1°": lambda k: f"{k.response.stated[1]} Hz",
        "largest deflection under a load step of 100 N·m": lambda k: f"{k.dip:.2f}°",
        "least stiffness, 1 to 40 Hz": _least_stiffness,
        "motion in 0.2 s under 100 N·m, unpowered": lambda k: k.yields,
        "gain and phase margin at the reference": lambda k: k.margins,
        "delay from a sample to the drive": lambda k: f"{1e3 * k.subject.transport_delay({}):.1f} ms",
        "load that moves it unpowered": lambda k: f"{k.breakaway:.3g} N·m" if np.isfinite(k.breakaway) else
                                              f"holds {k.rig.load:g} N·m",
    })


def powers() -> str:
    """Return the table of power and energy."""
    return _rows({
        "power, 100°/s against 100 N·m": lambda k: f"{k.ramp(-HELD):.0f} W",
        "power, 100°/s with 100 N·m": lambda k: f"{k.ramp(HELD):.0f} W",
        "power to hold 100 N·m": lambda k: f"{k.heat:.0f} W",
        "mission: supply energy": lambda k: f"{k.mission['energy_drawn_j']:.0f} J",
        "mission: energy returned": lambda k: f"{k.mission['energy_returned_j']:.0f} J",
        "mission: largest power": lambda k: f"{k.mission['peak_power_w']:.0f} W",
        "mission: rms tracking error": lambda k: f"{k.mission['rms_tracking_error_deg']:.2f}°",
    })


def failures() -> str:
    """Return the table of the faults that each kind declares, and the number of these and the general faults."""
    rows = []
    for name, title in KINDS.items():
        actuator = get(name)
        rows.append((title, "; ".join(f"`{fault.name}`: {fault.description}" for fault in actuator.faults) or "none",
                     str(len(possible(actuator)))))
        for form, (title, kind) in FORMS.items():
            if kind == name:
                more = [fault for fault in possible(get(form)) if fault not in possible(actuator)]
                rows.append((title, f"those of the {KINDS[kind]}; "
                             + "; ".join(f"`{fault.name}`: {fault.description}" for fault in more),
                             str(len(possible(get(form))))))
    return markdown(("", "faults of the kind", "number of all faults"), rows)


def ramps() -> str:
    """Return the table of current, power and heat of ball screw and worm gears, with and without falling friction."""
    kinds = {"`nonlinear`": Kind(NONLINEAR), "`worm-gear`": Kind("worm-gear"),
             f"`worm-gear`, `-p {FALLING}`": Kind("worm-gear", (FALLING,))}
    rows = []
    for title, kind in kinds.items():
        row = [title]
        for load in (-HELD, HELD):
            row += [f"{kind.ramp(load, 'motor_current'):.1f} A", f"{kind.ramp(load):.0f} W",
                    f"{kind.ramp(load, 'worm_loss'):.0f} W" if "worm_loss" in kind.subject.outputs else ""]
        rows.append(row)
    return markdown(("", *(f"{way}: {figure}" for way in ("against", "with")
                           for figure in ("current", "supply power", "heat of the flanks"))), rows)


def draw() -> None:
    """Plot a step, rates against loads, frequency responses, and energy of the mission."""
    with plots.style():
        figure, axes = plots.figure(2, 2, height=3.0)
        (step, rate), (gain, energy) = axes
        for name, kind in kinds().items():
            look = {"color": COLORS[name], "label": KINDS[name]}
            run = kind.run(step_to(radians(10.0), 0.3))
            time = 1e3 * (run.columns["time"] - run.excitation.begin)
            step.plot(time, np.degrees(run.columns["fin_angle"]), **look)
            rate.plot(LOADS, [kind.rate(load) for load in LOADS], "o-", markersize=3, **look)
            gain.semilogx(kind.response.frequency, kind.response.gain_db, **look)
        step.set(title="step of 10°", xlabel="time [ms]", ylabel="fin angle [deg]", xlim=(-10.0, 200.0))
        rate.set(title="mean rate of a slew of 40°", xlabel="load along the motion [N·m]", ylabel="deg/s",
                 ylim=(0.0, None))
        gain.axhline(-3.0, **plots.LIMIT)
        gain.set(title="frequency response at 1°", xlabel="frequency [Hz]", ylabel="gain [dB]", ylim=(-12.0, 3.0))
        plots.frequency_axis(gain, (0.5, 1, 2, 5, 10, 20))
        rows = np.arange(len(KINDS))
        for key, sign, alpha in (("energy_drawn_j", 1.0, 1.0), ("energy_returned_j", -1.0, 0.5)):
            energy.barh(rows, [sign * float(kind.mission[key]) / 1e3 for kind in kinds().values()],
                        color=list(COLORS.values()), alpha=alpha)
        for row, kind in zip(rows, kinds().values(), strict=True):
            consumed, returned = (float(kind.mission[key]) for key in ("energy_drawn_j", "energy_returned_j"))
            energy.annotate(f"{consumed:.0f} J, returned {returned:.0f} J", (consumed / 1e3, row), (4.0, 0.0),
                            textcoords="offset points", va="center", fontsize=8.0)
        energy.set(xlim=(None, 9.2))
        energy.set_yticks(rows, KINDS.values())
        energy.invert_yaxis()
        energy.set(title="energy of a mission of 15 s", xlabel="energy [kJ]")
        figure.legend(*step.get_legend_handles_labels(), loc="outside upper center", ncols=len(KINDS))
        save(figure, "comparison")


DOCUMENTS = {"model/comparison.md": {"table2": table2, "motions": motions, "powers": powers, "failures": failures},
             "model/worm_gear.md": {"ramps": ramps}}

if __name__ == "__main__":
    check = "--check" in sys.argv[1:]
    if not check:
        draw()
    sys.exit(main(check, DOCUMENTS, "make_comparison.py"))

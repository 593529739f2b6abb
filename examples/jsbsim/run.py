"""What a run flies: the manoeuvres with each actuator, in each master, and the convergence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from emcas_fmu.actuators import NAMES, NONLINEAR, full_name, get
from emcas_fmu.bench.fmu import opened
from emcas_fmu.errors import EmcasError
from emcas_fmu.ssp.archive import NOMINAL
from emcas_fmu.studies.fitting import Fit

from .actuators import Actuators, Ideal
from .build import build_unit
from .convergence import Convergence, measure
from .flight import AGGRESSIVE, MANOEUVRES, Manoeuvre, fly
from .fmu import BUS_RESISTANCE, VOLTAGE, WIRED, Fmu
from .masters import VARIANT, InMaster, write_archive
from .results import FMU, IDEAL, SECOND_ORDER, STIFF, UNDELAYED, WITHOUT_ENCODER, WITHOUT_SSP, Flight, Results, Unit
from .second_order import SecondOrder, fit, undelayed
from .vehicle import Launch

Progress = Callable[[str, float], None]
"""Called with what is done now, and its share from 0 to 1."""
# Parameters that take the steps out of what is measured, of those that an actuator has.
_EXACT: Mapping[str, bool | float] = {"encoder.enabled": False, "transducer.resolution": 0.0}


@dataclass(frozen=True)
class Options:
    """What is asked for; `bus_resistance` in Ohm, `bus_voltage` in V, `step` in s."""

    manoeuvres: tuple[str, ...]
    actuators: tuple[str, ...]
    """Of results.ACTUATORS."""
    step: float = 1e-3
    fmu: Path | None = None
    models: tuple[str, ...] = ()
    """Models built and flown in addition to `fmu`; without both, the nonlinear one."""
    guid: str | None = None
    bus_resistance: float | None = None
    """Default for an FMU of four on a bus: BUS_RESISTANCE."""
    bus_voltage: float | None = None
    """Default: the start value of the FMUs or the archive."""
    mixing: bool = False
    masters: tuple[str, ...] = ()
    """Of masters.MASTERS."""
    ssp: Path | None = None
    """Default: an archive built of the single actuator."""
    variant: str = NOMINAL
    """Of `ssp`."""
    convergence: bool = True
    hinge: float = Launch.hinge
    """Place of the fins' hinges, share of the chord."""


def every_model() -> tuple[str, ...]:
    """The shipped actuators that are fed by something."""
    return tuple(name for name in NAMES if get(name).supply is not None)


def run(options: Options, folder: Path, progress: Progress) -> Results:
    """Fly; missing FMUs and archive are built in `folder`. Raises EmcasError."""
    if options.ssp is not None and not options.masters:
        raise EmcasError(f"--ssp {options.ssp}: is flown in another master only: give --host, too")
    if options.variant != NOMINAL and options.ssp is None:
        raise EmcasError(f"--variant {options.variant}: is a variant of an archive: give --ssp, too")
    flier = _Flier(options, folder, progress)
    manoeuvres = {name: each.hinged(options.hinge) for name, each in MANOEUVRES.items()}
    flights = {name: {each: flier.fly(manoeuvres[name], each, flier.makers[each]) for each in flier.actuators}
               for name in options.manoeuvres}
    masters = {name: flier.in_masters(manoeuvres[name], flights[name]) for name in options.manoeuvres
               if options.masters}
    converged = flier.converge() if options.convergence else {}
    return Results(options.step, flights, manoeuvres, flier.second_order, converged, flier.units, masters)


class _Flier:
    """The actuators of a run; whatever is wrong with them is said before long work."""

    def __init__(self, options: Options, folder: Path, progress: Progress) -> None:
        self._options, self._progress, self._folder = options, progress, folder
        self.second_order: Fit | None = None
        self.units: dict[str, Unit] = {}
        self._whole = False
        self.makers: dict[str, Callable[[], Actuators]] = {IDEAL: Ideal}
        models = options.models or (() if options.fmu else (NONLINEAR,))
        several = len(models) + (options.fmu is not None) > 1
        if several and options.masters:
            raise EmcasError("--host: flies one actuator: give one --model or one --fmu")
        if several and options.actuators == (STIFF,):
            raise EmcasError(f"--actuator {STIFF}: is of one actuator: give one --model or one --fmu")
        if options.actuators != (IDEAL,):
            if options.fmu:
                self._add(options.fmu, several)
            for model in models:
                if full_name(model) in self.units:
                    raise EmcasError(f"--model {model}: is flown already; leave it or --fmu {options.fmu} away")
                self._add(self._build(model), several)
        self.actuators = tuple(self._chosen())
        self._archive, self._variant = options.ssp, options.variant
        if options.masters and options.ssp is None:
            self._archive, self._variant = self._write_archive(models), VARIANT
        for master in options.masters:
            self._in(master)().close()

    def _build(self, model: str) -> Path:
        self._progress(f"build {model}", 0.0)
        return build_unit(self._folder, 4, model)

    def _add(self, path: Path, several: bool) -> None:
        """What an FMU flies as: itself, on a stiff line and with exact sensors; of the nonlinear one the fits, too."""
        options = self._options
        trial = Fmu(path, None if several and path != options.fmu else options.guid)
        trial.close()
        self._whole = trial.whole
        name = f"{SECOND_ORDER}-{FMU}" if trial.model == SECOND_ORDER else trial.model  # the other is fitted
        on_bus = trial.line == VOLTAGE or not several  # bus options apply to FMUs with a bus
        voltage = options.bus_voltage if on_bus else None
        option = options.bus_resistance if on_bus else None
        resistance = option if option is not None else BUS_RESISTANCE if trial.whole and trial.line == VOLTAGE else 0.0
        with opened(path) as unit:
            exact = {each: value for each, value in _EXACT.items() if each in unit.starts}

        def flying(resistance: float, parameters: Mapping[str, bool | float] = WIRED) -> Callable[[], Actuators]:
            return lambda: Fmu(path, parameters=parameters, bus_resistance=resistance, bus_voltage=voltage,
                               mixing=options.mixing)

        flying(resistance)().close()
        self.units[name] = Unit(trial.file, trial.guid, trial.line, trial.supply if voltage is None else voltage,
                                resistance)
        if name == NONLINEAR:
            self.second_order = found = fit(path)
            second, prompt = found.parameters, undelayed(found.parameters)
            self.makers |= {SECOND_ORDER: lambda: SecondOrder(second), UNDELAYED: lambda: SecondOrder(prompt)}
        self.makers[name] = flying(resistance)
        if exact:
            self.makers[WITHOUT_ENCODER.format(name)] = flying(resistance, {**WIRED, **exact})
        if not several:
            self.makers[STIFF] = flying(0.0)

    def _chosen(self) -> list[str]:
        """Names of those asked for, in their order; what there is not is left out, unless it is all that is asked."""
        asked, chosen = self._options.actuators, list[str]()
        for each in asked:
            if each == FMU:
                chosen += self.units
            elif each in self.makers:
                chosen.append(each)
            elif len(asked) == 1:
                raise EmcasError(f"--actuator {each}: is fitted to the {NONLINEAR} model, which is not flown: give "
                                 f"--model {NONLINEAR}")
        if FMU in asked and not any(unit.bus_resistance for unit in self.units.values()):
            chosen = [each for each in chosen if each != STIFF]  # it would be the same flight again
        return list(dict.fromkeys(chosen))

    def _write_archive(self, models: tuple[str, ...]) -> Path:
        fmu = self._options.fmu
        if fmu is not None and self._whole:
            raise EmcasError(f"{fmu}: has four actuators, and an archive wires single ones: give --ssp FILE "
                             "(see `emcas ssp`), or leave --fmu away")
        self._progress("archive", 0.0)
        return write_archive(self._folder / "EMCAS.ssp", fmu or build_unit(self._folder, 1, *models))

    def _in(self, master: str) -> Callable[[], Actuators]:
        assert self._archive is not None
        archive, variant, step = self._archive, self._variant, self._options.step
        return lambda: InMaster(archive, master, step, variant, self._options.bus_voltage)

    def fly(self, manoeuvre: Manoeuvre, name: str, make: Callable[[], Actuators]) -> Flight:
        """One flight."""
        fins = make()
        try:
            return fly(fins, manoeuvre, self._options.step,
                       progress=lambda time: self._progress(f"{manoeuvre.name} {name}", time / manoeuvre.duration))
        finally:
            fins.close()

    def in_masters(self, manoeuvre: Manoeuvre, flown: Mapping[str, Flight]) -> Mapping[str, Flight]:
        """The flight in each master and, where the archive was made for it, that of the unit on a stiff bus."""
        found = {master: self.fly(manoeuvre, master, self._in(master)) for master in self._options.masters}
        same = [STIFF, *(name for name, unit in self.units.items() if unit.bus_resistance == 0.0)]
        stiff = next((flown[name] for name in same if name in flown), None)
        if stiff is not None and self._options.ssp is None:
            found[WITHOUT_SSP] = stiff
        return found

    def converge(self) -> Mapping[str, Convergence]:
        """Of every actuator but variants, the stiff bus and the model without delay, and of FMUs with exact sensors."""
        names = [a for a in self.actuators if a not in (STIFF, UNDELAYED)]
        names += [each for a in names if (each := WITHOUT_ENCODER.format(a)) in self.makers]
        manoeuvre = replace(AGGRESSIVE.hinged(self._options.hinge), duration=3.0)
        return {name: measure(self.makers[name], manoeuvre,
                              progress=lambda share, n=name: self._progress(f"convergence {n}", share))  # type: ignore[misc]
                for name in names}

"""A run: flights of the manoeuvres with each actuator and in each master, and the convergence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from emcas_fmu.actuators import NAMES, NONLINEAR, full_name, get
from emcas_fmu.bench.fmu import opened
from emcas_fmu.errors import EmcasError
from emcas_fmu.ssp.archive import NOMINAL
from emcas_fmu.studies.fitting import SecondOrderFit

from .actuators import Actuators, Ideal
from .build import build_unit
from .convergence import Convergence, measure
from .flight import AGGRESSIVE, MANOEUVRES, Manoeuvre, fly
from .fmu import BUS_RESISTANCE, VOLTAGE, WIRED, Fmu
from .masters import VARIANT, InMaster, write_archive
from .results import FMU, IDEAL, SECOND_ORDER, STIFF, UNDELAYED, WITHOUT_ENCODER, WITHOUT_SSP, Flight, Results, Unit
from .second_order import SecondOrder, fit, undelayed
from .vehicle import Launch, check_installed

Progress = Callable[[str, float], None]
"""A function that is called with the name of the work and the share that is done, from 0 to 1."""
# Parameters without which sensors are not quantised, if the actuator has them.
_EXACT: Mapping[str, bool | float] = {"encoder.enabled": False, "transducer.resolution": 0.0}


@dataclass(frozen=True)
class Options:
    """The options of a run, with the communication `step` in s.

    `actuators` are among results.ACTUATORS, `masters` among masters.MASTERS. `models` are built and flown in addition
    to `fmu`, by default the nonlinear one if there is no `fmu`. `bus_resistance` [Ohm] is by default BUS_RESISTANCE for
    an FMU of four on a bus, `bus_voltage` [V] the start value of FMU or archive. `ssp` is by default an archive of the
    single actuator; `variant` is one of `ssp`. `hinge` is the position of the fins' hinges as a share of the chord.
    """

    manoeuvres: tuple[str, ...]
    actuators: tuple[str, ...]
    step: float = 1e-3
    fmu: Path | None = None
    models: tuple[str, ...] = ()
    guid: str | None = None
    bus_resistance: float | None = None
    bus_voltage: float | None = None
    mixing: bool = False
    masters: tuple[str, ...] = ()
    ssp: Path | None = None
    variant: str = NOMINAL
    convergence: bool = True
    hinge: float = Launch.hinge


def every_model() -> tuple[str, ...]:
    """Return the names of the shipped actuators that have a supply."""
    return tuple(name for name in NAMES if get(name).supply is not None)


def run(options: Options, folder: Path, progress: Progress) -> Results:
    """Fly and return the results; FMUs and archive that are not passed are built in `folder`.

    Raises EmcasError for options that cannot be used.
    """
    if options.ssp is not None and not options.masters:
        raise EmcasError(f"--ssp {options.ssp}: is flown in another master only: pass --host, too")
    if options.variant != NOMINAL and options.ssp is None:
        raise EmcasError(f"--variant {options.variant}: is a variant of an archive: pass --ssp, too")
    check_installed()
    flier = _Flier(options, folder, progress)
    manoeuvres = {name: each.hinged(options.hinge) for name, each in MANOEUVRES.items()}
    flights = {name: {each: flier.fly(manoeuvres[name], each, flier.makers[each]) for each in flier.actuators}
               for name in options.manoeuvres}
    masters = {name: flier.in_masters(manoeuvres[name], flights[name]) for name in options.manoeuvres
               if options.masters}
    converged = flier.converge() if options.convergence else {}
    return Results(options.step, flights, manoeuvres, flier.second_order, converged, flier.units, masters)


class _Flier:
    """The actuators of a run; wrong options are refused before the long work."""

    def __init__(self, options: Options, folder: Path, progress: Progress) -> None:
        self._options, self._progress, self._folder = options, progress, folder
        self.second_order: SecondOrderFit | None = None
        self.units: dict[str, Unit] = {}
        self._whole = False
        self.makers: dict[str, Callable[[], Actuators]] = {IDEAL: Ideal}
        models = options.models or (() if options.fmu else (NONLINEAR,))
        several = len(models) + (options.fmu is not None) > 1
        if several and options.masters:
            raise EmcasError("--host: flies one actuator: pass one --model or one --fmu")
        if several and options.actuators == (STIFF,):
            raise EmcasError(f"--actuator {STIFF}: flies one actuator: pass one --model or one --fmu")
        if options.actuators != (IDEAL,):
            if options.fmu:
                self._add(options.fmu, several)
            for model in models:
                if full_name(model) in self.units:
                    raise EmcasError(f"--model {model}: is flown already; leave it or --fmu {options.fmu} out")
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
        """Add the actuators of an FMU: itself, on a stiff bus, with exact sensors, and fits to a nonlinear one.

        The stiff bus is left out if `several` actuators are flown. Raises EmcasError if the FMU cannot be used.
        """
        options = self._options
        trial = Fmu(path, None if several and path != options.fmu else options.guid)
        trial.close()
        self._whole = trial.whole
        name = f"{SECOND_ORDER}-{FMU}" if trial.model == SECOND_ORDER else trial.model  # SECOND_ORDER is the fitted one
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
            self.second_order = fitted = fit(path)
            delayed, prompt = fitted.parameters, undelayed(fitted.parameters)
            self.makers |= {SECOND_ORDER: lambda: SecondOrder(delayed), UNDELAYED: lambda: SecondOrder(prompt)}
        self.makers[name] = flying(resistance)
        if exact:
            self.makers[WITHOUT_ENCODER.format(name)] = flying(resistance, {**WIRED, **exact})
        if not several:
            self.makers[STIFF] = flying(0.0)

    def _chosen(self) -> list[str]:
        """Return the names of the requested actuators, without those that do not exist in this run.

        Raises EmcasError if the only requested actuator does not exist.
        """
        requested, chosen = self._options.actuators, list[str]()
        for each in requested:
            if each == FMU:
                chosen += self.units
            elif each in self.makers:
                chosen.append(each)
            elif len(requested) == 1:
                raise EmcasError(f"--actuator {each}: is fitted to the {NONLINEAR} model, which is not flown: pass "
                                 f"--model {NONLINEAR}")
        if FMU in requested and not any(unit.bus_resistance for unit in self.units.values()):
            chosen = [each for each in chosen if each != STIFF]  # it would be the same flight
        return list(dict.fromkeys(chosen))

    def _write_archive(self, models: tuple[str, ...]) -> Path:
        fmu = self._options.fmu
        if fmu is not None and self._whole:
            raise EmcasError(f"{fmu}: has four actuators, and an archive needs single ones: pass --ssp FILE "
                             "(see `emcas ssp`), or leave --fmu out")
        self._progress("archive", 0.0)
        return write_archive(self._folder / "EMCAS.ssp", fmu or build_unit(self._folder, 1, *models))

    def _in(self, master: str) -> Callable[[], Actuators]:
        assert self._archive is not None
        archive, variant, step = self._archive, self._variant, self._options.step
        return lambda: InMaster(archive, master, step, variant, self._options.bus_voltage)

    def fly(self, manoeuvre: Manoeuvre, name: str, make: Callable[[], Actuators]) -> Flight:
        """Return a flight with the actuators that `make` returns; `name` is for the progress."""
        fins = make()
        try:
            return fly(fins, manoeuvre, self._options.step,
                       progress=lambda time: self._progress(f"{manoeuvre.name} {name}", time / manoeuvre.duration))
        finally:
            fins.close()

    def in_masters(self, manoeuvre: Manoeuvre, flown: Mapping[str, Flight]) -> Mapping[str, Flight]:
        """Return the flight in each master, and for the default archive also that of the FMU on a stiff bus."""
        flights = {master: self.fly(manoeuvre, master, self._in(master)) for master in self._options.masters}
        same = [STIFF, *(name for name, unit in self.units.items() if unit.bus_resistance == 0.0)]
        stiff = next((flown[name] for name in same if name in flown), None)
        if stiff is not None and self._options.ssp is None:
            flights[WITHOUT_SSP] = stiff
        return flights

    def converge(self) -> Mapping[str, Convergence]:
        """Return the convergence with each actuator, with exact sensors too, except stiff bus and missing delay."""
        names = [a for a in self.actuators if a not in (STIFF, UNDELAYED)]
        names += [each for a in names if (each := WITHOUT_ENCODER.format(a)) in self.makers]
        manoeuvre = replace(AGGRESSIVE.hinged(self._options.hinge), duration=3.0)
        return {name: measure(self.makers[name], manoeuvre,
                              progress=lambda share, n=name: self._progress(f"convergence {n}", share))  # type: ignore[misc]
                for name in names}

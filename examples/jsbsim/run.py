"""What a run flies: the manoeuvres with each actuator, in each master, and the convergence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from emcas_fmu.bench.fmu import opened
from emcas_fmu.errors import EmcasError
from emcas_fmu.fitting import Fit
from emcas_fmu.ssp.schema import NOMINAL

from .actuators import Actuators, Ideal
from .build import build_unit
from .convergence import Convergence, measure
from .flight import AGGRESSIVE, MANOEUVRES, Manoeuvre, fly
from .fmu import BUS_RESISTANCE, WIRED, Fmu
from .masters import VARIANT, InMaster, write_archive
from .results import UNDELAYED, WITHOUT_ENCODER, WITHOUT_SSP, Flight, Results
from .second_order import SecondOrder, fit, undelayed

Progress = Callable[[str, float], None]
"""Called with what is done now, and its share from 0 to 1."""


@dataclass(frozen=True)
class Options:
    """What is asked for; `bus_resistance` in Ohm, `bus_voltage` in V, `step` in s."""

    manoeuvres: tuple[str, ...]
    actuators: tuple[str, ...]
    """Of results.ACTUATORS."""
    step: float = 1e-3
    fmu: Path | None = None
    """Built if not given."""
    guid: str | None = None
    bus_resistance: float | None = None
    """BUS_RESISTANCE for a unit of four if not given."""
    bus_voltage: float | None = None
    """The unit's, or the archive's, start value if not given."""
    mixing: bool = False
    masters: tuple[str, ...] = ()
    """Of masters.MASTERS."""
    ssp: Path | None = None
    """Made of the single actuator if not given."""
    variant: str = NOMINAL
    """Of `ssp`."""
    convergence: bool = True


def run(options: Options, folder: Path, progress: Progress) -> Results:
    """Fly; FMUs and an archive that are not given are made in `folder`. Raises EmcasError."""
    if options.ssp is not None and not options.masters:
        raise EmcasError(f"--ssp {options.ssp}: is flown in another master only: give --host, too")
    if options.variant != NOMINAL and options.ssp is None:
        raise EmcasError(f"--variant {options.variant}: is a variant of an archive: give --ssp, too")
    flier = _Flier(options, folder, progress)
    flights = {name: {each: flier.fly(MANOEUVRES[name], each, flier.makers[each]) for each in flier.actuators}
               for name in options.manoeuvres}
    masters = {name: flier.in_masters(MANOEUVRES[name], flights[name]) for name in options.manoeuvres
               if options.masters}
    converged = flier.converge() if options.convergence else {}
    return Results(options.step, flights, MANOEUVRES, flier.second_order, converged, flier.guid, flier.unit,
                   flier.resistance, flier.voltage, masters)


class _Flier:
    """The actuators of a run; whatever is wrong with them is said before long work."""

    def __init__(self, options: Options, folder: Path, progress: Progress) -> None:
        self._options, self._progress = options, progress
        self.second_order: Fit | None = None
        self.guid, self.unit, self.resistance, self._whole = "", "EMCAS4.fmu", 0.0, False
        self.voltage: float | None = None
        actuators = [*options.actuators]
        self.makers: dict[str, Callable[[], Actuators]] = {"ideal": Ideal}
        if actuators != ["ideal"]:
            self._prepare(folder)
            if len(actuators) > 1 and self.resistance == 0.0 and "nonlinear" in actuators:
                actuators = [a for a in actuators if a != "stiff"]  # it would be the same flight again
        self.actuators = tuple(actuators)
        self._archive, self._variant = options.ssp, options.variant
        if options.masters and options.ssp is None:
            self._archive, self._variant = self._write_archive(folder), VARIANT
        for master in options.masters:
            self._in(master)().close()

    def _prepare(self, folder: Path) -> None:
        options = self._options
        if options.fmu is None:
            self._progress("build", 0.0)
        path = options.fmu or build_unit(folder, 4)
        trial = Fmu(path, options.guid, bus_voltage=options.bus_voltage)
        trial.close()
        self._whole, self.voltage = trial.whole, trial.supply
        chosen = options.bus_resistance
        self.resistance = chosen if chosen is not None else BUS_RESISTANCE if trial.whole else 0.0
        self.unit = "EMCAS4.fmu" if trial.whole else "EMCAS.fmu"
        with opened(path) as unit:
            self.guid = unit.description.guid

        def nonlinear(resistance: float, parameters: Mapping[str, bool | float] = WIRED) -> Callable[[], Actuators]:
            return lambda: Fmu(path, parameters=parameters, bus_resistance=resistance,
                               bus_voltage=options.bus_voltage, mixing=options.mixing)

        nonlinear(self.resistance)().close()
        self.second_order = found = fit(path)
        second, prompt = found.parameters, undelayed(found.parameters)
        self.makers |= {"second-order": lambda: SecondOrder(second), UNDELAYED: lambda: SecondOrder(prompt),
                        "nonlinear": nonlinear(self.resistance),
                        "stiff": nonlinear(0.0),
                        WITHOUT_ENCODER: nonlinear(self.resistance, {**WIRED, "encoder.enabled": False})}

    def _write_archive(self, folder: Path) -> Path:
        given = self._options.fmu
        if given is not None and self._whole:
            raise EmcasError(f"{given}: is one unit of four, and an archive wires single actuators: give --ssp FILE "
                             "(see `emcas ssp`), or leave --fmu away")
        self._progress("archive", 0.0)
        return write_archive(folder / "EMCAS.ssp", given or build_unit(folder, 1))

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
        stiff = flown.get("stiff") or (flown.get("nonlinear") if self.resistance == 0.0 else None)
        if stiff is not None and self._options.ssp is None:
            found[WITHOUT_SSP] = stiff
        return found

    def converge(self) -> Mapping[str, Convergence]:
        """Of every actuator but variants, the stiff bus and the model without delay, and of the FMU without encoder."""
        names: Iterable[str] = [a for a in self.actuators if a not in ("stiff", UNDELAYED)]
        if "nonlinear" in self.actuators:
            names = [*names, WITHOUT_ENCODER]
        manoeuvre = replace(AGGRESSIVE, duration=3.0)
        return {name: measure(self.makers[name], manoeuvre,
                              progress=lambda share, n=name: self._progress(f"convergence {n}", share))  # type: ignore[misc]
                for name in names}

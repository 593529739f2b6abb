"""References inside the FMU, by the layered standard FMI-LS-REF: experiments that any host can repeat.

https://github.com/modelica/fmi-ls-ref; the format of experiments, now a separate standard, is that of FMI-LS-REF
1.0.0-alpha.1. The results are those of the actuator's independent integration (:mod:`emcas_fmu.reference`), if there is
one and the actuator's extensions change nothing in the case. Otherwise this package's stepping computes the results,
and the FMU says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, floor, log10
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ..actuators import get, parts
from ..pages.page import page
from ..parameters import ParameterError, ParameterSet
from ..reference import files
from ..reference.cases import CASES, STEP_AND_LOAD, TOLERANCE, ReferenceCase
from ..reference.plant import Plant
from ..reference.responses import response, shipped
from ..simulation import Array, simulate
from ..support.progress import Progress, silent
from .description import element, to_bytes
from .format import Format
from .interface import FmuInterface

NAME, VERSION = "org.fmi-standard.fmi-ls-ref", "1.0.0-beta.1"
FOLDER = f"extra/{NAME}"
MANIFEST = "fmi-ls-manifest.xml"
TEXT = "documentation/fmi-ls-ref.txt"
EXPERIMENTS, PARAMETERS, TABLE = "application/x-ma-hs-experiments", "application/x-ssp-parameter-set", "text/csv"
ROLES = {True: "validation", False: "smoke-test"}  # of experiments, by `EmbeddedExperiment.independent`
_SSP = "http://ssp-standard.org/SSP1/SystemStructure"

_SHIPPED = ("step", "load_opposing", "cold", "sag")  # cases of a single fin, if their responses are stored
_FINS = ("step_plus10", "step_minus5", "step_plus20", "step_minus1")  # cases of several fins in turn
_FINS_STOP = 0.3  # s: stop time of these cases; it is short, since each fin may have to be integrated
# Digits kept after the first digit of a variable's nominal value. Differences between machines, about 1e-12 of the
# value, then rarely change a digit; the rounding error is less than a hundredth of the tolerance.
_DIGITS = 6


@dataclass(frozen=True)
class EmbeddedExperiment:
    """Start values and stimuli for an FMU, and the expected results, by names of variables, in SI.

    `stop_time` and `step` are in s. `independent` is whether the results are those of the independent integration.
    """

    name: str
    title: str
    stop_time: float
    step: float
    start_values: Mapping[str, Any]
    stimuli: Mapping[str, Array]
    results: Mapping[str, Array]
    independent: bool
    difference: float
    """Largest difference [rad] between the results' fin angles and those of this package's stepping; 0 if the same."""


def reference_files(
        interface: FmuInterface, sets: Sequence[ParameterSet], fmi: Format, progress: Progress = silent,
        ) -> tuple[dict[str, bytes], tuple[str, ...], tuple[EmbeddedExperiment, ...]]:
    """Return the references of an FMU whose fins have these parameters: files of the archive, warnings, experiments."""
    warnings: list[str] = []
    experiments = tuple(_experiments(interface, sets, fmi, warnings, progress))
    return (_files(interface, experiments) if experiments else {}), tuple(dict.fromkeys(warnings)), experiments


def _experiments(interface: FmuInterface, sets: Sequence[ParameterSet], fmi: Format, warnings: list[str],
                 progress: Progress) -> Iterator[EmbeddedExperiment]:
    chosen = _cases(sets)
    for done, (name, title, cases) in enumerate(chosen):
        progress(f"reference {name}", done, len(chosen))
        try:
            fins = [_response(p, case, warnings) for p, case in zip(sets, cases, strict=True)]
        except (ArithmeticError, ParameterError) as error:
            warnings.append(f"the FMU has no reference {name}, since it cannot be computed: {error}")
            continue
        yield EmbeddedExperiment(
            name, title, cases[0].stop_time, cases[0].step, fmi.in_files(interface, [case.overrides for case in cases]),
            fmi.in_files(interface, [case.inputs() for case in cases]),
            fmi.in_files(interface, [_rounded(interface, columns) for columns, *_ in fins]),
            all(independent for _, independent, _ in fins), max(difference for *_, difference in fins))


def _cases(sets: Sequence[ParameterSet]) -> list[tuple[str, str, list[ReferenceCase]]]:
    """Return name, title and the fins' cases of each experiment."""
    by_name = {case.name: case for case in CASES}
    if len(sets) > 1:
        fins = [replace(files.suited(by_name[_FINS[fin % len(_FINS)]], p.model, p.values), stop_time=_FINS_STOP)
                for fin, p in enumerate(sets)]
        return [("fins", "Each fin alone: " + "; ".join(case.title for case in fins), fins)]
    plain = _plain(sets[0])
    stored = [case for case in (files.suited(by_name[name], plain.model, plain.values) for name in _SHIPPED)
              if shipped(plain, case)]
    return [(case.name, case.title, [files.suited(case, sets[0].model, sets[0].values)])
            for case in stored or [STEP_AND_LOAD]]


def _plain(parameters: ParameterSet) -> ParameterSet:
    """Return the parameters of an actuator without its extensions."""
    plain, _ = parts(parameters.model)
    names = {v.name for v in get(plain).file_entries}
    return ParameterSet(tuple(e for e in parameters.entries if e.variable.name in names), plain)


def _response(parameters: ParameterSet, case: ReferenceCase, warnings: list[str],
              ) -> tuple[Mapping[str, Array], bool, float]:
    """Return the response in a case, whether it is integrated independently, and `difference` [rad].

    Raises ArithmeticError or ParameterError if the actuator's equations cannot be computed.
    """
    plain = _plain(parameters)
    extended = plain.model != parameters.model
    stepped = _stepped(parameters, case)
    if not extended and (stored := shipped(plain, case)) is not None:
        return stored, True, _difference(stepped, stored)
    has_reference = plain.actuator.reference is not None
    if has_reference and (not extended or all(np.array_equal(stepped[name], column)
                                              for name, column in _stepped(plain, case).items())):
        try:
            independent = _integrated(plain, case)
            difference = _difference(stepped, independent)
        except Exception as error:  # noqa: BLE001  a user's integration may raise or return anything
            warnings.append(f"the independent integration of {case.name} failed ({error!r}): the FMU contains the "
                            "package's response instead")
        else:
            if difference > TOLERANCE:
                warnings.append(f"{case.name}: fin_angle differs by up to {degrees(difference):.2g} deg from the "
                                f"independent integration, more than the usual {degrees(TOLERANCE):g} deg; a smaller "
                                "solver.max_tick may reduce it")
            return independent, True, difference
    return {name: stepped[name] for name in ("time", *Plant.names) if name in stepped}, False, 0.0


def _difference(stepped: Mapping[str, Array], independent: Mapping[str, Array]) -> float:
    """Return the largest difference [rad] between the fin angles of two responses."""
    return float(np.max(np.abs(stepped["fin_angle"] - independent["fin_angle"])))


def _integrated(parameters: ParameterSet, case: ReferenceCase) -> Mapping[str, Array]:
    """Return the outputs of the independent integration. Raises ValueError if a value is not finite."""
    computed = response(parameters, files.suited(case, parameters.model, parameters.values))
    columns = {name: np.asarray(computed[name], dtype=float)
               for name in ("time", *(v.name for v in parameters.actuator.outputs)) if name in computed}
    if bad := [name for name, column in columns.items() if not np.isfinite(column).all()]:
        raise ValueError(f"{bad[0]} is not finite")
    return columns


def _stepped(parameters: ParameterSet, case: ReferenceCase) -> Mapping[str, Array]:
    """Return the response by this package's stepping in Python; the FMUs of both back ends give the same bits."""
    inputs = case.inputs()
    del inputs["time"]
    values = {**parameters.values, **files.suited(case, parameters.model, parameters.values).overrides}
    return simulate(values, case.stop_time, case.step, "python", parameters.model, **inputs)


def _files(interface: FmuInterface, experiments: Sequence[EmbeddedExperiment]) -> dict[str, bytes]:
    listed: list[tuple[str, str, str, str, bytes]] = []  # name, type, role, description, content
    for independent, role in ROLES.items():
        if group := [each for each in experiments if each.independent is independent]:
            what = "Results by independent integration" if independent else "Results by the FMU's stepping"
            listed.append((f"{role}.exp", EXPERIMENTS, f"experiment/{role}", what,
                           to_bytes(_experiments_of(interface, what, group))))
    for each in experiments:
        if each.start_values:
            listed.append((f"{each.name}.ssv", PARAMETERS, "parameter", f"Start values that differ: {each.title}",
                           to_bytes(_parameter_set(each))))
        listed += [
            (f"{each.name}_in.csv", TABLE, "other", f"Stimuli: {each.title}", files.csv_text(each.stimuli).encode()),
            (f"{each.name}_ref.csv", TABLE, "result", f"Results: {each.title}", files.csv_text(each.results).encode())]
    text = page(
        "fmi/references.txt.j2", model=interface.model, kind=interface.actuator.name, fins=interface.fins,
        standard=VERSION, arrays=any(column.ndim > 1 for each in experiments for column in each.stimuli.values()),
        folder=FOLDER, experiments=experiments, degrees=degrees, ROLES=ROLES,
        roles={ROLES[each.independent] for each in experiments},
        reference=Path(str(get(parts(interface.kind)[0]).reference)).name, tolerance=degrees(TOLERANCE))
    document = f"../../{TEXT}", "text/plain", "document", "How the references were computed, and how to repeat them"
    related = (element("Related", {"type": kind, "source": source, "role": role, "description": description})
               for source, kind, role, description in (*(row[:4] for row in listed), document))
    manifest = element("fmiReferences", {
        "xmlns:fmi-ls": "http://fmi-standard.org/fmi-ls-manifest", "fmi-ls:fmi-ls-name": NAME,
        "fmi-ls:fmi-ls-version": VERSION,
        "fmi-ls:fmi-ls-description": "Layered Standard providing information on related files included in an FMU."},
        related)
    return {**{f"{FOLDER}/{name}": content for name, *_, content in listed}, TEXT: f"{text}\n".encode(),
            f"{FOLDER}/{MANIFEST}": to_bytes(manifest)}


def _experiments_of(interface: FmuInterface, what: str, experiments: Sequence[EmbeddedExperiment]) -> Element:
    return element("Experiments", {"name": interface.model, "description": what}, (
        element("Experiment", {
            "name": each.name, "description": each.title, "startTime": "0", "stopTime": f"{each.stop_time:g}",
            "tolerance": f"{TOLERANCE:.3g}", "stepSize": f"{each.step:g}"}, [
                *([element("Parameters", {"source": f"{each.name}.ssv"})] if each.start_values else ()),
                element("Stimuli", {"source": f"{each.name}_in.csv"}),
                element("References", {"source": f"{each.name}_ref.csv"})]) for each in experiments))


def _parameter_set(experiment: EmbeddedExperiment) -> Element:
    def parameter(name: str, value: Any) -> Element:
        if isinstance(value, np.ndarray):  # SSP 1.0 has no arrays
            kind, text = "String", " ".join(str(each).lower() for each in value.tolist())
        else:
            kind, text = ("Boolean", str(value).lower()) if isinstance(value, bool) else ("Real", repr(float(value)))
        return element("ssv:Parameter", {"name": name}, [element(f"ssv:{kind}", {"value": text})])

    return element("ssv:ParameterSet", {
        "xmlns:ssv": f"{_SSP}ParameterValues", "xmlns:ssc": f"{_SSP}Common", "version": "1.0",
        "name": experiment.name, "description": experiment.title}, [
            element("ssv:Parameters", {}, [parameter(*item) for item in experiment.start_values.items()])])


def _rounded(interface: FmuInterface, columns: Mapping[str, Array]) -> dict[str, Array]:
    nominal = {v.name: v.nominal or 1.0 for v in interface.actuator.outputs}
    return {name: column if name == "time" else np.round(column, _DIGITS - floor(log10(nominal[name])))
            for name, column in columns.items()}

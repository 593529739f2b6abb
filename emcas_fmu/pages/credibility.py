"""The credibility card of a model: its use, its limits, facts about it, and checks that were not done.

The factors are those of NASA-STD-7009A (2016); the card claims none of the standard's levels. A fact is computed when
the card is made, or read from the parameter files. If a command determines the fact, the card names it.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from pydantic import TypeAdapter

from .. import __version__
from ..actuators import EXTENSIONS, FMU_ONLY, NONLINEAR, get, parts
from ..parameters import IDENTIFIED, ParameterSet, Scalar
from ..reference.files import parameters_hash
from .provenance import repeatable

SCHEMA = "emcas-credibility/1"
"""Name and version of the JSON layout; the number changes when a field is removed or changes its meaning."""
CARD_FILE = "documentation/credibility.json"
"""Path of the card inside an FMU."""
NOT_DONE = "not done here"
USE = "The model is for 6-DOF simulations: it computes fin angles from fin commands and hinge moments."
APPLIES = "they apply to a device as far as the parameters are those of the device"
DATA, VERIFICATION, VALIDATION, INPUTS, UNCERTAINTY, ROBUSTNESS, HISTORY, MANAGEMENT = (
    "Data pedigree", "Verification", "Validation", "Input pedigree", "Uncertainty characterization",
    "Results robustness", "M&S history", "M&S process/product management")
CONVERGENCE, TEST_INPUTS = "accuracy of the stepping, checked with a shorter tick", "inputs, which the host supplies"


@dataclass(frozen=True)
class Fact:
    """A fact: its name `what`, its `value` in `unit` or in words, and the `names` of the parameters concerned.

    `command` determines the fact; it is empty if no command does. The value of an undetermined fact is NOT_DONE.
    """

    what: str
    value: Scalar | str
    unit: str = ""
    names: tuple[str, ...] = ()
    note: str = ""
    command: str = ""


@dataclass(frozen=True)
class CredibilityFactor:
    """A factor of credibility, and the facts for it."""

    name: str
    facts: tuple[Fact, ...]


@dataclass(frozen=True)
class Card:
    """The credibility card of an actuator or of several fins, with the hash of the parameter values of each fin."""

    schema: str
    model: str
    values_sha256: tuple[str, ...]
    use: str
    limits: tuple[str, ...]
    factors: tuple[CredibilityFactor, ...]

    @property
    def rows(self) -> list[tuple[str, Fact]]:
        """The facts, each after the name of its factor, which is empty except at the factor's first fact."""
        return [(factor.name * (not k), fact) for factor in self.factors for k, fact in enumerate(factor.facts)]

    @property
    def not_done(self) -> list[str]:
        """The names of the facts that were not determined."""
        return [fact.what for _, fact in self.rows if fact.value == NOT_DONE]

    def having(self, name: str, *facts: Fact) -> Card:
        """Return the card with `facts` in the factor `name`; they replace those of the same `what`, not commands."""
        new = {fact.what: fact for fact in facts}

        def updated(factor: CredibilityFactor) -> CredibilityFactor:
            present = [replace(new.pop(f.what), command=f.command) if f.what in new else f for f in factor.facts]
            return replace(factor, facts=(*present, *new.values()))

        return replace(self, factors=tuple(updated(each) if each.name == name else each for each in self.factors))

    def as_dict(self) -> dict[str, Any]:
        """Return the card for JSON, with the list `not_done`."""
        return {**asdict(self), "not_done": self.not_done}


def read(content: bytes) -> Card | None:
    """Return the card from the content of its JSON file, None for another `schema`. Raises ValueError if damaged."""
    try:
        document = json.loads(content)
        return TypeAdapter(Card).validate_json(content, strict=True) if document["schema"] == SCHEMA else None
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"is not a credibility card ({error!r})") from error


def card(sets: Sequence[ParameterSet], fmu: str = "", configuration: Iterable[Fact] = (),
         compared: Sequence[Fact] = ()) -> Card:
    """Return the card of fins with these parameters; `fmu` is the file's name, empty for parameters alone.

    `configuration` are additional facts on management. `compared` are facts on comparisons with references; they get
    the command of ``emcas validate``.
    """
    model = sets[0].model
    actuator, extensions = parts(model)
    source, integrated = get(actuator).source, get(actuator).reference is not None and not extensions
    # No command accepts half an actuator, or one with the torque interface, as its --model, or runs its FMU.
    options = [each for each in extensions if each not in FMU_ONLY]
    runs = len(options) == len(extensions)
    option = f"--model {'+'.join((shlex.quote(source.name) if source else actuator, *options))}"
    files = [[s.file for s in repeatable(p).sources if s.sha256] for p in sets]
    common = [file for file in files[0] if all(file in each for each in files)]  # a command's files apply to all fins
    settings = "".join(f" {each}" for each in (*([option] if actuator != NONLINEAR or options else ()),
                                               *(f"--parameters {shlex.quote(file)}" for file in common)))
    external = f" {option}" if source else ""
    build, article = f"emcas build{settings} --output A.fmu; ", shlex.quote(fmu or "A.fmu") + external
    identified = {e.variable.name: e.note for p in sets for e in p.entries if e.source == IDENTIFIED}
    with_sigma = tuple(name for name, note in identified.items() if "1 sigma" in note)
    records = list(dict.fromkeys(record[1:] for p in sets for record in p.measured))
    factors = {
        DATA: [*([Fact("equations", get(model).origin)] if get(model).origin else ()),
               *_sources(sets, settings, [each == common for each in files])],
        VERIFICATION: [*(replace(fact, command=f"emcas validate {article}") for fact in compared),
                       *([] if compared else [Fact(
                           "comparison with an independent integration", NOT_DONE,
                           note="" if integrated else "this actuator has none",
                           command=f"{build}emcas validate A.fmu{external}" if integrated else "")]),
                       Fact(CONVERGENCE, NOT_DONE, command=
                            f"{'' if fmu else build}emcas report {article}" if runs else ""),
                       Fact("Python against native FMU", NOT_DONE, command=
                            "emcas baseline record PYTHON.fmu; emcas baseline check NATIVE.fmu" if runs else "")],
        VALIDATION: [*(Fact(f"record {name}", use or "parameters were identified from it",
                            note=f"SHA-256 {sha256}") for name, sha256, use in records),
                     *([Fact("records of the identified parameters", NOT_DONE, note="the parameter file names none")]
                       if identified and not records else ()),
                     *([Fact("comparison with measurements that were not fitted", NOT_DONE, command=
                             f"emcas calibrate FITTED.csv --hold-out OTHER.csv --free NAMES{settings}")]
                       if not any(use.startswith("held out") for *_, use in records) else ())],
        INPUTS: [Fact(TEST_INPUTS, NOT_DONE)],
        UNCERTAINTY: [*([Fact("identified parameters, 1 sigma in their notes", len(with_sigma), names=with_sigma)]
                        if with_sigma else ()),
                      Fact("effect of uncertain parameters, loads and faults on results", NOT_DONE,
                           command=f"emcas campaign CAMPAIGN.toml{f' --fmu {shlex.quote(fmu)}' if fmu else ''}"
                           if runs else "")],
        ROBUSTNESS: [Fact("sensitivity to each estimate", NOT_DONE,
                          command=f"emcas parameters{settings} --sensitivity TORQUE")],
        HISTORY: [Fact("earlier uses and their results", NOT_DONE)],
        MANAGEMENT: [*_configuration(sets), *configuration,
                     *([Fact("second build with the same bytes", NOT_DONE, note="emcas build with the same options")]
                       if fmu else ())]}
    missing = [name for name in EXTENSIONS if name not in extensions]
    warnings = dict.fromkeys(warning for p in sets for warning in p.warnings)
    return Card(
        SCHEMA, get(model).name, tuple(parameters_hash(p.values) for p in sets), USE,
        (f"Results describe the model; {APPLIES}.",
         *([f"The model does not have the extensions {', '.join(missing)}."] if missing else ()),
         *(() if runs else ["emcas report, validate, baseline and campaign cannot run this FMU: it does not have all "
                            "inputs of an actuator."]), *warnings),
        tuple(CredibilityFactor(name, tuple(facts)) for name, facts in factors.items()))


def _sources(sets: Sequence[ParameterSet], settings: str, described: Sequence[bool]) -> Iterator[Fact]:
    """Yield the number of parameters from each source, then the identified values; fins with equal facts share them.

    `described` says for each fin whether `settings` are all its parameter files.
    """
    counted: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    changed = {name for each in repeatable(*sets).sources for name in each.changed}
    identified: dict[tuple[str, float, str, str], list[int]] = {}
    for fin, p in enumerate(sets, 1):
        by_source: dict[str, list[str]] = {}
        for e in p.entries:
            by_source.setdefault(e.source or "none", []).append(e.variable.name)
            if e.source == IDENTIFIED:
                identified.setdefault((e.variable.name, e.value, e.variable.unit, e.note), []).append(fin)
        for source, names in by_source.items():
            counted.setdefault((source, tuple(names)), []).append(fin)

    def of_fins(fins: list[int]) -> str:
        return "" if len(fins) == len(sets) else f" of fin {', '.join(map(str, fins))}"

    for (origin, listed), fins in counted.items():
        in_files = all(described[fin - 1] for fin in fins) and (origin != "user" or changed.isdisjoint(listed))
        yield Fact(f"parameters{of_fins(fins)}, source: {origin}", len(listed), names=listed,
                   command=f"emcas parameters{settings}" if in_files else "")
    for (name, value, unit, note), fins in identified.items():
        yield Fact(f"{name}{of_fins(fins)}", value, unit, note=note)


def _configuration(sets: Sequence[ParameterSet]) -> Iterator[Fact]:
    """Yield the version, the actuator, the parameter files, and the hashes of files and values."""
    yield Fact("version", f"emcas {__version__}")
    yield Fact("actuator", get(sets[0].model).name)
    actuator = get(parts(sets[0].model)[0])
    for file in filter(None, (actuator.source, *actuator.files)):
        yield Fact(f"actuator's {file.name}", f"SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()}")
    for source in repeatable(*sets).sources:
        value = source.file + "; changed afterwards" * bool(source.changed)
        yield Fact(source.what, value, names=source.changed, note=" ".join([
            *([f"SHA-256 {source.sha256}."] if source.sha256 else ()),
            *([f"Values, SHA-256 {source.values_sha256}."] if source.values_sha256 else ())]))

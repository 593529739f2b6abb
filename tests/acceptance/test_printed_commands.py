"""Sentences and commands that pages and messages print are true of the actuator that they are about."""

from __future__ import annotations

import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import of_fmu
from emcas_fmu.actuators.plant_fault import PlantFault
from emcas_fmu.cli import app
from emcas_fmu.fmi.interface import AZIMUTH, fin_sets
from emcas_fmu.namespace import namespace
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.pages.credibility import Card, Fact, card
from emcas_fmu.parameters import load_parameters
from emcas_fmu.parameters.schema import In
from emcas_fmu.studies.campaign.distributions import distribution
from emcas_fmu.variables import tunable

EXAMPLES = {"TORQUE": "100", "NAMES": "motor.resistance"}  # for the words in commands that a reader replaces
CANNOT_RUN = "cannot run this FMU: it does not have all inputs of an actuator."


def facts(of: Card) -> dict[str, Fact]:
    return {fact.what: fact for factor in of.factors for fact in factor.facts}


@pytest.mark.parametrize(("model", "part", "interface"), [
    ("nonlinear", "plant", "angle"), ("elastic+heat", "controller", "angle"), ("worm-gear", None, "torque")])
def test_commands_for_an_fmu_without_all_inputs_work(model: str, part: str | None, interface: str) -> None:
    """No command runs this FMU; the commands that read parameters or fit records do so for the whole actuator."""
    of = card([load_parameters(model=of_fmu(model, part, interface))], "EMCAS.fmu")
    commands = [shlex.split(fact.command)[1:] for fact in facts(of).values() if fact.command]
    assert {arguments[0] for arguments in commands} == {"parameters", "calibrate"}
    assert all(model == "nonlinear" or arguments[arguments.index("--model") + 1] == model for arguments in commands)
    for arguments in commands:
        done = CliRunner().invoke(app, [EXAMPLES.get(each, each) for each in arguments])
        if arguments[0] == "parameters":
            assert done.exit_code == 0, done.output
        else:
            assert "FITTED.csv: cannot be read: there is no such file" in done.output
    assert sum(CANNOT_RUN in limit for limit in of.limits) == 1


def test_a_whole_actuator_has_all_commands() -> None:
    of = card([load_parameters(model="elastic+heat")], "EMCAS.fmu")
    assert not any(CANNOT_RUN in limit for limit in of.limits)
    assert {shlex.split(fact.command)[1] for fact in facts(of).values() if fact.command} == {
        "parameters", "report", "baseline", "calibrate", "campaign"}


@pytest.mark.parametrize(("layout", "changed"), [("plus", (2, 3, 4)), ("cross", (1, 2, 3, 4))])
def test_fins_name_a_value_that_differs_from_the_files(layout: str, changed: tuple[int, ...]) -> None:
    found = facts(card(fin_sets(load_parameters(), 4, layout), "EMCAS4.fmu"))
    of_fins = [found[f"parameters of fin {n}"] for n in range(1, 5)]
    for n, fact in enumerate(of_fins, 1):
        assert (fact.value, fact.names) == (("the shipped parameters; changed afterwards", (AZIMUTH,)) if n in changed
                                            else ("the shipped parameters", ()))
        assert fact.note.startswith("Values, SHA-256 ")
        assert fact.note.endswith(".")
    # No command prints the azimuth that emcas build sets.
    assert {what: fact.names for what, fact in found.items() if what.startswith("parameters") and not fact.command
            and fact not in of_fins} == {
        f"parameters{' of fin 2, 3, 4' if layout == 'plus' else ''}, source: user": (AZIMUTH,)}


@pytest.mark.parametrize(("table", "message"), [
    ({"distribution": "uniform", "low": 2, "high": 1}, "low = 2 must be below high = 1"),
    ({"distribution": "triangular", "low": 1, "mode": 3, "high": 2}, "mode = 3 must be within 1 .. 2"),
    ({"distribution": "normal", "mean": 1, "sd": 0}, "sd = 0: must be above 0 (a percentage refers to the mean)")])
def test_a_pure_number_is_printed_without_a_unit(table: dict[str, object], message: str) -> None:
    for unit, suffix in (("1", ""), ("s", " s")):
        # Text with a unit where the entry has one.
        entry = {key: f"{value} {unit}" if suffix and key != "distribution" else value for key, value in table.items()}
        with pytest.raises(ValueError) as refused:  # noqa: PT011  # compared as a whole
            distribution(entry, In(unit))
        begin, colon, end = message.partition(":")
        assert str(refused.value) == f"{begin}{suffix}{colon}{end}"


def test_a_fault_scales_the_elements_of_an_array() -> None:
    fault = PlantFault.scaling("dry", "no grease", tunable("factor", "1", 1.0, 10.0, "of the friction"), "a.b", "c")
    p = namespace({"a.b[0]": 1.0, "a.b[1]": 2.0, "c": 3.0})
    assert fault.changes(FLOATS, p, SimpleNamespace(factor=3.0)) == {"a.b": (3.0, 6.0), "c": 9.0}


def test_validate_prints_the_files_that_it_writes(tmp_path: Path) -> None:
    files = {option: tmp_path / f"of{option}.{ending}" for option, ending in (
        ("--report", "html"), ("--json", "json"), ("--junit", "xml"))}
    done = CliRunner().invoke(app, ["validate", "--case", "step_plus20", *(
        str(each) for pair in files.items() for each in pair)])
    assert [line for line in done.output.splitlines() if line.startswith("written ")] == [
        f"written {path}" for path in files.values()]
    assert all(path.is_file() for path in files.values())


def test_commands_have_only_files_of_all_fins(tmp_path: Path) -> None:
    """A file of one fin is in no command, and facts on this fin have no command that reads parameters."""
    path = tmp_path / "f2.toml"
    path.write_text("motor.resistance = { value = 0.3, unit = 'ohm', source = 'datasheet' }\n", encoding="utf-8")
    found = facts(card([load_parameters(), load_parameters(path)], "EMCAS2.fmu"))
    assert not [fact for fact in found.values() if path.name in fact.command]
    estimates = {what: fact.command for what, fact in found.items() if what.endswith("source: estimate")}
    assert estimates == {"parameters of fin 1, source: estimate": "emcas parameters",
                         "parameters of fin 2, source: estimate": ""}

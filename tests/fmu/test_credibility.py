"""The credibility card of an FMU: its page and its JSON agree, and each claims only what is known."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
import typer
from lxml import html
from typer.testing import CliRunner

from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.documentation import documents
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.pages.credibility import CARD_FILE, NOT_DONE, USE, Card, CredibilityFactor, Fact, card, read
from emcas_fmu.pages.numbers import with_unit
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.reference.files import parameters_hash
from tests.fmu.built import lean
from tests.own_actuator.example import FILE as OWN
from tests.validation.test_validate import rewritten

ROOT = Path(__file__).resolve().parents[2]
EMPS = ROOT / "examples" / "emps" / "emps.py"
FITTED, UNSEEN = "f" * 64, "0" * 64
PARAMETERS = f"""# Record a.csv, SHA-256 {FITTED}: fitted; fin_angle rms 0.1 deg
# Record `b`.csv, SHA-256 {UNSEEN}: held out; fin_angle rms 0.2 deg
"motor.resistance" = {{ value = "251", unit = "mOhm", source = "identified", note = "1 sigma 0.002 Ohm; a.csv" }}
"""


def page_and_json(sets: Sequence[ParameterSet], fmi: str = "2", names: str = "structured"
                  ) -> tuple[str, dict[str, Any]]:
    """Return page and JSON of an FMU without references; `sets` has the parameters of each fin."""
    interface = FmuInterface(len(sets), sets[0].model, names)
    files = documents(interface, sets, "{guid}", "native", FORMATS[fmi], ("linux64",))
    return files["documentation/index.html"].decode(), json.loads(files[CARD_FILE])


def facts(document: Mapping[str, Any], factor: str) -> dict[str, dict[str, Any]]:
    """Return the facts of a factor by name."""
    return {fact["what"]: fact for each in document["factors"] if each["name"] == factor for fact in each["facts"]}


def words(element: Any) -> str:
    """Return the text of an element of the page."""
    return " ".join(element.text_content().split())


def as_shown(fact: Mapping[str, Any]) -> str:
    """Return the page's text for a fact of the JSON."""
    value = fact["value"] if isinstance(fact["value"], str) else with_unit(fact["value"], fact["unit"])
    names, note = ", ".join(fact["names"]), fact["note"].replace("`", "")
    return " ".join((value + (f": {names}" if names else "") + (f". {note}" if note else "")).split())


@pytest.fixture
def parameter_file(tmp_path: Path) -> Path:
    """Return a parameter file that `emcas identify` could have written."""
    file = tmp_path / "mine.toml"
    file.write_text(PARAMETERS, encoding="utf-8")
    return file


@pytest.mark.parametrize(("model", "fins", "fmi", "names"), [
    ("nonlinear", 1, "2", "structured"), ("nonlinear", 2, "3", "structured"), ("elastic+heat", 1, "2", "flat"),
    (str(OWN), 1, "3", "structured"), (str(EMPS), 1, "2", "structured")], ids=lambda each: Path(str(each)).stem)
def test_page_and_json_agree(model: str, fins: int, fmi: str, names: str) -> None:
    base = load_parameters(model=model)
    page, document = page_and_json(fin_sets(base, fins, "cross", {}) if fins > 1 else [base], fmi, names)
    (heading,) = html.fromstring(page).xpath('//h2[@id="credibility"]')
    (table,) = html.fromstring(page).xpath('//table[contains(caption, "Factors of credibility")]')
    rows = [[words(cell) for cell in row] for row in table.xpath("tbody/tr")]
    assert [row[0] for row in rows if row[0]] == [each["name"] for each in document["factors"]]
    assert [row[1:] for row in rows] == [[fact["what"], as_shown(fact), fact["command"]]
                                         for each in document["factors"] for fact in each["facts"]]
    section = words(heading.getparent())
    for sentence in (document["use"], *document["limits"], *document["not_done"]):
        assert " ".join(sentence.split()) in section
    assert document["use"] == USE


@pytest.mark.parametrize("model", ["nonlinear", str(OWN), str(EMPS)], ids=lambda model: Path(model).stem)
def test_every_parameter_is_counted_once(model: str) -> None:
    base = load_parameters(model=model)
    _, document = page_and_json([base])
    pedigree = facts(document, "Data pedigree")
    counted = {what.removeprefix("parameters, source: "): fact for what, fact in pedigree.items()
               if what.startswith("parameters, ")}
    assert {source: fact["value"] for source, fact in counted.items()} == Counter(e.source for e in base.entries)
    assert sorted(name for fact in counted.values() for name in fact["names"]) == sorted(base.values)
    assert tuple(counted["estimate"]["names"]) == base.estimates


def test_shipped_parameters_are_not_validated() -> None:
    _, document = page_and_json([load_parameters()])
    assert {fact["value"] for fact in facts(document, "Validation").values()} == {NOT_DONE}
    assert "comparison with an independent integration" in document["not_done"]  # of an FMU without references


def test_identified_parameters_have_their_records(parameter_file: Path) -> None:
    parameters = load_parameters(parameter_file)
    _, document = page_and_json([parameters])
    resistance = facts(document, "Data pedigree")["motor.resistance"]
    assert (resistance["value"], resistance["unit"]) == (0.251, "Ohm")
    assert resistance["note"] == "1 sigma 0.002 Ohm; a.csv"
    validation = facts(document, "Validation")
    assert {what: (fact["value"], fact["note"]) for what, fact in validation.items()} == {
        "record a.csv": ("fitted; fin_angle rms 0.1 deg", f"SHA-256 {FITTED}"),
        "record `b`.csv": ("held out; fin_angle rms 0.2 deg", f"SHA-256 {UNSEEN}")}
    configuration = facts(document, "M&S process/product management")
    assert configuration["parameters"]["value"] == "mine.toml"
    assert sha256(parameter_file.read_bytes()).hexdigest() in configuration["parameters"]["note"]
    assert parameters_hash(parameters.values) in configuration["parameters"]["note"]
    # If another value replaces the identified one, the card has no records.
    _, document = page_and_json([parameters.with_values({"motor.resistance": 0.3})])
    assert [*facts(document, "Validation")] == ["comparison with measurements that were not fitted"]


def test_records_that_were_fitted_do_not_validate(tmp_path: Path) -> None:
    (tmp_path / "fitted.toml").write_text("\n".join(PARAMETERS.splitlines()[::2]), encoding="utf-8")
    (tmp_path / "bare.toml").write_text(PARAMETERS.splitlines()[2], encoding="utf-8")
    for name, others in (("fitted", "record a.csv"), ("bare", "records of the identified parameters")):
        validation = facts(page_and_json([load_parameters(tmp_path / f"{name}.toml")])[1], "Validation")
        assert [*validation] == [others, "comparison with measurements that were not fitted"]
        assert f"--free NAMES --parameters {name}.toml" in validation[[*validation][1]]["command"]


def test_card_names_the_fin_with_other_parameters(parameter_file: Path) -> None:
    _, document = page_and_json(fin_sets(load_parameters(), 2, "cross", {2: parameter_file}))
    pedigree = facts(document, "Data pedigree")
    assert "motor.resistance of fin 2" in pedigree
    assert pedigree["parameters of fin 2, source: identified"]["names"] == ["motor.resistance"]
    assert "parameters, source: thesis" in pedigree  # equal in both fins


def test_card_of_a_users_actuator_names_its_file_without_the_folder() -> None:
    _, document = page_and_json([load_parameters(model=str(OWN))])
    value = facts(document, "M&S process/product management")[f"actuator's {OWN.name}"]["value"]
    assert value == f"SHA-256 {sha256(OWN.read_bytes()).hexdigest()}"
    assert str(OWN.parent) not in json.dumps(document)


@pytest.mark.parametrize("fmu", ["", "EMCAS.fmu"])
@pytest.mark.parametrize("model", ["elastic+heat", str(OWN)], ids=lambda model: Path(model).stem)
def test_every_command_exists_with_its_options(model: str, fmu: str) -> None:
    commands = [fact.command for _, fact in card([load_parameters(model=model)], fmu).rows if fact.command]
    assert commands
    for command in "; ".join(commands).split("; "):
        emcas, *rest = shlex.split(command)
        assert emcas == "emcas"
        parser: Any = typer.main.get_command(app)
        while rest and rest[0] in getattr(parser, "commands", {}):
            parser = parser.commands[rest.pop(0)]
        options = {name for parameter in parser.params for name in parameter.opts}
        assert {word for word in rest if word.startswith("--")} <= options, command


def test_readme_and_card_state_the_same_use() -> None:
    assert USE in " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())


def test_new_fact_replaces_the_fact_of_the_same_name_and_keeps_its_command() -> None:
    facts = Fact("a", NOT_DONE, command="c"), Fact("b", NOT_DONE)
    before = Card("", "", (), "", (), (CredibilityFactor("F", facts),))
    after = before.having("F", Fact("a", 1.0, "deg"), Fact("new", 2))
    assert after.factors[0].facts == (Fact("a", 1.0, "deg", command="c"), Fact("b", NOT_DONE), Fact("new", 2))
    assert (before.not_done, after.not_done) == (["a", "b"], ["b"])


def test_a_card_is_read_as_written() -> None:
    whole = card([load_parameters()])
    content = json.dumps(whole.as_dict())
    assert read(content.encode()) == whole
    assert read(content.replace("emcas-credibility/1", "emcas-credibility/2").encode()) is None
    for damaged in ("", "[]", "{}", '"x"', "[" * 100_000, content.replace('"facts": [', '"facts": [3, '),
                    content.replace('"what": "version"', '"what": 3'), content.replace('"limits"', '"limit"')):
        with pytest.raises(ValueError, match="is not a credibility card"):
            read(damaged.encode())


@pytest.mark.fmu
def test_report_uses_the_embedded_card_if_it_is_intact(parameter_file: Path, tmp_path: Path) -> None:
    """A damaged card is an error; a card for other values is ignored."""
    fmu = lean(load_parameters(parameter_file), tmp_path / "mine.fmu")
    with open_subject(fmu) as subject:
        embedded = json.loads((subject.fmu.folder / CARD_FILE).read_bytes())  # type: ignore[attr-defined]
        reported = subject.card.as_dict()
    assert "record a.csv" in facts(reported, "Validation")
    assert sha256(fmu.read_bytes()).hexdigest() in facts(reported, "M&S process/product management")["file"]["note"]
    assert json.loads(json.dumps(reported["factors"][:-1])) == embedded["factors"][:-1]

    def changed(before: bytes, after: bytes) -> Path:
        return rewritten(fmu, tmp_path / "changed.fmu",
                         lambda name, content: content.replace(before, after) if name == CARD_FILE else content)

    with open_subject(changed(embedded["values_sha256"][0].encode(), b"0" * 64)) as subject:
        document = subject.card.as_dict()
        pedigree = facts(document, "Data pedigree")
    assert "no card for its values" in facts(document, "M&S process/product management")["file"]["note"]
    assert "motor.resistance" not in pedigree
    assert pedigree["parameters, source: user"]["names"] == ("motor.resistance",)  # the others are the default ones
    with (open_subject(changed(b'"factors"', b'"factor"')) as subject,
          pytest.raises(EmcasError, match=r"changed\.fmu: documentation/credibility\.json is not a credibility card")):
        subject.card  # noqa: B018
    done = CliRunner().invoke(app, ["report", str(tmp_path / "changed.fmu"), "--output", str(tmp_path / "r.html")])
    assert (done.exit_code, (tmp_path / "r.html").exists()) == (2, False)

"""Later parameter files override earlier ones in every command, and written files give the same set."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.parameters import Entry, load_parameters, write_parameters
from emcas_fmu.studies.campaign.study import load_study
from tests.commands import emcas, refusal

BENCH = Path(__file__).resolve().parents[2] / "examples" / "identification_bench" / "records"
COMMANDS = (
    "parameters", "build", "simulate --step 1", "reference --directory refs", "analyse", "compare", "envelope", "tune",
    "explore", "fit", "report", "report unit.toml", "baseline record unit.toml -o base", "ssp",
    *(f"identify {kind} {BENCH}/{kind}*.csv" for kind in (
        "friction", "drive", "backlash", "inertia")))


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Write two parameter files, which contain a common parameter with different values."""
    monkeypatch.chdir(tmp_path)
    low, high = tmp_path / "low.toml", tmp_path / "high.toml"
    low.write_text('motor.resistance = { value = 251, unit = "mOhm", source = "datasheet", note = "a \\"note\\"" }\n'
                   'encoder.pulses = 1024\nloads.gravity = true\n', encoding="utf-8")
    high.write_text('motor.resistance = "0.3 Ohm"\n"friction.coulomb.positive[1]" = "0.0123 N*m"\n', encoding="utf-8")
    return low, high


def test_later_file_overrides_an_earlier_one(files: tuple[Path, Path]) -> None:
    low, high = files
    values = load_parameters(files).values
    assert (values["motor.resistance"], values["encoder.pulses"], values["loads.gravity"]) == (0.3, 1024, True)
    assert load_parameters((high, low)).values["motor.resistance"] == 0.251
    records = json.loads(emcas("parameters", "-p", low, "-p", high, "--json").stdout)
    assert {r["name"]: r["value"] for r in records} == dict(values)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_reads_every_file(command: str, files: tuple[Path, Path]) -> None:
    low, _ = files
    Path("unit.toml").write_text("", encoding="utf-8")
    Path("bad.toml").write_text("nonsense = 1\n", encoding="utf-8")
    words = [argument for word in command.split()
             for argument in (sorted(BENCH.glob(Path(word).name)) if "*" in word else [word])]
    for first, second in ((low, "bad.toml"), ("bad.toml", low)):
        message = refusal(*words, "-p", first, "-p", second)
        assert "bad.toml: nonsense = 1: unknown parameter" in message


def test_subject_is_identified_by_all_its_files(files: tuple[Path, Path]) -> None:
    low, high = files
    with open_subject(low, parameters=[high]) as subject:
        assert subject.values == load_parameters(files).values
        assert subject.identification.file == "low.toml, high.toml"
        both = subject.identification.sha256
    with open_subject(None, parameters=files) as subject:
        assert subject.identification.sha256 == both
    with open_subject(low) as subject:
        assert subject.identification.sha256 != both


def test_parameters_for_an_fmu_are_refused(files: tuple[Path, Path], fmu: Path) -> None:
    for command in (("report", fmu), ("baseline", "record", fmu)):
        assert "contains its parameters" in refusal(*command, "-p", files[0])


def test_campaign_reads_several_files(files: tuple[Path, Path]) -> None:
    study = files[0].with_name("study.toml")
    study.write_text('[base]\nparameters = ["low.toml", "high.toml"]\n'
                     '[vary."motor.resistance"]\ndistribution = "uniform"\nlow = "90 %"\nhigh = "110 %"\n'
                     '[experiments.step]\nkind = "step"\namplitude = "5 deg"\nduration = "0.3 s"\n', encoding="utf-8")
    assert load_study(study).base == load_parameters(files).values


def test_written_file_gives_the_same_set(files: tuple[Path, Path]) -> None:
    """Values, units, sources and notes. An array is written whole only if all its elements were set together."""
    low, high = files
    whole = low.with_name("whole.toml")
    whole.write_text('[friction]\n"table.viscous[0]" = 1.5\n'
                     'coulomb.negative = { value = [1, 0, 0, 0, 0, 0, 0], unit = "mN*m", source = "bench" }\n',
                     encoding="utf-8")
    chosen = load_parameters((low, high, whole))
    written = low.with_name("emcas.toml")  # the name of the default set's file is allowed
    write_parameters(chosen, written, ["A comment."])
    again = load_parameters(written)
    write_parameters(again, whole, ["A comment."])

    def contents(e: Entry) -> tuple[object, ...]:
        return e.variable, e.value, e.source, e.note

    assert [contents(e) for e in again.entries] == [contents(e) for e in chosen.entries]
    text = written.read_text(encoding="utf-8")
    assert whole.read_text(encoding="utf-8") == text
    assert text.startswith("# A comment.\n")
    assert "friction.coulomb.negative = { value = [0.001, 0.0, " in text
    assert len(text.splitlines()) == 2 + 6  # the comment, an empty line, and the 6 changed parameters


def test_fit_keeps_sources_and_notes(files: tuple[Path, Path]) -> None:
    low, _ = files
    limit = low.with_name("limit.toml")
    limit.write_text('command.limit = { value = 21, unit = "deg", source = "datasheet", note = "a \\"note\\"" }\n',
                     encoding="utf-8")
    done = emcas("fit", "-p", low, "-p", limit, "-o", "fitted.toml")
    assert done.exit_code == 0
    assert "second_order.damping = " in done.output
    assert " 1\n" not in done.output  # no unit 1 that reads as a digit
    fitted = {e.variable.name: e for e in load_parameters("fitted.toml", model="second-order").entries}
    assert (fitted["command.limit"].source, fitted["command.limit"].note) == ("datasheet", 'a "note"')
    assert "motor.resistance" not in fitted
    assert fitted["second_order.damping"].source == "estimate"

"""Files of the identification: a parameter file that can be loaded, continued and built; report; JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.studies.identification import backlash
from emcas_fmu.studies.identification.result import Identification, write_identified
from tests.commands import emcas

from .conftest import BENCH, shipped


@pytest.fixture(scope="module")
def chained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with a user's value, which all four experiments read and extend one after another."""
    file = tmp_path_factory.mktemp("chain") / "mine.toml"
    resistance = '{ value = 251, unit = "mOhm", source = "datasheet", note = "a \\"note\\"" }'
    file.write_text(f"[motor]\nresistance = {resistance}\n", encoding="utf-8")
    for kind in ("drive", "inertia", "friction", "backlash"):
        result = emcas("identify", kind, *shipped(kind), "-p", file, "-o", file)
        assert result.exit_code == 0, result.stderr
    return file


def test_file_contains_identified_values_and_keeps_the_others(
        chained: Path, identified: Mapping[str, Identification]) -> None:
    loaded = load_parameters(chained)
    entries = {e.variable.name: e for e in loaded.entries}
    changed = {name for name, e in entries.items() if e.source == "identified"}
    assert changed == {e.name for r in identified.values() for e in r.estimates if e.parameter}
    for kind in ("inertia", "friction"):
        for e in identified[kind].estimates:
            if e.parameter:
                # Values are written to a hundredth of sigma; the earlier identified inertia changes friction slightly.
                assert abs(entries[e.name].value - e.value) < 0.1 * e.sigma
                assert "1 sigma" in entries[e.name].note
                assert kind in entries[e.name].note  # the data files
    entry = entries["motor.resistance"]
    assert (entry.value, entry.source, entry.note) == (0.251, "datasheet", 'a "note"')
    text = chained.read_text(encoding="utf-8")
    assert "# Reported, no parameter: backlash = 0.0" in text
    assert "# Reported, no parameter: total inertia at the motor" in text
    assert str(chained.parent) not in text
    assert {(r.name, r.sha256) for r in loaded.measured} == {
        (p.name, sha256(p.read_bytes()).hexdigest()) for kind in identified for p in shipped(kind)}
    assert all(re.fullmatch(r"fitted, residual \S+ \S+", r.use) for r in loaded.measured)


def test_identified_file_is_listed_and_builds_an_fmu(chained: Path, tmp_path: Path) -> None:
    records = json.loads(emcas("parameters", "-p", chained, "--json").stdout)
    (kp,) = [r for r in records if r["name"] == "drive.kp"]
    assert (kp["source"], kp["unit"]) == ("identified", "V/A")
    built = build(load_parameters(chained), tmp_path / "Identified.fmu", references=False)
    assert built.path.stat().st_size > 0


def test_json_and_report_of_the_command(tmp_path: Path) -> None:
    page, figures = tmp_path / "r.html", tmp_path / "f.json"
    result = emcas("identify", "inertia", *shipped("inertia"), "--report", page, "--json", figures)
    assert result.exit_code == 0, result.stderr
    document = json.loads(figures.read_text(encoding="utf-8"))
    assert document["estimates"]["inertia.motor"]["sigma"] > 0.0
    assert len(document["correlation"]["matrix"]) == len(document["correlation"]["names"])
    assert [f["file"] for f in document["files"]] == [p.name for p in shipped("inertia")]
    assert str(BENCH) not in figures.read_text(encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 2
    assert "http" not in text.replace("http://www.w3.org", "").replace("/*! https://", "")  # a library's first line
    assert "Residuals" in text
    assert "autocorrelation" in text


@pytest.mark.drawn
@pytest.mark.slow
def test_report_has_its_plots_and_is_reproducible(identified: Mapping[str, Identification], tmp_path: Path) -> None:
    pictures = {"friction": 3, "drive": 4, "inertia": 2, "backlash": 3}
    for kind, result in identified.items():
        pages = [tmp_path / f"{kind}{i}.html" for i in range(2)]
        for page in pages:
            result.write_report(page)
        first, second = (p.read_bytes() for p in pages)
        assert first == second
        assert first.count(b"<svg") == pictures[kind]


def test_columns_may_have_other_units_and_order(tmp_path: Path) -> None:
    (file,) = shipped("backlash")
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    other = tmp_path / "other.csv"
    scaled = np.column_stack([table[:, 0] * 1e3, np.radians(table[:, 2]), table[:, 1] / (2.0 * np.pi), table[:, 0]])
    np.savetxt(other, scaled, fmt="%.12g", delimiter=";", header="time [ms];fin_angle;motor_angle [turn];extra",
               comments="")
    base = load_parameters()
    one, two = (backlash.identify([f], base)["backlash"] for f in (file, other))
    assert two.value == pytest.approx(one.value, rel=1e-6)  # 12 digits in the file
    assert two.sigma == pytest.approx(one.sigma, rel=1e-4)


def test_friction_at_one_temperature_keeps_the_cold_ratios() -> None:
    warm = [f for f in shipped("friction") if "minus" not in f.name]
    result = emcas("identify", "friction", *warm, "--keep-cold-ratios")
    assert result.exit_code == 0, result.stderr
    assert "friction.table.viscous[1]" not in result.stdout
    assert "cold ratios are those of the base" in result.stdout


def test_negative_friction_is_not_written(identified: Mapping[str, Identification], tmp_path: Path) -> None:
    # With this coefficient friction is negative at the stops.
    result = identified["friction"]
    estimates = [replace(e, value=-1.0) if e.name == "friction.coulomb.positive[6]" else e for e in result.estimates]
    output = tmp_path / "x.toml"
    with pytest.raises(ParameterError, match=r"friction\.coulomb\.positive"):
        write_identified(replace(result, estimates=estimates), output)
    assert not output.exists()


@pytest.mark.parametrize("command", ["friction", "drive", "backlash", "inertia"])
def test_help_has_examples(command: str) -> None:
    result = emcas("identify", command, "--help")
    assert result.exit_code == 0
    assert f"emcas identify {command}" in result.stdout


def test_note_on_backlash_has_the_gap_along_the_screw() -> None:
    """The simulated gap is 0.06 deg; models/actuators/elastic.toml has 0.05 mm for 0.057 deg."""
    (note,) = (n for n in backlash.identify(shipped("backlash"), load_parameters()).notes if "elastic" in n)
    gap = float(note.partition("backlash = ")[2].partition(" mm")[0])
    # The note has two digits (1 %), 0.057 has two (1 %), and the estimate is accurate to 0.0007 deg (1 %).
    assert gap == pytest.approx(0.05 * 0.06 / 0.057, rel=0.03)

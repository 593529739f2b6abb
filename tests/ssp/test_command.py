"""The commands `emcas ssp` and `emcas ssp check`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .conftest import Edit, emcas


def test_warning_about_the_temperature_appears_once(native: Path, tmp_path: Path) -> None:
    """Four fins and two variants are outside the identified range; the variant cold is inside."""
    cold = tmp_path / "cold.toml"
    cold.write_text('friction.temperature = "-40 degC"\n', encoding="utf-8")
    printed = emcas("--fmu", native, "-o", tmp_path / "cold.ssp", "-p", cold)
    assert printed.count("warning: friction.temperature = -40 degC is outside") == 1


def test_written_archive_passes_the_check(native: Path, tmp_path: Path) -> None:
    target, fin = tmp_path / "four.ssp", tmp_path / "second.toml"
    fin.write_text('[motor]\nresistance = "0.5 Ohm"\n')
    printed = emcas("--fmu", native, "-o", target, "--layout", "plus", "--fin", f"2={fin}")
    assert "variants nominal (SystemStructure.ssd), cold (cold.ssd), degraded (degraded.ssd)" in printed
    assert "passed, 0 warnings" in emcas("check", target, "--fmu", native)


def test_one_fin_is_singular(native: Path, tmp_path: Path) -> None:
    assert "1 fin, FMU" in emcas("--fmu", native, "--fins", "1", "-o", tmp_path / "one.ssp")


def test_check_of_a_wrong_archive_fails(edit: Edit, tmp_path: Path) -> None:
    archive = edit("SystemStructure.ssd", 'endConnector="aero_torque"', 'endConnector="aero_torqe"')
    printed = emcas("check", archive, "--json", tmp_path / "f.json", code=1)
    assert "failed, 4 errors" in printed
    findings = json.loads((tmp_path / "f.json").read_text())["findings"]
    assert "connection fin2_aero_torque -> fin2.aero_torqe" in [f["place"] for f in findings]


def test_output_names_the_files_that_were_not_checked(edit: Edit) -> None:
    printed = emcas("check", edit("SystemStructure.ssd", 'kind="input"', 'kind="inlet"'), code=1)
    assert "not checked until these errors are corrected: wiring and parameters of SystemStructure.ssd" in printed
    assert "variants cold, degraded" in printed
    assert "not checked" not in emcas("check", edit("SystemStructure.ssd"))


@pytest.mark.parametrize(("arguments", "expected"), [
    (["check", "none.ssp"], "none.ssp: cannot be read"),
    (["check", "none.ssp", "--guid", "x", "--fmu", "y"], "--fmu and --guid exclude each other"),
    (["--fmu", "none.fmu"], "none.fmu: cannot be read"),
    (["--fin", "5=a.toml"], "fin 5=a.toml: the FMU has fins 1 to 4"),
    (["--fin", "second.toml"], "--fin second.toml: expected a fin's number from 1 on and a file"),
    (["--variant", "hot"], "--variant hot: expected NAME=FILE"),
    (["--variant", "nominal=a.toml"], "'nominal' cannot name a variant"),
    (["--variant", "SystemStructure=a.toml"], "'SystemStructure' cannot name a variant"),
    (["--variant", "hot=a.toml"], "a.toml: cannot be read"),
    (["-p", "a.toml"], "a.toml: cannot be read"),
])
def test_wrong_arguments_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str],
                                     expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in emcas(*arguments, code=2)
    assert not list(tmp_path.iterdir())


def test_help_has_examples() -> None:
    assert "emcas ssp check EMCAS.ssp" in emcas("--help")
    assert "emcas ssp check vehicle.ssp --json findings.json" in emcas("check", "--help")

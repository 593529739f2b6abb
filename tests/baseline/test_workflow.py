"""The workflow for users' repositories: its shell lines, run in a repository, pass and fail as documented."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import junitparser
import pytest
import yaml

from emcas_fmu.runtime.compiler import local_platform
from tests.docs.recipes import ROOT

from .conftest import check, record

WORKFLOW = yaml.safe_load((ROOT / "examples/ci/emcas.yml").read_text(encoding="utf-8"))
JOB: Mapping[str, Any] = WORKFLOW["jobs"]["actuator"]
TRIGGERS = WORKFLOW[True]  # the key `on`, which YAML 1.1 reads as true
LOCAL = local_platform()
CALL = {"cases": "step_plus1", "package": "emcas-fmu", "platforms": LOCAL.name if LOCAL else ""}
QUICK = {**CALL, "package": "pip"}  # installed already, without dependencies

needs_bash = pytest.mark.skipif(shutil.which("bash") is None or os.name == "nt", reason="there is no bash")


def value(expression: str, inputs: Mapping[str, str]) -> str:
    """Return the value of an expression `${{ inputs.name || 'text' }}`, the only form in the job's environment."""
    match = re.fullmatch(r"\$\{\{ inputs\.([\w-]+) \|\| '(.*)' \}\}", expression)
    assert match, expression
    assert match[1] in TRIGGERS["workflow_call"]["inputs"]
    return inputs.get(match[1]) or match[2]


def run(folder: Path, inputs: Mapping[str, str]) -> dict[str, int]:
    """Run the steps with shell lines like GitHub and return their exit codes.

    After a failure only steps with a condition run.
    """
    state, summary = folder / ".env", folder / "summary.md"
    state.touch()
    environment = {**os.environ, **{name: value(text, inputs) for name, text in JOB["env"].items()},
                   "GITHUB_ENV": str(state), "GITHUB_STEP_SUMMARY": str(summary), "PIP_NO_INDEX": "1",
                   "PIP_DISABLE_PIP_VERSION_CHECK": "1",
                   "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
    codes: dict[str, int] = {}
    outcomes: dict[str, str] = {}
    for step in (step for step in JOB["steps"] if "run" in step):
        condition = step.get("if")
        assert condition in (None, "${{ !cancelled() && steps.model.outcome == 'success' }}")
        if any(codes.values()) and not (condition and outcomes.get("model") == "success"):
            continue
        extra = dict(line.split("=", 1) for line in state.read_text().splitlines())
        # GitHub's default shell for `run` on Linux is `bash -e`.
        result = subprocess.run(["bash", "-e", "-c", step["run"]], cwd=folder, env={**environment, **extra},
                                capture_output=True, text=True, timeout=120)
        codes[step["name"]] = result.returncode
        outcomes[step.get("id", "")] = "failure" if result.returncode else "success"
        (folder / "log.txt").write_text(result.stdout + result.stderr)
    return codes


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A user's repository with a parameter file and its approved baseline."""
    (tmp_path / "actuator.toml").write_text('[motor]\ntorque_constant = "0.105 N*m/A"\n')
    record(tmp_path)
    return tmp_path


@pytest.mark.slow
@needs_bash
@pytest.mark.fmu
def test_workflow_passes_without_a_change(repository: Path) -> None:
    codes = run(repository, CALL)
    assert codes == {"Install": 0, "Build the FMU": 0, "Validate": 0, "Compare with the approved baseline": 0}
    reports = repository / "reports"
    assert {p.name for p in reports.iterdir()} == {"actuator.fmu", "references", "validation.xml", "validation.html",
                                                   "drift.xml", "drift.html"}
    assert junitparser.JUnitXml.fromfile(str(reports / "drift.xml")).failures == 0
    assert "no drift" in (repository / "summary.md").read_text()


@pytest.mark.slow
@needs_bash
@pytest.mark.fmu
def test_workflow_fails_with_a_table_of_the_drift(repository: Path, native: Path) -> None:
    """The user's FMU has other parameters than the baseline."""
    shutil.copy(native, repository / "mine.fmu")
    (repository / "actuator.toml").unlink()
    codes = run(repository, {**QUICK, "fmu": "mine.fmu"})
    assert codes == {"Install": 0, "Build the FMU": 0, "Validate": 0, "Compare with the approved baseline": 1}
    summary = (repository / "summary.md").read_text()
    assert "**DRIFT**" in summary
    assert "| motor.torque_constant | 0.105 N.m/A | 0.11 N.m/A |" in summary
    assert "emcas baseline record mine.fmu --output baseline" in summary


@pytest.mark.slow
@needs_bash
def test_workflow_fails_at_once_with_a_bad_parameter_file(repository: Path) -> None:
    (repository / "actuator.toml").write_text('[motor]\nresistence = "1 Ohm"\n')
    assert run(repository, QUICK) == {"Install": 0, "Build the FMU": 2}
    assert "motor.resistence" in (repository / "log.txt").read_text()


def test_workflow_uses_every_input_and_pins_its_actions() -> None:
    used = set(re.findall(r"inputs\.([\w-]+)", (ROOT / "examples/ci/emcas.yml").read_text(encoding="utf-8")))
    assert used == set(TRIGGERS["workflow_call"]["inputs"])
    assert {"push", "pull_request", "workflow_dispatch", "workflow_call"} == set(TRIGGERS)
    actions = [step["uses"] for step in JOB["steps"] if "uses" in step]
    assert len(actions) == 3
    assert all(re.fullmatch(r"actions/[\w-]+@v\d+", action) for action in actions)


def test_parameter_file_changes_the_article(short: Path) -> None:
    stiffer = short / "stiffer.toml"
    stiffer.write_text('controller.position.kp = "80 1/s"\n', encoding="utf-8")
    printed = " ".join(check(short, "--parameters", stiffer, code=1).split())
    assert f"emcas baseline record {short / 'actuator.toml'} --parameters {stiffer} --output" in printed
    record(short, "--parameters", stiffer)
    check(short, "--parameters", stiffer)
    check(short, code=1)
    recorded = (short / "baseline" / "baseline.toml").read_text(encoding="utf-8")
    assert "emcas baseline record actuator.toml --parameters stiffer.toml" in recorded

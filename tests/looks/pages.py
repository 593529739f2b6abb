"""A page of every kind, written by the users' commands, with short studies."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from typer.testing import CliRunner

from docs.thesis.__main__ import app as thesis
from emcas_fmu.cli import app
from emcas_fmu.fmi.documentation import documents
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import load_parameters
from tests.docs.recipes import ROOT
from tests.explore.browser import write_page

GUID = "{0}"  # on all pages, whatever the FMU

CAMPAIGN = """
[campaign]
samples = 24
seed = 5
[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"
[vary."motor.back_emf_constant"]
follows = "motor.torque_constant"
[vary."friction.temperature"]
distribution = "uniform"
low = "-6 degC"
high = "24 degC"
[inputs.aero_torque]
kind = "constant"
value = { distribution = "uniform", low = "-40 N.m", high = "0 N.m" }
[experiments.step]
kind = "step"
amplitude = "5 deg"
duration = "0.3 s"
"""
STUDY = """
[tunables]
"controller.position.kp" = { lower = "40 1/s", upper = "65 1/s" }
"controller.velocity.kp" = { lower = "0.034 V*s/rad", upper = "0.044 V*s/rad" }
[cases.nominal]
[cases.cold]
"friction.temperature" = "-6 degC"
[[requirements]]
name = "settling"
title = "Settling of a step"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "settling_time"
maximum = "60 ms"
[[requirements]]
name = "overshoot"
title = "Overshoot of a step"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "overshoot"
maximum = "2 %"
"""


def emcas(*arguments: object, program: object = app) -> None:
    """Run a command; requirements may be missed (exit code 1)."""
    done = CliRunner().invoke(program, list(map(str, arguments)))  # type: ignore[arg-type]
    assert done.exit_code in (0, 1), done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output


def documentation(page: str) -> None:
    files = documents(FmuInterface(1, "nonlinear"), (load_parameters(),), GUID, "native", FORMATS["2"], ("linux64",))
    Path(page).write_bytes(files["documentation/index.html"])


def baseline(page: str) -> None:
    emcas("baseline", "record", "-o", "approved")
    Path("changed.toml").write_text('[motor.resistance]\nvalue = 0.5\nunit = "Ohm"\nsource = "estimate"\n', "utf-8")
    emcas("baseline", "check", "-b", "approved", "changed.toml", "--report", page)


def calibration(page: str) -> None:
    emcas("simulate", "--step", 10, "--output", "step.csv")
    emcas("calibrate", "step.csv", "--free", "motor.resistance,drive.current_gain", "-o", "c.toml", "--report", page)


def friction(page: str) -> None:
    records = sorted((ROOT / "examples" / "identification_bench" / "records").glob("friction_*.csv"))
    emcas("identify", "friction", *(shutil.copy(path, path.name) for path in records), "--report", page)


def campaign(page: str) -> None:
    Path("campaign.toml").write_text(CAMPAIGN, "utf-8")
    emcas("campaign", "campaign.toml", "-o", "samples", "--workers", 0, "--requirements", "shipped", "--report", page)


def tuning(page: str) -> None:
    Path("study.toml").write_text(STUDY, "utf-8")
    emcas("tune", "study.toml", "-o", "tuned.toml", "--report", page, "--generations", 1, "--workers", 1)


def jsbsim(page: str) -> None:
    subprocess.run([sys.executable, ROOT / "examples" / "jsbsim" / "fly.py", "--manoeuvre", "gentle", "--step", "4",
                    "--no-convergence", "-o", "flight"], check=True, stdout=subprocess.DEVNULL)
    text = Path("flight/report.html").read_text("utf-8")
    Path(page).write_text(re.sub(r"\{[0-9a-f-]{36}\}", GUID, text), "utf-8")  # of the FMU; changes with its interface


PAGES: Mapping[str, Callable[[str], object]] = {
    "simulate": lambda page: emcas("simulate", "--step", 10, "--torque", -50, "--plot", page),
    "envelope": lambda page: emcas("envelope", "--plot", page),
    "analyse": lambda page: emcas("analyse", "--report", page),
    "compare": lambda page: emcas("compare", "nonlinear", "second-order", "electrohydraulic", "--report", page),
    "validate": lambda page: emcas("validate", "--report", page),
    "report": lambda page: emcas("report", "-o", page),
    "baseline": baseline, "calibration": calibration, "friction": friction, "campaign": campaign, "tuning": tuning,
    "documentation": documentation, "jsbsim": jsbsim,
    "thesis": lambda page: emcas("--only", "3.4", "--only", "5.8", "--only", "Table 4", "--only", "Table 20", "-o",
                                 page, program=thesis),
    "explore": lambda page: shutil.move(write_page(Path(), "nonlinear"), page)}
SITE: Mapping[str, str] = {"front": "index.html", "models": "model/models.html", "control": "model/control.html"}
"""Pages of the site, with their paths in it."""
NAMES = (*PAGES, *SITE)


def page_path(name: str, folder: Path, site: Callable[[], Path]) -> Path:
    """Return the path of a page: of the site, or written in a folder on first use.

    The folder is the working directory meanwhile, so that the page contains no path.
    """
    if name in SITE:
        return site() / SITE[name]
    page = folder / name / f"{name}.html"
    if not page.is_file():
        page.parent.mkdir()
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SOURCE_DATE_EPOCH", "1775001600")
            patch.chdir(page.parent)
            PAGES[name](page.name)
    return page

"""Wheel and source archive contain exactly the package and its data, and work without the repository."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from datetime import date
from pathlib import Path

import pytest
import yaml

from emcas_fmu import __author__, __copyright__, __date__, __license__, __version__
from tests.hosts.host import missing

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "examples/identification_bench/records"
PROGRAMS = "Scripts" if os.name == "nt" else "bin"
# The README's commands that need no extra; MODELS is the installed folder of data, RECORDS the user's.
COMMANDS = (
    "emcas --help", "emcas parameters --sets", "emcas parameters -p drive-pi",
    "emcas build", "emcas validate EMCAS.fmu --report report.html", "fmpy validate EMCAS.fmu", "fmpy info EMCAS.fmu",
    "fmpy simulate EMCAS.fmu --input-file MODELS/reference/EMCAS_step_in.csv --output-file out.csv",
    "emcas simulate --step 10 --torque -50 --plot response.html",
    "emcas build --backend native --cc CC --output Native.fmu", "fmpy validate Native.fmu",
    "emcas build --model electrohydraulic+faults --output Valve.fmu",
    "emcas identify backlash RECORDS/backlash.csv --report backlash.html")


def test_changelog_begins_with_the_version() -> None:
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] in (f"{__version__} ({__date__})", f"{__version__} (unreleased)")
    assert str(date.fromisoformat(__date__)) == __date__


def test_author_and_licence_are_the_same_in_all_files() -> None:
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8").splitlines()
    assert (licence[0], licence[2]) == (f"{__license__} License", __copyright__)
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert ([author["name"] for author in cited["authors"]], cited["license"]) == ([__author__], __license__)
    assert f'\nlicense = "{__license__}"\n' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the source archive, and the wheel that is built from it."""
    if importlib.util.find_spec("build") is None:
        missing("there is no build (pip install build)")
    folder = tmp_path_factory.mktemp("dist")
    run([sys.executable, "-m", "build", "--outdir", folder, ROOT], folder)
    (source,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return source, wheel


def run(command: list[str | Path], folder: Path) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def shipped(folder: str) -> set[str]:
    """Return the names in the wheel of the files in a folder of the repository."""
    paths = (path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    names = {path.relative_to(ROOT).as_posix() for path in paths}
    return names if folder == "emcas_fmu" else {f"emcas_fmu/{name}" for name in names}


@pytest.mark.slow
def test_archives_contain_all_files_and_no_others(archives: tuple[Path, Path]) -> None:
    source, wheel = archives
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.startswith(f"emcas_fmu-{__version__}.dist-info/")}
    assert names == shipped("emcas_fmu") | shipped("models")
    with tarfile.open(source) as tar:
        tops = {Path(name).parts[1] for name in tar.getnames()}
    assert tops == {".gitignore", "CHANGELOG.md", "CITATION.cff", "LICENSE", "PKG-INFO", "README.md", "build_fmu.py",
                    "emcas_fmu", "models", "pyproject.toml"}


@pytest.mark.fmu
@pytest.mark.slow
def test_commands_run_with_only_the_wheel_installed(archives: tuple[Path, Path], tmp_path: Path) -> None:
    """In an environment with the wheel and its required packages: no extra, no file of the repository."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        missing("there is no C compiler (Debian: apt-get install gcc)")
    programs = tmp_path / "environment" / PROGRAMS
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    run([sys.executable, "-m", "venv", tmp_path / "environment"], elsewhere)
    run([programs / "python", "-m", "pip", "install", "--quiet", "--no-compile", archives[1]], elsewhere)
    models = run([programs / "python", "-c", "from emcas_fmu.support.files import models_directory as m; print(m())"],
                 elsewhere).strip()
    assert Path(models).is_relative_to(tmp_path)
    assert run([programs / "emcas", "--version"], elsewhere).split() == ["emcas", __version__]
    for line in COMMANDS:
        for name, path in {"MODELS": models, "RECORDS": RECORDS, "CC": compiler}.items():
            line = line.replace(name, str(path))
        program, *arguments = line.split()
        run([programs / program, *arguments], elsewhere)
    outputs = {path.name for path in elsewhere.iterdir() if path.stat().st_size}
    assert outputs == {"EMCAS.fmu", "Native.fmu", "Valve.fmu", "report.html", "out.csv", "response.html",
                       "backlash.html"}

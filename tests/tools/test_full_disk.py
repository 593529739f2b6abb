"""If the disk becomes full while a command runs, old files keep their bytes, and one line names the cause."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.cli import app
from emcas_fmu.commands import common
from emcas_fmu.reference import files
from emcas_fmu.runtime import library
from emcas_fmu.studies.baseline import comparison
from tests import studies
from tests.marks import slow

OLD = b"# what was there\n"
BENCH = Path(__file__).resolve().parents[2] / "examples" / "identification_bench" / "records"
SMALL = "--model second-order"
# Short commands with their outputs. The fixture `inputs` writes the files that they read.
RUNS = {
    f"simulate --step 1 --stop 0.1 --kernel python {SMALL}": (
        "-o x.csv", "--plot x.svg", "--plot x.png", "--plot x.html", "--json x.json"),
    "envelope": ("-o x.csv", "--plot x.svg", "--plot x.html", "--json x.json"),
    "compare second-order": ("--json x.json", "--report x.html"),
    "fit": ("-o x.toml", "--json x.json"),
    f"identify backlash {BENCH / 'backlash.csv'}": ("-o x.toml", "--report x.html", "--json x.json"),
    f"calibrate step.csv {SMALL} --free second_order.damping": ("-o x.toml", "--report x.html", "--json x.json"),
    f"validate --case step_plus1 {SMALL}": ("--json x.json", "--junit x.xml", "--report x.html"),
    f"baseline check -b made {SMALL}": ("--json x.json", "--junit x.xml", "--markdown x.md", "--report x.html"),
    f"build --no-references {SMALL}": ("-o x.fmu",),
    f"ssp --fmu made.fmu {SMALL}": ("-o x.ssp",),
    "ssp check made.ssp": ("--json x.json",),
    f"campaign campaign.toml {SMALL} --only 1": ("--json x.json", "-o x.csv", "--plot x.svg"),
    f"campaign campaign.toml {SMALL} -o results --workers 0": ("--json x.json", "--report x.html"),
}
SLOW = {
    "analyse --model linear": ("--report x.html", "--json x.json"),
    f"report {SMALL}": ("-o x.html", "--json x.json", "--junit x.xml"),
    f"explore {SMALL}": ("-o x.html",),
    f"tune study.toml {SMALL} --generations 1 --workers 1": ("-o x.toml", "--report x.html", "--json x.json"),
}
FOLDERS = {
    f"baseline record {SMALL} --fresh -o x": ("baseline.toml", "step.csv"),
    "reference --case step_plus1 --directory x": (
        "provenance.toml", "EMCAS_step_plus1_in.csv", "EMCAS_step_plus1_ref.csv", "EMCAS_step_plus1_ref.opt"),
    f"init {SMALL} --force x": ("actuator.toml", "README.md"),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the commands read."""
    folder = tmp_path_factory.mktemp("made")
    library.available("linear")  # otherwise a command prints a further line when it compiles the kernel
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for command in (f"baseline record {SMALL} -o made", f"build --no-references {SMALL} -o made.fmu",
                        f"ssp --fmu made.fmu {SMALL} -o made.ssp",
                        f"simulate --step 2 --stop 0.2 {SMALL} -o step.csv"):
            done = CliRunner().invoke(app, command.split())
            assert done.exit_code == 0, done.output
    (folder / "campaign.toml").write_text(studies.campaign("second_order.rate_limit"))
    (folder / "study.toml").write_text(
        studies.tuning("second_order.natural_frequency", "150 rad/s", "250 rad/s", "20 ms"))
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder, without the parts with which a campaign resumes."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*")
            if path.is_file() and path.parent.name != "results"}


@pytest.fixture
def run_on_full_disk(inputs: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Sequence[str]], Result]:
    """Function that runs a command on a full disk with existing outputs, and asserts that no file changes."""
    def run(command: str, outputs: Sequence[str]) -> Result:
        for output in outputs:
            Path(output).parent.mkdir(exist_ok=True)
            Path(output).write_bytes(OLD)
        before = contents(inputs)
        done = CliRunner().invoke(app, command.split())
        after = contents(inputs)
        for output in outputs:
            Path(output).unlink()
        assert after == before
        return done

    def flush(descriptor: int) -> None:
        if any(os.path.samestat(os.fstat(descriptor), path.stat()) for path in inputs.rglob("*") if path.is_file()):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.chdir(inputs)
    monkeypatch.setattr(os, "fsync", flush)
    for trial in ("try_file", "try_folder"):  # the disk is not yet full when the command begins
        monkeypatch.setattr(common, trial, lambda *_: None)
    return run


def check_error(done: Result) -> None:
    assert done.exit_code == 2, done.output
    (line,) = [line for line in done.stderr.splitlines() if "warning:" not in line and not line.startswith("tune ")]
    assert re.fullmatch(r"error: \S+: cannot be written: the disk is full; free some space or choose another path",
                        line)


@pytest.mark.parametrize(("command", "option"), [
    *((command, option) for command, options in RUNS.items() for option in options),
    *slow(*((command, option) for command, options in SLOW.items() for option in options))])
def test_full_disk_keeps_the_old_file(command: str, option: str,
                                      run_on_full_disk: Callable[[str, Sequence[str]], Result]) -> None:
    check_error(run_on_full_disk(f"{command} {option}", [option.split()[1]]))


@pytest.mark.parametrize(("command", "file"), [
    (f"baseline record {SMALL} --fresh -o x", "step.csv"),
    ("reference --case step_plus1 --directory x", "EMCAS_step_plus1_ref.opt")])
def test_unwritable_file_of_a_folder_is_an_error_before_the_long_run(command: str, file: str, tmp_path: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    def long_run(*_: object, **__: object) -> NoReturn:
        raise AssertionError("the long run has begun")

    monkeypatch.chdir(tmp_path)
    Path("x", file).mkdir(parents=True)
    monkeypatch.setattr(comparison, "record", long_run)
    monkeypatch.setattr(files, "regenerate", long_run)
    done = CliRunner().invoke(app, command.split())
    assert done.exit_code == 2
    assert f"x/{file}: is a folder; give a file for the output" in done.stderr


@pytest.mark.parametrize("command", FOLDERS)
def test_full_disk_keeps_all_old_files_of_a_folder(command: str,
                                                   run_on_full_disk: Callable[[str, Sequence[str]], Result]) -> None:
    check_error(run_on_full_disk(command, [f"x/{name}" for name in FOLDERS[command]]))

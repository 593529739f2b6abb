"""Every command tests all its output paths before it reads or computes anything."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from emcas_fmu.cli import app
from tests.commands import refusal

# None of the inputs is valid: a command that reads them first gives another message.
FILES = {
    "analyse -p bad.toml": ("--json .json", "--report .html"),
    "baseline check bad.toml -b base": ("--json .json", "--junit .xml", "--markdown", "--report .html"),
    "build -p bad.toml": ("-o .fmu",), "calibrate bad.csv --free x": ("-o .toml", "--report .html", "--json .json"),
    "campaign bad.toml": ("--json .json", "--report .html"), "campaign bad.toml --only 1": ("--json .json",),
    "compare bad.toml": ("--json .json", "--report .html"),
    "envelope -p bad.toml": ("-o .csv", "--plot .svg", "--json .json"), "explore -p bad.toml": ("-o .html",),
    "fit -p bad.toml": ("-o .toml", "--json .json"),
    **{f"identify {kind} bad.csv -p bad.toml": ("-o .toml", "--report .html", "--json .json")
       for kind in ("friction", "drive", "backlash", "inertia")},
    "report bad.toml": ("-o .html", "--json .json", "--junit .xml"),
    "simulate --input bad.csv -p bad.toml": ("-o .csv", "--plot .svg", "--json .json"),
    "ssp --fmu bad.fmu": ("-o .ssp",), "ssp check bad.ssp": ("--json .json",),
    "tune bad.toml -p bad.toml": ("-o .toml", "--report .html", "--json .json", "--journal"),
    "validate bad.fmu": ("--json .json", "--junit .xml", "--report .html"),
}
OPTIONS = [(command, option) for command, options in FILES.items() for option in options]
each_file = pytest.mark.parametrize(("command", "option"), OPTIONS)
FOLDERS = {"baseline record bad.toml": "-o", "campaign bad.toml": "-o", "reference -p bad.toml": "--directory"}


@pytest.fixture(autouse=True)
def unusable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Fill the current folder with invalid inputs."""
    monkeypatch.chdir(tmp_path)
    for name in ("bad.toml", "bad.csv", "bad.fmu", "bad.ssp"):
        Path(name).write_text("nonsense = 1\n", encoding="utf-8")
    Path("base").mkdir()
    return tmp_path


def refused(command: str, option: str, output: str) -> str:
    """Return the error message of a command, which must not write anything."""
    before = sorted(Path().rglob("*"))
    message = refusal(*command.split(), option, output)
    assert sorted(Path().rglob("*")) == before
    assert message.count("error:") == 1
    return message


@each_file
def test_output_files_are_tested_first(command: str, option: str) -> None:
    name, _, ending = option.partition(" ")
    Path(f"folder{ending}").mkdir()
    for output, message in ((f"folder{ending}", "is a folder"), (f"none/x{ending}", "there is no folder none"),
                            (f"bad.toml/x{ending}", "there is no folder bad.toml"),
                            (f"{'x' * 300}{ending}", "cannot be written: the name is too long; choose a shorter")):
        assert message in refused(command, name, output)


@pytest.mark.parametrize(("command", "option"), [case for case in OPTIONS if case[1].endswith(
    (".html", ".json", ".csv", ".toml", ".xml"))])
def test_wrong_file_ending_is_refused(command: str, option: str) -> None:
    name, _, ending = option.partition(" ")
    message = refused(command, name, "x.pdf")
    assert f"x.pdf: the name of this file must end in {ending}" in message
    assert ("print the page from a browser" in message) is (ending == ".html")


@pytest.mark.skipif(sys.platform != "linux", reason="needs a folder in which nobody may write")
@pytest.mark.parametrize(("command", "option"), FOLDERS.items())
def test_output_folders_are_tested_first(command: str, option: str) -> None:
    assert "is a file; give a folder" in refused(command, option, "bad.toml")
    assert "is a file; give a folder" in refused(command, option, "bad.toml/x")
    assert "cannot be written" in refused(command, option, "/proc/x")


def test_baseline_does_not_overwrite_its_parameters() -> None:
    Path("baseline.toml").write_text("nonsense = 1\n", encoding="utf-8")
    assert "would be overwritten" in refused("baseline record baseline.toml --fresh", "-o", ".")


@each_file
def test_full_disk_is_reported_first(command: str, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    name, _, ending = option.partition(" ")
    Path(f"old{ending}").write_text("old", encoding="utf-8")
    for output in (f"old{ending}", f"new{ending}"):
        assert re.fullmatch(r"error: \S+: cannot be written: the disk is full; free some space or choose another path",
                            refused(command, name, output))
    assert Path(f"old{ending}").read_text(encoding="utf-8") == "old"


def test_every_output_option_is_tested() -> None:
    def outputs(command: Any, *words: str) -> Iterator[tuple[str, str]]:
        for name, each in getattr(command, "commands", {}).items():
            yield from outputs(each, *words, name)
        yield from ((" ".join(words), option) for parameter in command.params if not getattr(parameter, "is_flag", 0)
                    for option in parameter.opts if option in (
                        "--output", "--plot", "--json", "--junit", "--report", "--markdown", "--journal"))

    tested = {(re.split(" bad| -", command)[0], re.sub("^-o$", "--output", option.partition(" ")[0]))
              for command, option in (*OPTIONS, *FOLDERS.items())}
    # A campaign plots only one sample, and tests this path when the sample is known.
    assert {*outputs(get_command(app))} - tested == {("campaign", "--plot")}


def test_old_file_remains_if_the_command_fails() -> None:
    Path("old.json").write_text("old", encoding="utf-8")
    assert "bad.toml" in refused("fit -p bad.toml", "--json", "old.json")
    assert Path("old.json").read_text(encoding="utf-8") == "old"


def test_references_need_a_directory() -> None:
    assert "--directory is missing" in refusal("reference", "--case", "step_plus1")

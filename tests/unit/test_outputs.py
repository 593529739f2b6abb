"""Every output of every command is tried before anything is read or computed."""

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
from typer.testing import CliRunner

from emcas_fmu.cli import app

# Of the inputs none can be used: a command that begins with them says something else.
FILES = {
    "analyse -p bad.toml": ("--json .json", "--report .html"),
    "baseline check bad.toml -b base": ("--json .json", "--junit .xml", "--markdown", "--report .html"),
    "build -p bad.toml": ("-o .fmu",),
    "calibrate bad.csv --free x": ("-o .toml", "--report .html", "--json .json"),
    "campaign bad.toml": ("--json .json", "--report .html"),
    "campaign bad.toml --only 1": ("--json .json",),
    "compare bad.toml": ("--json .json", "--report .html"),
    "envelope -p bad.toml": ("-o .csv", "--plot .svg", "--json .json"),
    "explore -p bad.toml": ("-o .html",),
    "fit -p bad.toml": ("-o .toml", "--json .json"),
    **{f"identify {kind} bad.csv -p bad.toml": ("-o .toml", "--report .html", "--json .json")
       for kind in ("friction", "drive", "backlash", "inertia")},
    "report bad.toml": ("-o .html", "--json .json", "--junit .xml"),
    "simulate --input bad.csv -p bad.toml": ("-o .csv", "--plot .svg", "--json .json"),
    "ssp --fmu bad.fmu": ("-o .ssp",),
    "ssp check bad.ssp": ("--json .json",),
    "tune bad.toml -p bad.toml": ("-o .toml", "--report .html", "--json .json", "--journal"),
    "validate bad.fmu": ("--json .json", "--junit .xml", "--report .html"),
}
FOLDERS = {"baseline record bad.toml": "-o", "campaign bad.toml": "-o",
           "reference -p bad.toml": "--directory"}


@pytest.fixture(autouse=True)
def unusable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The present folder, with inputs that are none."""
    monkeypatch.chdir(tmp_path)
    for name in ("bad.toml", "bad.csv", "bad.fmu", "bad.ssp"):
        Path(name).write_text("nonsense = 1\n", encoding="utf-8")
    Path("base").mkdir()
    return tmp_path


def refused(command: str, option: str, output: str) -> str:
    """What the command says of the output, before it has written anything."""
    before = sorted(Path().rglob("*"))
    done = CliRunner().invoke(app, [*command.split(), option, output])
    assert done.exit_code == 2, done.output
    assert sorted(Path().rglob("*")) == before
    said = done.stderr.strip().replace("\n", "")
    assert said.count("error:") == 1
    return said


@pytest.mark.parametrize(("command", "option"), [(c, option) for c, options in FILES.items() for option in options])
def test_files_are_tried_first(command: str, option: str) -> None:
    name, _, ending = option.partition(" ")
    Path(f"folder{ending}").mkdir()
    for output, said in ((f"folder{ending}", "is a folder"), (f"none/x{ending}", "there is no folder none"),
                         (f"bad.toml/x{ending}", "there is no folder bad.toml"),
                         (f"{'x' * 300}{ending}", "cannot be written: the name is too long; choose a shorter name")):
        assert said in refused(command, name, output)


@pytest.mark.parametrize(("command", "option"), [(c, option) for c, options in FILES.items() for option in options
                                                 if option.endswith((".html", ".json", ".csv", ".toml", ".xml"))])
def test_files_are_named_after_what_is_in_them(command: str, option: str) -> None:
    name, _, ending = option.partition(" ")
    said = refused(command, name, "x.pdf")
    assert f"x.pdf: the name of this file must end in {ending}" in said
    assert ("print the page from a browser" in said) is (ending == ".html")


@pytest.mark.skipif(sys.platform != "linux", reason="needs a folder in which nobody may write")
@pytest.mark.parametrize(("command", "option"), FOLDERS.items())
def test_folders_are_tried_first(command: str, option: str) -> None:
    assert "is a file; give a folder" in refused(command, option, "bad.toml")
    assert "is a file; give a folder" in refused(command, option, "bad.toml/x")
    assert "cannot be written" in refused(command, option, "/proc/x")


def test_a_baseline_is_not_written_over_its_parameters() -> None:
    Path("baseline.toml").write_text("nonsense = 1\n", encoding="utf-8")
    assert "would be overwritten" in refused("baseline record baseline.toml --fresh", "-o", ".")


@pytest.mark.parametrize(("command", "option"), [(c, option) for c, options in FILES.items() for option in options])
def test_a_disk_that_is_full_already_is_said_first(command: str, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    name, _, ending = option.partition(" ")
    Path(f"old{ending}").write_text("old", encoding="utf-8")
    for output in (f"old{ending}", f"new{ending}"):
        said = refused(command, name, output)
        assert re.fullmatch(r"error: \S+: cannot be written: the disk is full; free some space or choose another path",
                            said)
    assert Path(f"old{ending}").read_text(encoding="utf-8") == "old"


def test_no_output_is_left_out_here() -> None:
    def outputs(command: Any, *called: str) -> Iterator[tuple[str, str]]:
        for name, each in getattr(command, "commands", {}).items():
            yield from outputs(each, *called, name)
        yield from ((" ".join(called), option) for parameter in command.params if not getattr(parameter, "is_flag", 0)
                    for option in parameter.opts if option in (
                        "--output", "--plot", "--json", "--junit", "--report", "--markdown", "--journal"))

    tested = {(re.split(" bad| -", command)[0], re.sub("^-o$", "--output", option.partition(" ")[0]))
              for command, given in (*FILES.items(), *((c, (option,)) for c, option in FOLDERS.items()))
              for option in given}
    # Of campaigns a picture is of one sample, and tried when that is known to be one.
    assert {*outputs(get_command(app))} - tested == {("campaign", "--plot")}


def test_what_is_there_stays_until_it_is_replaced() -> None:
    Path("old.json").write_text("old", encoding="utf-8")
    assert "bad.toml" in refused("fit -p bad.toml", "--json", "old.json")
    assert Path("old.json").read_text(encoding="utf-8") == "old"


def test_references_are_written_only_where_it_is_said() -> None:
    done = CliRunner().invoke(app, ["reference", "--case", "step_plus1"])
    assert done.exit_code == 2
    assert "--directory is missing" in done.stderr.replace("\n", " ")

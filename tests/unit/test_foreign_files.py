"""Hostile files and environment variables give one line that names the problem and exit code 2, within seconds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import pytest

from emcas_fmu import EmcasError, load_parameters
from emcas_fmu.reference import files, stored
from tests.commands import emcas
from tests.marks import slow

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = {
    "section of 5,000 parts": (f"[{'.'.join('a' * 5000)}]\nx = 1\n", "inside each other"),
    "lists": ("x = " + "[" * 60 + "]" * 60, "inside each other"),
    "integer of 60,000 digits": (f"[motor]\nx = 0x{'f' * 60_000}\n", "a whole number has more than 64 bits"),
}
COMMANDS = {
    "parameters": ("parameters", "-p"), "campaign": ("campaign",), "report": ("report", "--requirements"),
    "tune": ("tune",), "analyse": ("analyse", "--rod"),
}


def _run(command: str, path: Path) -> str:
    """Return the message of a command that refuses a file."""
    done = emcas(*COMMANDS[command], path)
    assert done.exit_code == 2, done.output
    return done.stderr


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_toml_is_refused(case: str, command: str, tmp_path: Path) -> None:
    text, message = HOSTILE[case]
    path = tmp_path / "hostile.toml"
    path.write_text(text, encoding="utf-8")
    printed = _run(command, path)
    assert message in printed
    assert printed.count("\n") == 1


def test_hostile_provenance_is_refused(tmp_path: Path) -> None:
    (tmp_path / files.PROVENANCE).write_text(HOSTILE["lists"][0], encoding="utf-8")
    with pytest.raises(EmcasError, match=r"provenance.toml: is not valid TOML.*make the reference files with"):
        stored.load(tmp_path, None)


@pytest.mark.parametrize("command", ["parameters", "campaign", "report", "tune"])
def test_of_many_unknown_keys_twenty_are_listed(command: str, tmp_path: Path) -> None:
    """The others are counted."""
    path = tmp_path / "many.toml"
    required = "requirements = []\n" if command == "report" else ""
    path.write_text(required + "".join(f"key{i} = 1\n" for i in range(30_000)), encoding="utf-8")
    begun = perf_counter()
    lines = _run(command, path).splitlines()
    assert perf_counter() - begun < 20.0  # s; takes 1 s, and 30 s if every key is compared with every name
    assert len(lines) == 21
    assert re.search("and 2998. more problems$", lines[-1])  # missing tables are problems, too


def test_up_to_twenty_problems_are_listed() -> None:
    wrong = {f"key{i}": 1 for i in range(20)}
    with pytest.raises(EmcasError) as refused:
        load_parameters().with_values(wrong)
    assert str(refused.value).count("no such parameter") == 20
    assert "more" not in str(refused.value)


@pytest.mark.parametrize("program", [["-m", "emcas_fmu.cli", "parameters"], ["-m", "emcas_fmu.cli", "report"],
                                     [str(ROOT / "build_fmu.py")]], ids=["parameters", "report", "build"])
@pytest.mark.parametrize("epoch", ["1e99", *slow("abc", "9" * 30)])
def test_wrong_source_date_epoch_is_refused(program: list[str], epoch: str, tmp_path: Path) -> None:
    """In a separate process, since NumPy reads the variable at import."""
    done = subprocess.run([sys.executable, *program], env={**os.environ, "SOURCE_DATE_EPOCH": epoch}, cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr == (f"error: SOURCE_DATE_EPOCH={epoch}: expected seconds since 1970; set or remove this "
                           "environment variable\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("text", ["\x1b[2J", "\x07", "\x9b2J", "\r", "\u202e", "\x7f"])
def test_control_characters_are_printed_as_text(text: str, tmp_path: Path) -> None:
    """In messages with file names, keys, options and models."""
    path = tmp_path / f"a{text}b.toml"
    key = text.encode("unicode_escape").decode().replace("\\x", "\\u00")
    path.write_text(f'"motor.{key}kp" = 1\n', encoding="utf-8")
    for arguments in (("parameters", "-p", path), ("simulate", "--step", "1", "--kernel", text),
                      ("validate", tmp_path / f"{text}.fmu"), ("parameters", "--model", text)):
        done = emcas(*arguments)
        assert done.exit_code == 2, done.output
        assert text not in done.output
        assert ascii(text)[1:-1] in done.output or text in "\a\r"  # rich leaves these two out


def test_control_characters_in_tables_are_printed_as_text(tmp_path: Path) -> None:
    path = tmp_path / "noted.toml"
    path.write_text('"motor.resistance" = { value = 0.3, unit = "Ohm", source = "a\\u001b[2Jb" }\n', encoding="utf-8")
    done = emcas("parameters", "-p", path)
    assert done.exit_code == 0, done.output
    assert "\x1b" not in done.output
    assert "a\\x1b[" in done.output

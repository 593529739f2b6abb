"""SSP archives of the shipped parameters, and a function that edits a copy."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.ssp.archive import SSD, SSV, parse, read_archive, violations, write_archive
from emcas_fmu.ssp.variants import variant_files
from emcas_fmu.ssp.write import write_ssp

Edit = Callable[..., Path]


def emcas(*arguments: str | Path, code: int = 0) -> str:
    """Run `emcas ssp` and return its output in one line; the exit code must be `code`."""
    done = CliRunner().invoke(app, ["ssp", *map(str, arguments)])
    assert done.exit_code == code, done.output
    assert "Traceback" not in done.output
    return " ".join(done.output.split())


def valid_documents(ssp: Path) -> int:
    """Validate all structures and parameter sets of an archive, and return their number."""
    documents = [(name, data) for name, data in read_archive(ssp).items() if name.endswith((".ssd", ".ssv"))]
    for name, data in documents:
        assert violations(parse(data, name), SSD if name.endswith(".ssd") else SSV) == []
    return len(documents)


@pytest.fixture(scope="session")
def ssp(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.ssp with the native FMU for this platform."""
    return write_ssp(tmp_path_factory.mktemp("ssp") / "EMCAS.ssp", native, variant_files=variant_files([])).path


@pytest.fixture(scope="session")
def wired_ssp(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same archive in which the system has connectors, wired to those of the components."""
    target = tmp_path_factory.mktemp("wired") / "EMCAS.ssp"
    return write_ssp(target, native, variant_files=variant_files([]), border=True).path


@pytest.fixture
def edit(wired_ssp: Path, tmp_path: Path) -> Edit:
    """Function that replaces texts in a file of a copy of `wired_ssp`: edit(file, old, new, ...)."""
    def copy(file: str, *pairs: str) -> Path:
        contents = read_archive(wired_ssp)
        contents[file] = replaced(re.sub(r">\s+<", "><", contents[file].decode()), *pairs).encode()
        target = tmp_path / "edited.ssp"
        write_archive(contents, target)
        return target

    return copy


def replaced(text: str, *pairs: str) -> str:
    """Return the text after replacements; each old text must occur."""
    for old, new in zip(pairs[::2], pairs[1::2]):
        assert old in text, old
        text = text.replace(old, new)
    return text

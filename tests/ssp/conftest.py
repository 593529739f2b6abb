"""An archive of the shipped parameters, and ways to spoil it."""

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
    """What `emcas ssp` prints, in one line; it has to end with `code`."""
    done = CliRunner().invoke(app, ["ssp", *map(str, arguments)])
    assert done.exit_code == code, done.output
    assert "Traceback" not in done.output
    return " ".join(done.output.split())


def valid_documents(ssp: Path) -> int:
    """How many structures and parameter sets an archive has; all have to be valid."""
    documents = {name: data for name, data in read_archive(ssp).items() if name.endswith((".ssd", ".ssv"))}
    for name, data in documents.items():
        assert violations(parse(data, name), SSD if name.endswith(".ssd") else SSV) == []
    return len(documents)


@pytest.fixture(scope="session")
def ssp(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.ssp of the native FMU for this platform."""
    return write_ssp(tmp_path_factory.mktemp("ssp") / "EMCAS.ssp", native, variant_files=variant_files([])).path


@pytest.fixture(scope="session")
def wired(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with connectors of the system."""
    target = tmp_path_factory.mktemp("wired") / "EMCAS.ssp"
    return write_ssp(target, native, variant_files=variant_files([]), border=True).path


@pytest.fixture
def edited(wired: Path, tmp_path: Path) -> Edit:
    """A copy of `wired` with text of a file replaced, everywhere it stands there: edited(file, old, new, ...)."""
    def edit(file: str, *pairs: str) -> Path:
        contents = read_archive(wired)
        text = re.sub(r">\s+<", "><", contents[file].decode())
        for old, new in zip(pairs[::2], pairs[1::2]):
            assert old in text, old
            text = text.replace(old, new)
        contents[file] = text.encode()
        target = tmp_path / "edited.ssp"
        write_archive(contents, target)
        return target

    return edit

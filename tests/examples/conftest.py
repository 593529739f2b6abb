"""Skip tests without JSBSim or MuJoCo; FMUs of four fins and of one, and an SSP."""

from __future__ import annotations

import importlib.util
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from examples.jsbsim.build import build_unit
from examples.jsbsim.masters import write_archive
from tests.hosts.host import missing

Doctor = Callable[..., Path]


@pytest.fixture(autouse=True)
def _simulator(request: pytest.FixtureRequest) -> None:
    for name in ("jsbsim", "mujoco"):
        if name in request.path.name and importlib.util.find_spec(name) is None:
            missing(f"there is no {name} (pip install {name})")


@pytest.fixture(scope="session")
def four(shipped_unit: Callable[..., Path]) -> Path:
    """EMCAS4.fmu of the shipped parameters, native, for this platform."""
    return shipped_unit(fins=4)


@pytest.fixture(scope="session")
def hydraulic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of one electrohydraulic actuator, built by the example."""
    return build_unit(tmp_path_factory.mktemp("hydraulic"), 1, "electrohydraulic")


@pytest.fixture(scope="session")
def ssp(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EMCAS.ssp, written by the example."""
    return write_archive(tmp_path_factory.mktemp("rocket") / "EMCAS.ssp", native)


@pytest.fixture
def doctored(tmp_path: Path) -> Doctor:
    """Function that copies an FMU or archive with changed texts: doctored(path, file, old, new, old, new ...)."""
    def change(path: Path, file: str, *words: str) -> Path:
        copy = tmp_path / f"doctored{path.suffix}"
        with zipfile.ZipFile(path) as source, zipfile.ZipFile(copy, "w") as target:
            for item in source.infolist():
                content = source.read(item)
                for old, new in zip(words[::2], words[1::2], strict=True) if item.filename == file else ():
                    assert old.encode() in content
                    content = content.replace(old.encode(), new.encode())
                target.writestr(item, content)
        return copy

    return change

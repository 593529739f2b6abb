"""Fixture: the example as an actuator of an installed package."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from emcas_fmu import actuators
from emcas_fmu.actuators import external

from .example import changed


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[Path]:
    """The example as an installed package with an entry point."""
    package = tmp_path / "somebodys"
    package.mkdir()
    changed(package, ('reference=Path(__file__).with_name("direct_drive_reference.py")',
                      "reference=None"), name="direct.py")
    metadata = tmp_path / "somebodys-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: somebodys\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(f"[{external.GROUP}]\ndirect = somebodys.direct:ACTUATOR\n",
                                               encoding="utf-8")
    sys.path.insert(0, str(tmp_path))
    external.installed.cache_clear()
    yield package
    sys.path.remove(str(tmp_path))
    external.installed.cache_clear()
    actuators._get.cache_clear()

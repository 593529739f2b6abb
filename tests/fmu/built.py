"""FMUs of one parameter set from both back ends."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from emcas_fmu.compiler import local_platform
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import ParameterSet


def both(parameters: ParameterSet, folder: Path, fins: int = 1) -> Mapping[str, Path]:
    """Their files by back end, the native one for this platform."""
    local = local_platform()
    assert local is not None
    return {"python": build(parameters, folder / "python.fmu", fins=fins).path,
            "native": build(parameters, folder / "native.fmu", "native", [local.name], fins=fins).path}

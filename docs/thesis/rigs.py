"""Numbers of the two test rigs, from rigs.toml.

Both rigs act on the actuator through its hinge moment: a torque T on the screw is the moment R T about the hinge, by
virtual work.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters.schema import document
from emcas_fmu.simulation import Array

Columns = Mapping[str, Array]


class RigEntry(NamedTuple):
    """A number of a rig: value in `unit` (SI), source, and a note with the reason."""

    value: float
    unit: str
    source: str
    note: str


@cache
def rig_entries(rig: str) -> Mapping[str, RigEntry]:
    """Return the numbers of a rig by name, from rigs.toml."""
    _, written = document(Path(__file__).with_name("rigs.toml"), EmcasError)
    return {name: RigEntry(**entry) for name, entry in written[rig].items()}


def rig_values(rig: str) -> Any:
    """Return the numbers of a rig [SI] as attributes."""
    return SimpleNamespace(**{name: entry.value for name, entry in rig_entries(rig).items()})

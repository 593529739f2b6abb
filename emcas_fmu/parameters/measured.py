"""Records of measurements that are named in comments of a parameter file."""

from __future__ import annotations

import re
from typing import NamedTuple

_RECORD = re.compile(r"^# Record (.+), SHA-256 ([0-9a-f]{64})(?:: (.*))?$", re.MULTILINE)


class MeasuredRecord(NamedTuple):
    """A record from which values in the parameter file `file` were identified, or with which they were compared.

    `use` is the rest of the comment, usually this use and the error of the simulation; empty if there is none.
    """

    file: str
    name: str
    sha256: str
    use: str

    @property
    def comment(self) -> str:
        """The comment that names this record in a parameter file."""
        return f"Record {self.name}, SHA-256 {self.sha256}" + (f": {self.use}" if self.use else "")


def measured_records(file: str, content: bytes) -> tuple[MeasuredRecord, ...]:
    """Return the records that the comments of a parameter file name."""
    text = "\n".join(content.decode(errors="replace").splitlines())
    return tuple(MeasuredRecord(file, *found) for found in _RECORD.findall(text))

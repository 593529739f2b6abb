"""Dates in generated files: today's date, or that in SOURCE_DATE_EPOCH (reproducible-builds.org)."""

from __future__ import annotations

import os
from datetime import datetime, timezone

from .. import __date__
from ..errors import EmcasError


def today() -> str:
    """Return the date (UTC) for generated files. Raises EmcasError if SOURCE_DATE_EPOCH is not a valid time [s]."""
    return (_set() or datetime.now(timezone.utc)).date().isoformat()


def reproducible() -> str:
    """Return the time (UTC) for files with the same bytes on any day: SOURCE_DATE_EPOCH, or the version's date.

    Raises EmcasError if SOURCE_DATE_EPOCH is not a valid time [s].
    """
    at = _set() or datetime.fromisoformat(__date__)
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


def _set() -> datetime | None:
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        return datetime.fromtimestamp(int(epoch), timezone.utc) if epoch else None
    except (OverflowError, ValueError, OSError) as error:
        raise EmcasError(f"SOURCE_DATE_EPOCH={epoch}: expected seconds since 1970; set or remove this environment "
                         "variable") from error

"""The date of what is made: today's, or that which SOURCE_DATE_EPOCH sets (reproducible-builds.org)."""

from __future__ import annotations

import os
from datetime import datetime, timezone

from .. import __date__
from ..errors import EmcasError


def today() -> str:
    """Return the date (UTC) of what is being made. Raises EmcasError for a SOURCE_DATE_EPOCH that is no number."""
    return (_set() or datetime.now(timezone.utc)).date().isoformat()


def reproducible() -> str:
    """Return the time (UTC) for what has the same bytes whenever it is made: the version's. Raises the same."""
    at = _set() or datetime.fromisoformat(__date__)
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


def _set() -> datetime | None:
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        return datetime.fromtimestamp(int(epoch), timezone.utc) if epoch else None
    except (OverflowError, ValueError, OSError) as error:
        raise EmcasError(f"SOURCE_DATE_EPOCH={epoch}: expected seconds since 1970") from error

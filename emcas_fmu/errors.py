"""Errors a user can mend: shown as a message, without a traceback."""

from __future__ import annotations


class EmcasError(Exception):
    """The request cannot be carried out; the message names the thing and the remedy."""


class BuildError(EmcasError):
    """The FMU cannot be built; the message says why and what to do."""

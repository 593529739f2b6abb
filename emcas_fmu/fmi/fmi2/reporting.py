"""Log messages, refusals and misuse of the slave of FMI 2.0.

It is embedded in the FMU and imports only the standard library and pythonfmu's base class.

The wrapper that loads the slave turns any Python exception into fmi2Fatal and then releases the instance twice, so no
exception may leave the slave. The wrapper can return fmi2Discard from fmi2DoStep, but only fmi2OK elsewhere.

A reference that is unknown, or of another type, is logged as an error where it is read or written, and does not affect
the steps: a read returns NaN, 0 or false, a write is ignored. As the caller gets fmi2OK, the write is also reported on
standard error. Any other call that must be refused is logged and remembered, and the next fmi2DoStep is discarded with
the state unchanged: every step while the cause lasts (a refused parameter, a non-finite input), otherwise one step (a
write to an output or to a parameter that is already fixed, a call out of order, an interrupt from the keyboard). An
interrupt that Python delivers between a call and its first line cannot be caught here.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status


class RefusedError(Exception):
    """A step that is discarded, or a state that is not restored; the message is the reason."""


class ReportingSlave(Fmi2Slave):  # type: ignore[misc]
    """Base of the slave: phase, messages, and the misuse for which the next step is refused."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._phase = "instantiated"
        self._misuse = ""
        self._ready = False  # the next step needs no further check
        self._printed: set[str] = set()  # messages on standard error

    def _allowed(self, phase: str, function: str) -> bool:
        """Return whether a function may be called now; if not, record misuse."""
        if self._phase != phase:
            self._misused(f"{function} called while {self._phase}")
        return self._phase == phase

    def _guard(self, action: Callable[[], None]) -> None:
        """Run an action; record an exception as misuse."""
        try:
            action()
        except RefusedError as error:
            self._misused(str(error))
        except BaseException as error:  # noqa: BLE001  see the module's docstring
            self._misused(f"{type(error).__name__}: {error}")

    def _misused(self, message: str) -> None:
        self._misuse = message
        self._ready = False
        self._log(message)

    def _say(self, message: str) -> None:
        """Print a message once, for hosts that have logging off."""
        if message not in self._printed:
            print(f"{self.instance_name}: {message}", file=sys.stderr)
        self._printed.add(message)

    def _log(self, message: str, status: str = "error") -> None:
        # The wrapper hands the text to the host as a printf format.
        self.log(message.replace("%", "%%"), Fmi2Status[status])

"""The output `status`, which several extensions share; each computes it from that of the extensions before it."""

from __future__ import annotations

from ..variables import Variable

_ITEMS = (
    ("disabled", "the drive is off"),
    ("unreferenced", "the fin's angle is unknown until homing"),
    ("homing", "moving towards a stop, or back to zero"),
    ("operational", "in closed loop"),
    ("degraded", "in closed loop, but a monitor of the built-in test has tripped"),
    ("failed", "no longer in control of the fin"),
)
DISABLED, UNREFERENCED, HOMING, OPERATIONAL, DEGRADED, FAILED = (float(i) for i in range(1, len(_ITEMS) + 1))
STATUS = Variable("status", "Enumeration", "output", "discrete", "", "operating state of the actuator", items=_ITEMS)

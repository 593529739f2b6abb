"""The fin on its cylinder between events, under pressures, dry friction and stops."""

from __future__ import annotations

from typing import Any

from ...namespace import Record
from ...ops.base import Ops, Value
from ...physics import cylinder, stick
from ..declaration import PlantInputs, Values

FREE = stick.Slide(1.0, 0.0, 0.0)
"""The motion of fin or shaft without dry friction, for smooth equations."""


def mode(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[cylinder.Linkage, stick.Slide]:
    """Return the linkage at mid-step and the motion of the fin for a step of `h` [s]."""
    stop = p.fin.stop_angle
    linkage = cylinder.linkage(ops, p, ops.clip(x.fin_angle + 0.5 * h * x.fin_rate, -stop, stop), u)
    torque = cylinder.pressing(p, linkage, x.pressure_1, x.pressure_2)
    return linkage, stick.slide(ops, x.fin_rate, torque, linkage.dry, x.fin_angle, stop)


def rates(ops: Ops, p: Any, x: Record, m: Record) -> Values:
    """Return d/dt of the fin's states in a mode `m`, which has the results of :func:`mode` as `linkage` and `fin`."""
    acceleration = cylinder.acceleration(p, m.linkage, x.fin_rate, x.pressure_1, x.pressure_2,
                                         m.fin.direction * m.linkage.dry)
    return {"fin_angle": x.fin_rate, "fin_rate": stick.moves(ops, m.fin, acceleration)}


def margins(ops: Ops, p: Any, x: Record, m: Record) -> Values:
    """Return the event margins of friction and stop."""
    torque = cylinder.pressing(p, m.linkage, x.pressure_1, x.pressure_2)
    return {"fin": stick.margin(ops, m.fin, x.fin_rate, torque),
            "stop": stick.stop_margin(ops, m.fin, x.fin_angle, p.fin.stop_angle)}


def landed(ops: Ops, p: Any, begin: Record, x: Record, m: Record, events: Values) -> Values:
    """Return the fin's states at the end of a step from `begin`; an event leaves the fin at rest, or at its stop."""
    angle, rate = stick.landed(ops, m.fin, p.fin.stop_angle, (begin.fin_angle, begin.fin_rate),
                               (x.fin_angle, x.fin_rate), events["fin"], events["stop"])
    return {"fin_rate": rate, "fin_angle": angle}

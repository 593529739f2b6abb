"""Accuracy of the stepping: the same motions with the article's tick and with a quarter of it."""

from __future__ import annotations

import numpy as np

from ...bench.excitation import of_case
from ...ops.floats import FLOATS
from ...reference import files
from .outcome import Outcome, Quantity, Rig

CASES = ("step", "load_opposing", "cold", "sag")
SHORTER = 4.0
_TICK = "solver.max_tick"
QUANTITIES = (
    Quantity("fin_angle_deg", "fin angle", "largest difference of the fin angle at any row, every 1 ms"),)


def measure(rig: Rig) -> Outcome:
    """Compare reference cases run with the tick as set and with a shorter one."""
    subject = rig.subject
    actuator, values = subject.actuator, subject.values
    tick = float(actuator.longest_tick(FLOATS, actuator.namespace(values)))
    figures, titles = {}, {}
    for case in files.cases_of(subject.model, values):
        excitation = of_case(case.title, case.inputs(), case.step, case.overrides)
        if case.name in CASES and not subject.obstacle(excitation):
            one, other = (rig.run(excitation.with_start_values(changed)).columns["fin_angle"]
                          for changed in ({}, {_TICK: tick / SHORTER}))
            figures[case.name] = {"fin_angle_deg": float(np.degrees(np.max(np.abs(one - other))))}
            titles[case.name] = case.title
    return Outcome(
        f"Reference cases with true angle and speed fed back, run with ticks of at most {1e3 * tick:.3g} ms, as set, "
        f"and again of at most {1e3 * tick / SHORTER:.3g} ms ({_TICK}). The difference shows how far the stepping is "
        "off in these motions, with the article's parameters; it says nothing of the equations, nor of other motions. "
        "Motions that amplify what is small, as a fin that rattles in a gap, differ by more.",
        QUANTITIES, figures, tuple(f"{name}.fin_angle_deg" for name in figures), titles)

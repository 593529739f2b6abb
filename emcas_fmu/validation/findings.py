"""What is told without being a requirement: the linear model beside the FMU, and what accuracy takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isinf

import numpy as np

from . import metrics, requirements
from .results import Comparison, Finding, Series

# "Linear against nonlinear": amplitudes [deg] and the angle below which the thesis finds both alike.
AMPLITUDES = (1.0, 2.0, 3.0, 10.0, 20.0)
ALIKE_BELOW = 3.0  # deg
# % of the step. Where nothing limits, quantisation, friction and the changing reduction ratio are left, a few
# per cent; 5 % is where two curves of a report can be told apart.
ALIKE = 5.0


def compare(amplitude: float, series: Series, linear: metrics.Array) -> Comparison:
    """The FMU's response to a step of `amplitude` [deg] beside the linear model's [rad] at the same times."""
    # LinearModel answers at the controllers' samples, a communication step apart.
    time, angle, _ = requirements.columns(series, np.inf)
    response = np.degrees(linear)
    after = time >= requirements.STEP_AT
    difference = metrics.errors(angle[after] / amplitude, response[after] / amplitude)
    steps = [metrics.step_metrics(time, y, requirements.STEP_AT, amplitude) for y in (response, angle)]
    return Comparison(amplitude, 100.0 * difference.maximum, 100.0 * difference.rms, float(steps[0].rise_time),
                      float(steps[1].rise_time), float(np.trapezoid(series.run.columns["saturated"], time)))


def claims(comparisons: Sequence[Comparison]) -> list[Finding]:
    """The thesis's statement (chapter 5, summary) that the models agree below 3 deg, as two findings."""
    small = [c for c in comparisons if c.amplitude < ALIKE_BELOW]
    at = [c for c in comparisons if c.amplitude == ALIKE_BELOW]
    large = [c for c in comparisons if c.amplitude > ALIKE_BELOW]
    found = []
    if small:
        told = ", ".join(f"{c.largest_difference:.1f} % at {c.amplitude:g} deg" for c in small)
        told += "".join(f"; at {c.amplitude:g} deg itself it is {c.largest_difference:.1f} %" for c in at)
        found.append(Finding("linear_alike_below_3deg",
                             f"Below {ALIKE_BELOW:g} deg, FMU and linear model differ by at most {ALIKE:g} % of the "
                             f"step: {told}", all(c.largest_difference <= ALIKE for c in small)))
    if large:
        told = ", ".join(f"{c.rise_time_fmu * 1e3:.1f} ms against {c.rise_time_linear * 1e3:.1f} ms "
                         f"at {c.amplitude:g} deg" for c in large)
        found.append(Finding("nonlinear_slower_above_3deg",
                             f"Above {ALIKE_BELOW:g} deg, the FMU rises more slowly: {told}",
                             all(c.rise_time_fmu > c.rise_time_linear for c in large)))
    return found


def accuracy(runs: Mapping[str, Series]) -> list[Finding]:
    """How long the accuracy takes, and what a load does to it: Table 2 says neither."""
    found = []
    for name, what in (("hold_plus20", "a step to 20 deg"), ("hold_loaded", "the same step against 100 N.m")):
        if name in runs and runs[name].run.stopped is None:
            took = requirements.time_to_accuracy(runs[name])
            when = f"not within {requirements.HOLD:g} s" if isinf(took) else f"{took:.3f} s after the command"
            left = f"{requirements.held_error(runs[name]):+.4f} deg are left after {requirements.HOLD:g} s"
            found.append(Finding(f"time_to_accuracy_{name}", "The error stays within "
                                 f"±{requirements.ACCURACY} deg after {what}: {when}; {left}"))
    return found

"""The comparison with the linear model, which is reported without being a requirement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import radians
from typing import Any

import numpy as np

from ...bench import metrics
from ...bench.excitation import Excitation, step_to
from ...bench.runs import Run
from ...motions import LEAD_IN
from ...pages.numbers import rounded
from ...reference.linear import LinearModel

# "Linear against nonlinear": amplitudes [deg], and the angle below which both agree according to the thesis.
AMPLITUDES = (1.0, 2.0, 3.0, 10.0, 20.0)
SMALL = 3.0  # deg
# % of the step up to which two responses agree. Without limits, quantisation, friction and the varying reduction ratio
# remain, a few per cent; at 5 % two curves of a report can be distinguished.
AGREED = 5.0
_DURATION = 0.3  # s


@dataclass(frozen=True)
class Comparison:
    """The subject and the linear model for a step of `amplitude` [deg]; differences in % of the step, times in s."""

    amplitude: float
    largest_difference: float
    rms_difference: float
    rise_time_linear: float
    rise_time: float
    saturated_time: float


@dataclass(frozen=True)
class Finding:
    """A claim about the model, tested, on which no verdict depends."""

    name: str
    text: str
    holds: bool


def steps(values: Mapping[str, Any]) -> dict[float, Excitation]:
    """Return steps to compare with the linear model, at its sample times, by amplitude [deg]."""
    period = LinearModel(values).sample_time
    return {amplitude: step_to(radians(amplitude), _DURATION, step=period) for amplitude in AMPLITUDES}


def compare(amplitude: float, run: Run, linear: metrics.Array) -> Comparison:
    """Compare the response to a step of `amplitude` [deg] with the linear model's [rad] at the same times."""
    time, angle, level = run.columns["time"], run.columns["fin_angle"], radians(amplitude)
    after = time >= LEAD_IN - 1e-9
    difference = metrics.errors(angle[after] / level, linear[after] / level)
    expected, rise = (metrics.step_metrics(time, y, LEAD_IN, level)["rise_time"] for y in (linear, angle))
    return Comparison(amplitude, 100.0 * difference.maximum, 100.0 * difference.rms, expected, rise,
                      float(np.trapezoid(run.columns["saturated"], time)))


def claims(comparisons: Sequence[Comparison]) -> list[Finding]:
    """Test the thesis's statement (chapter 5, summary) that the models agree below 3 deg, in two findings."""
    small = [c for c in comparisons if c.amplitude < SMALL]
    large = [c for c in comparisons if c.amplitude > SMALL]
    alike = ", ".join(f"{c.largest_difference:.1f} % at {c.amplitude:g} deg" for c in small) + "".join(
        f"; at {c.amplitude:g} deg itself it is {c.largest_difference:.1f} %"
        for c in comparisons if c.amplitude == SMALL)
    slower = ", ".join(f"{rounded(c.rise_time * 1e3, '.1f')} ms against {rounded(c.rise_time_linear * 1e3, '.1f')} ms "
                       f"at {c.amplitude:g} deg" for c in large)
    agree = Finding("linear_alike_below_3deg", f"Below {SMALL:g} deg, this model and the linear one differ by at most "
                    f"{AGREED:g} % of the step: {alike}", all(c.largest_difference <= AGREED for c in small))
    differ = Finding("nonlinear_slower_above_3deg", f"Above {SMALL:g} deg, this model rises more slowly: {slower}",
                     all(c.rise_time > c.rise_time_linear for c in large))
    return [agree] * bool(small) + [differ] * bool(large)

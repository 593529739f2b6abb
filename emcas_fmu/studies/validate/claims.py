"""The comparison with the thesis's linear model, which is reported and is not a requirement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians
from typing import Any

import numpy as np

from ...bench import metrics
from ...bench.excitation import Excitation, step_to
from ...bench.runs import Run
from ...motions import LEAD_IN
from ...pages.numbers import rounded
from ...reference.linear import LinearModel

AMPLITUDES = (1.0, 2.0, 3.0, 10.0, 20.0)  # deg, of the steps
SMALL = 3.0  # deg, below which both models agree according to the thesis
# Largest difference [% of the step] between two responses that agree. If no limit acts, quantisation, friction and the
# varying reduction ratio cause a few per cent; above 5 % the two curves in a report can be distinguished.
AGREED = 5.0
_DURATION = 0.3  # s, after the step


def steps(values: Mapping[str, Any]) -> dict[float, Excitation]:
    """Return the steps by amplitude [deg], with rows at the linear model's sample times."""
    period = LinearModel(values).sample_time
    return {amplitude: step_to(radians(amplitude), _DURATION, step=period) for amplitude in AMPLITUDES}


def compare(amplitude: float, run: Run, linear: metrics.Array) -> dict[str, float]:
    """Return figures that compare the response to a step of `amplitude` [deg] with the linear model's.

    `linear` are the linear model's angles [rad] at the rows of the run. The figures have the keys of the JSON file:
    differences in % of the step, times in s.
    """
    time, angle, level = run.columns["time"], run.columns["fin_angle"], radians(amplitude)
    after = time >= LEAD_IN - 1e-9
    errors = metrics.errors(angle[after] / level, linear[after] / level)
    expected, rise = (metrics.step_metrics(time, y, LEAD_IN, level)["rise_time"] for y in (linear, angle))
    return {"amplitude": amplitude, "largest_difference": 100.0 * errors.maximum,
            "rms_difference": 100.0 * errors.rms, "rise_time_linear": expected, "rise_time_fmu": rise,
            "saturated_time": float(np.trapezoid(run.columns["saturated"], time))}


def claims(comparisons: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return findings on the thesis's statement (chapter 5, summary) that the models agree below 3 deg.

    Each finding has a name, a text, and whether it holds. No verdict depends on them.
    """
    small = [c for c in comparisons if c["amplitude"] < SMALL]
    large = [c for c in comparisons if c["amplitude"] > SMALL]
    alike = ", ".join("{largest_difference:.1f} % at {amplitude:g} deg".format(**c) for c in small) + "".join(
        "; at {amplitude:g} deg, {largest_difference:.1f} %".format(**c)
        for c in comparisons if c["amplitude"] == SMALL)
    slower = ", ".join(f"{rounded(c['rise_time_fmu'] * 1e3, '.1f')} ms against "
                       f"{rounded(c['rise_time_linear'] * 1e3, '.1f')} ms at {c['amplitude']:g} deg" for c in large)
    agree = {"name": "linear_alike_below_3deg", "text": f"Below {SMALL:g} deg, this model and the linear one differ by "
             f"at most {AGREED:g} % of the step: {alike}",
             "holds": all(c["largest_difference"] <= AGREED for c in small)}
    differ = {"name": "nonlinear_slower_above_3deg",
              "text": f"Above {SMALL:g} deg, this model rises more slowly: {slower}",
              "holds": all(c["rise_time_fmu"] > c["rise_time_linear"] for c in large)}
    return [agree] * bool(small) + [differ] * bool(large)

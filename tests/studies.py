"""The smallest campaign and tuning study: one parameter and a step of 2 deg."""

from __future__ import annotations


def campaign(parameter: str) -> str:
    """Return a campaign of two samples, in which a parameter varies by up to 5 %."""
    return f"""
[campaign]
samples = 2
[vary."{parameter}"]
distribution = "uniform"
low = "95 %"
high = "105 %"
[experiments.step]
kind = "step"
amplitude = "2 deg"
duration = "0.3 s"
"""


def tuning(parameter: str, lower: str, upper: str, rise_time: str = "10 s") -> str:
    """Return a tuning study of a parameter between two limits, whose requirement is the rise time of a step."""
    return f"""
[tunables]
"{parameter}" = {{ lower = "{lower}", upper = "{upper}" }}
[cases.nominal]
[[requirements]]
name = "rise"
test = {{ kind = "step", amplitude = "2 deg", duration = "0.3 s" }}
figure = "rise_time"
maximum = "{rise_time}"
"""

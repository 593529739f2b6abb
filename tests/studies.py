"""The smallest campaign and tuning study, of one parameter and a step of 2 deg."""

from __future__ import annotations


def campaign(parameter: str) -> str:
    """Two units whose parameter differs from its value by up to 5 %."""
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
    """A parameter between two values, with units, so that a step rises within a time."""
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

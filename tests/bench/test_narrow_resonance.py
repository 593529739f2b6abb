"""Margins at a resonance much narrower than the distance of the grid's frequencies."""

from __future__ import annotations

from math import pi

import control as ct
import numpy as np
import pytest

from emcas_fmu.bench.linear.frequency import margins


@pytest.mark.parametrize("damping", [1e-4, 1e-3])
def test_margin_at_a_narrow_resonance(damping: float) -> None:
    """Behind a lag, the phase crosses -180 deg within the resonance: the margin is that of a grid dense about it."""
    resonance, lag = 2.0 * pi * 100.0, 2.0 * pi * 400.0
    loop = ct.ss(ct.tf(1e-4 * resonance**2, [1.0, 2.0 * damping * resonance, resonance**2]) * ct.tf(lag, [1.0, lag]))
    dense = resonance * (1.0 + damping * np.linspace(-50.0, 50.0, 200_001))
    response = loop(1j * dense)
    crossing = np.flatnonzero(np.diff(np.sign(response.imag)) != 0)
    gain = max(-response.real[crossing])
    assert gain > 0.01  # a grid without the resonance sees 1e-4
    found = margins(loop, np.geomspace(1.0, 1000.0, 40))
    assert found.up_db == pytest.approx(-20.0 * np.log10(gain), abs=0.02)  # splines between frequencies 5 % apart

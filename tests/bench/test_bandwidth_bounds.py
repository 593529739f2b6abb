"""A bandwidth outside the examined frequencies is shown as a bound, never as a value."""

from __future__ import annotations

from math import isnan, nan, radians
from unittest.mock import Mock

import numpy as np
import pytest

from emcas_fmu.bench.frequency_response import FrequencyResponse, swept
from emcas_fmu.bench.measure import BANDWIDTHS, bound
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.analysis.sweep import sweeps
from emcas_fmu.studies.report import responses
from emcas_fmu.studies.report.outcome import quantity

FREQUENCY = np.array([0.5, 1.0, 2.0])


@pytest.mark.parametrize(("gain_db", "lag", "stated"), [
    ((-7.0, -8.0, -9.0), (100.0, 110.0, 120.0), ("< 0.5", "< 0.5")),
    ((0.0, -2.0, -4.0), (0.0, 60.0, 120.0), ("1.5", "1.5")),
    ((0.0, -1.0, -2.0), (0.0, 10.0, 20.0), ("> 2", "> 2")),
    ((-7.0, 0.0, -2.0), (100.0, 10.0, 20.0), ("< 0.5", "< 0.5")),
    ((0.0, nan, -2.0), (0.0, nan, 20.0), ("–", "–"))])
def test_bandwidths_of_a_response(gain_db: tuple[float, ...], lag: tuple[float, ...], stated: tuple[str, str]) -> None:
    response = FrequencyResponse(FREQUENCY, 10.0 ** (np.array(gain_db) / 20.0), -np.radians(lag), np.ones(3))
    assert response.stated == stated
    inside = stated[0] == "1.5"
    assert [isnan(at) for at in (response.bandwidth, response.phase_bandwidth)] == [not inside] * 2
    expected = {"<": 0.5, "1": 1.5}.get(stated[0][0], nan)  # figures that are judged have the end as their bound
    assert swept(response)["bandwidth_3db"] == pytest.approx(expected, nan_ok=True)


def test_sines_within_a_dead_band() -> None:
    """The servo's dead band takes more than 3 dB from sines of 0.1 deg at any frequency, and all of smaller ones."""
    lost, small = sweeps(ParameterSubject(load_parameters(model="servo")), 30.0, amplitudes=(0.02, 0.1))
    lowest = small.response.frequency[0]
    assert small.response.gain_db[0] < -3.0
    assert small.response.stated[0] == lost.response.stated[0] == f"< {lowest:g}"
    assert lost.response.stated[1] == "–"
    assert small.amplitude == radians(0.1)


@pytest.mark.parametrize(("value", "text"), [
    (BANDWIDTHS[0], "< 2 Hz"), (14.0, "14 Hz"), (BANDWIDTHS[1], "> 60 Hz"), (nan, "–")])
def test_bandwidths_of_a_report(value: float, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(responses, "sweep_response", Mock(return_value=Mock(phase=0.0)))
    monkeypatch.setattr(responses, "sweep_figures", lambda *_: {"bandwidth_3db": value, "bandwidth_90deg": 14.0})
    group = responses.frequency(Mock()).groups["1deg"]
    assert group.shown(quantity("bandwidth_3db")).startswith(text)
    assert text.startswith(bound(value))

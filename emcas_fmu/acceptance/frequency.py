"""Frequency response at two amplitudes, by swept sine."""

from __future__ import annotations

import numpy as np

from ..reference.cases import SWEEP
from ..validation import requirements
from .bench import Bench, finished
from .outcome import Outcome, Quantity

NAME = "frequency_response"
CASES = {"1deg": "chirp_1deg", "3p5deg": "chirp_3p5deg"}
LABELS = {"1deg": "1 deg", "3p5deg": "3.5 deg"}

QUANTITIES = (
    Quantity("bandwidth_3db_hz", "-3 dB", "lowest frequency at which the gain of the fundamental falls to -3 dB"),
    Quantity("bandwidth_90deg_hz", "-90 deg", "lowest frequency at which the fundamental lags the command by 90 deg"),
    Quantity("peak_gain_db", "largest gain", "largest gain within the frequencies evaluated"),
    Quantity("lowest_coherence", "least coherence", "least ordinary coherence up to the -3 dB frequency; below 1 "
             "where the response is not linear, or changes within a segment"),
)


def measure(bench: Bench) -> Outcome:
    """Logarithmic sweeps of the command; H1 estimate by Welch's method."""
    figures, curves, notes = {}, {}, []
    for group, case in CASES.items():
        series = bench.table2[case]
        finished(series.run)
        found = requirements.response_of(series)
        if found.bandwidth <= found.frequency[0]:
            notes.append(f"At {LABELS[group]} the gain is below -3 dB from the lowest frequency on.")
        upto = found.frequency <= (np.inf if np.isnan(found.bandwidth) else found.bandwidth)
        figures[group] = {
            "bandwidth_3db_hz": found.bandwidth, "bandwidth_90deg_hz": found.phase_bandwidth,
            "peak_gain_db": float(np.max(found.gain_db)), "lowest_coherence": float(np.min(found.coherence[upto]))}
        curves[group] = {"frequency_hz": found.frequency, "gain_db": found.gain_db,
                         "phase_deg": np.degrees(found.phase), "coherence": found.coherence}
    low, high = requirements.SWEPT
    return Outcome(
        NAME, "Frequency response",
        f"Fin angle over command. Logarithmic sine sweep of the command from {SWEEP[0]:g} to {SWEEP[1]:g} Hz in 12 s "
        f"about 0 deg, no load; H1 estimate by Welch's method, Hann segments of 1 s, evaluated from {low:g} to "
        f"{high:g} Hz. It is the fundamental: the describing function of the amplitude. A frequency that is not "
        "reached within the sweep is told as a dash.", QUANTITIES, figures,
        tuple(f"{group}.{key}" for group in CASES for key in ("bandwidth_3db_hz", "bandwidth_90deg_hz")),
        LABELS, curves,
        notes=tuple(notes))

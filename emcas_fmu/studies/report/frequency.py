"""Frequency response at two amplitudes, by swept sine."""

from __future__ import annotations

import numpy as np

from ...bench.metrics import SWEPT, sweep_response, swept
from ...reference.cases import SWEEP
from .outcome import Outcome, displayed, quantity
from .rig import Rig

NAME = "frequency_response"
LABELS = {"1deg": "1 deg", "3p5deg": "3.5 deg"}

QUANTITIES = (
    quantity("bandwidth_3db", "-3 dB"), quantity("bandwidth_90deg", "-90 deg"),
    quantity("peak_gain", "largest gain"), quantity("lowest_coherence", "least coherence"),
)


def measure(rig: Rig) -> Outcome:
    """Measure the response to logarithmic sweeps of the command, H1 estimate by Welch's method."""
    figures, curves, notes = {}, {}, []
    for group, label in LABELS.items():
        run = rig.table2[f"chirp_{group}"]
        run.finished()
        response = sweep_response(run)
        if response.bandwidth <= response.frequency[0]:
            notes.append(f"At {label} the gain is below -3 dB from the lowest frequency on.")
        figures[group] = displayed(swept(response), QUANTITIES)
        curves[group] = {"frequency_hz": response.frequency, "gain_db": response.gain_db,
                         "phase_deg": np.degrees(response.phase), "coherence": response.coherence}
    low, high = SWEPT
    return Outcome(
        f"Fin angle over command. Logarithmic sine sweep of the command from {SWEEP[0]:g} to {SWEEP[1]:g} Hz in 12 s "
        f"about 0 deg, no load; H1 estimate by Welch's method, Hann segments of 1 s, evaluated from {low:g} to "
        f"{high:g} Hz. It is the fundamental: the describing function of the amplitude. A frequency that is not "
        "reached within the sweep is a dash. Coherence is below 1 where the response is not linear, or changes within "
        "a segment.", QUANTITIES, figures,
        tuple(f"{group}.{key}" for group in LABELS for key in ("bandwidth_3db_hz", "bandwidth_90deg_hz")),
        LABELS, curves, notes=tuple(notes))

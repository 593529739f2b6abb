"""Samples are computed together; a row does not depend on the other samples computed with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.simulation import Array
from emcas_fmu.studies.campaign import sample
from emcas_fmu.studies.campaign.study import Campaign, load_study

# Parameters, inputs and experiments vary. Some samples fail: invalid parameters, windows or heights, and huge loads.
VARIED = """
[campaign]
samples = 24
[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"
[vary."drive.transport_delay"]
levels = ["3.7 ms", "3.2 ms", "4 ms"]
[vary."encoder.pulses"]
levels = [500, 1000, 10000]
[vary."encoder.enabled"]
levels = [true, false]
[inputs.supply_voltage]
kind = "window"
value = "20 V"
begin = { levels = ["20 ms", "30 ms"] }
end = { levels = ["25 ms", "40 ms"] }
[experiments.step]
kind = "step"
amplitude = { levels = ["0 deg", "5 deg", "-3 deg", "15 deg", "20 deg"] }
duration = "0.1 s"
[experiments.sine]
kind = "sine"
amplitude = "1 deg"
frequency = { distribution = "uniform", low = "10 Hz", high = "40 Hz" }
duration = "0.1 s"
[experiments.sine.inputs.aero_torque]
kind = "sine"
amplitude = { levels = ["1 N.m", "5 N.m", "1e300 N.m"], weights = [4, 4, 1] }
frequency = { distribution = "uniform", low = "10 Hz", high = "40 Hz" }
[experiments.sprung]
kind = "hold"
amplitude = "2 deg"
duration = "0.1 s"
[experiments.sprung.inputs.aero_torque]
kind = "spring"
stiffness = { levels = ["0 N.m/rad", "100 N.m/rad"] }
[experiments.sweep]
kind = "sweep"
amplitude = "2 deg"
low = "5 Hz"
high = { levels = ["30 Hz", "20 Hz"] }
duration = "0.2 s"
"""
SAMPLES = 24


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Array, list[dict[str, object]]]:
    """The study, the drawn values, and the rows, each computed alone."""
    path: Path = tmp_path_factory.mktemp("varied") / "varied.toml"
    path.write_text(VARIED, encoding="utf-8")
    study = load_study(path)
    drawn = study.draw(range(SAMPLES))
    rows = rows_of_samples(study, drawn, [*range(SAMPLES)])
    drawn[[row["status"] for row in rows].index("ok"), 0] = -1.0
    rows = [rows_of_samples(study, drawn, [k])[0] for k in range(SAMPLES)]
    first_words = {str(row["error"]).partition(" ")[0] for row in rows}
    assert first_words >= {"", "the", "a", "at", "motor.torque_constant"}, first_words
    return study, drawn, rows


def rows_of_samples(study: Campaign, drawn: Array, indices: list[int]) -> list[dict[str, object]]:
    return sample.listed(sample.together(study, indices, drawn[indices], sample.subject_of(study)))


@settings(max_examples=8)
@given(st.permutations(range(SAMPLES)), st.lists(st.integers(1, SAMPLES - 1), max_size=4, unique=True))
def test_row_computed_with_others_equals_the_row_computed_alone(
        varied: tuple[Campaign, Array, list[dict[str, object]]], order: list[int], cuts: list[int]) -> None:
    study, drawn, alone = varied
    for part in np.split(np.array(order), sorted(cuts)):
        for index, row in zip(part.tolist(), rows_of_samples(study, drawn, part.tolist()), strict=True):
            # repr of a number is exact.
            assert repr(row) == repr(alone[index])

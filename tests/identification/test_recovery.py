"""True values are recovered within the stated uncertainty, with seeds that were not used during development."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.studies.identification.result import Identification
from examples.identification_bench import bench

from .conftest import BENCH, recover

# Seeds below 100 000 were used during development.
FIRST = 916_000


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count", "largest", "choice"), [
    ("friction", 7, {"friction.viscous.positive": 0.03, "friction.coulomb.positive[0]": 0.003,
                     "friction.table.viscous[1]": 0.03, "friction.table.coulomb[1]": 0.005},
     {"speeds": (50, 500, 2000)}),
    ("drive", 7, {"drive.current_gain": 0.002, "drive.transport_delay": 0.003, "drive.kp": 0.05, "drive.ki": 0.1}, {}),
    ("inertia", 12, {"inertia.motor": 0.01}, {}),
    ("backlash", 12, {"backlash": 0.1}, {}),
])
def test_errors_are_as_large_as_stated(kind: str, count: int, largest: Mapping[str, float], choice: dict[str, object],
                                       tmp_path: Path) -> None:
    found = recover(kind, range(FIRST, FIRST + count), tmp_path, **choice)
    # Sigmas are not too small. One of 126 normal errors is probably beyond 3 sigma; beyond 4.5 sigma is 0.1 % likely.
    assert np.abs(found.z).max() < 4.5, dict(zip(found.names, np.abs(found.z).max(axis=0), strict=True))
    assert np.mean(np.abs(found.z) > 3.0) < 0.03
    # The estimates of one actuator are correlated and count as about one error. The rms of 7 normal errors is within
    # 0.38 .. 1.70 in 99 of 100 cases, of 12 within 0.51 .. 1.54 (chi-square).
    assert 0.4 < np.sqrt(np.mean(found.z**2)) < 1.7
    # Sigmas are not uselessly large: at most this ratio to the true value.
    for name, limit in largest.items():
        assert np.median(found.relative[:, found.names.index(name)]) < limit, name


@pytest.mark.slow
def test_delay_is_identified_to_a_fraction_of_a_sample(identified: Mapping[str, Identification]) -> None:
    # The sample time is 50 us; a fit of 40 steps should give a twentieth of it or better.
    assert identified["drive"]["drive.transport_delay"].sigma < 50e-6 / 20


def test_shipped_records_give_their_true_values(identified: Mapping[str, Identification]) -> None:
    provenance = tomllib.loads((BENCH / bench.PROVENANCE).read_text(encoding="utf-8"))
    errors = {}
    for kind, result in identified.items():
        for e in result.estimates:
            true = provenance["truth"].get(e.name, provenance["backlash_deg"] if kind == "backlash" else None)
            if true is not None:
                errors[e.name] = (e.value - true) / e.sigma
    assert set(errors) == {*bench.TRUTHS, "backlash"}
    # All of 25 normal errors are within 3 sigma in 93 % of cases; these are fixed by the files.
    assert max(map(abs, errors.values())) < 3.0, errors


def test_wrong_true_value_would_be_detected(identified: Mapping[str, Identification]) -> None:
    """An error of 5 % is more than 5 sigma: the tests above can fail."""
    for name, kind in (("drive.current_gain", "drive"), ("drive.transport_delay", "drive"),
                       ("inertia.motor", "inertia"),
                       ("friction.viscous.positive", "friction"), ("friction.coulomb.negative[0]", "friction")):
        e = identified[kind][name]
        assert 0.05 * e.value > 5.0 * e.sigma, name

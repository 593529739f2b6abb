"""Values of samples: by seed and index alone, with the specified distributions."""

from __future__ import annotations

from math import log, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import stats

from emcas_fmu.parameters.schema import In
from emcas_fmu.studies.campaign.distributions import KINDS, distribution
from emcas_fmu.studies.campaign.study import Study, load_study

from ..marks import others_slow
from .conftest import GRID, SMALL, Write

RANDOM = ("monte-carlo", "latin-hypercube", "sobol")
PLAIN = In("1")
EXAMPLES: dict[str, dict[str, Any]] = {
    "uniform": {"low": 2, "high": 6}, "log-uniform": {"low": 1, "high": 10}, "normal": {"mean": 3, "sd": 2},
    "triangular": {"low": 0, "mode": 1, "high": 4}, "lognormal": {"mean": 2, "sd": 1},
    "truncated-normal": {"mean": 0, "sd": 1, "low": -1, "high": 2}, "choice": {"levels": [1, 4], "weights": [3, 1]},
}
# Of a standard normal between -1 and 2, by its density at the ends and the probability between.
_LOW, _HIGH, _INSIDE = stats.norm.pdf(-1), stats.norm.pdf(2), stats.norm.cdf(2) - stats.norm.cdf(-1)
_MEAN = (_LOW - _HIGH) / _INSIDE
MOMENTS = {
    "uniform": (4.0, sqrt(16 / 12)), "log-uniform": (9 / log(10), sqrt(99 / 2 / log(10) - (9 / log(10)) ** 2)),
    "normal": (3.0, 2.0), "triangular": (5 / 3, sqrt(13 / 18)), "lognormal": (2.0, 1.0),
    "truncated-normal": (_MEAN, sqrt(1 + (-_LOW - 2 * _HIGH) / _INSIDE - _MEAN**2)), "choice": (1.75, sqrt(1.6875)),
}


def method(write: Write, name: str, samples: int = 24) -> Study:
    text = GRID if name == "grid" else SMALL.replace("seed = 5", f'seed = 5\nmethod = "{name}"')
    return load_study(write(text.replace("samples = 24", f"samples = {samples}")))


@pytest.mark.parametrize("name", others_slow([*RANDOM, "grid"], lambda name: name == "sobol"))
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(asked=st.lists(st.integers(0, 23), min_size=1, max_size=30))
def test_a_sample_is_the_same_whoever_asks(write: Write, name: str, asked: list[int]) -> None:
    """In any order, more than once, alone or with others: to the bit."""
    assert np.array_equal(method(write, name).draw(asked), method(write, name).draw(range(24))[asked])


@pytest.mark.parametrize("name", RANDOM)
def test_the_seed_matters(write: Write, name: str) -> None:
    other = SMALL.replace("seed = 5", f'seed = 6\nmethod = "{name}"')
    first = method(write, name).draw(range(24))
    assert not np.any(first == load_study(write(other)).draw(range(24)))


def test_more_samples_leave_those_there_are(write: Write) -> None:
    for name in ("monte-carlo", "sobol"):
        assert np.array_equal(method(write, name, 24).draw(range(24)), method(write, name, 99).draw(range(24)))


def test_a_hypercube_has_one_sample_in_every_layer(write: Write) -> None:
    temperature = method(write, "latin-hypercube", 50).draw(range(50))[:, 1]
    assert sorted(np.floor((temperature + 6.0) / 30.0 * 50).astype(int)) == list(range(50))


def test_a_grid_has_every_point_once(write: Write) -> None:
    points = method(write, "grid").draw(range(24))
    assert len({tuple(point) for point in points.tolist()}) == 24
    assert points[0].tolist() == [0.2, -6.0, 1.0]
    assert points[1].tolist() == [0.2, -6.0, 0.0]  # the last factor changes fastest


def test_there_is_no_sample_beyond_the_last(write: Write) -> None:
    with pytest.raises(IndexError, match="indices are 0 to 23"):
        method(write, "monte-carlo").draw([24])


@pytest.mark.parametrize("name", list(KINDS))
def test_moments(name: str) -> None:
    """Mean and standard deviation over the shares k + 1/2 of n, against those of the textbook.

    The midpoint rule is exact but for curvature and tails: with n = 200 000 a normal's variance lacks what
    lies beyond 4.6 standard deviations and half of the last cells, below 1e-4; the heavy lognormal's 1e-3.
    """
    shares = (np.arange(200_000) + 0.5) / 200_000
    values = distribution({"distribution": name, **EXAMPLES[name]}, PLAIN).at(shares)
    mean, sd = MOMENTS[name]
    assert np.mean(values) == pytest.approx(mean, rel=1e-4, abs=1e-4)
    assert np.std(values) == pytest.approx(sd, rel=1e-3)


def test_monte_carlo_is_distributed_as_told(write: Write) -> None:
    """Kolmogorov's distance of 2000 samples: beyond 1.95/sqrt(n) one seed in a thousand; this seed is fixed."""
    drawn = method(write, "monte-carlo", 2000).draw(range(2000))
    for column, theory in zip(drawn.T, (stats.norm(0.11, 0.0033), stats.uniform(-6, 30), stats.uniform(-40, 40)),
                              strict=True):
        assert stats.kstest(column, theory.cdf).statistic < 1.95 / sqrt(2000)
    # Independent of each other: a correlation of 2000 beyond 3.3/sqrt(n) comes once in a thousand.
    correlation = np.corrcoef(drawn.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 3.3 / sqrt(2000)

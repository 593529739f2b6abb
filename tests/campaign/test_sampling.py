"""Drawn values depend only on seed and index, and have the specified distributions."""

from __future__ import annotations

from math import log, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import stats

from emcas_fmu.parameters.schema import In
from emcas_fmu.studies.campaign.distributions import DISTRIBUTIONS, distribution
from emcas_fmu.studies.campaign.study import Campaign, load_study

from ..marks import others_slow
from .conftest import GRID, SMALL, Write

RANDOM = ("monte-carlo", "latin-hypercube", "sobol")
PLAIN = In("1")
EXAMPLES: dict[str, dict[str, Any]] = {
    "uniform": {"low": 2, "high": 6}, "log-uniform": {"low": 1, "high": 10}, "normal": {"mean": 3, "sd": 2},
    "triangular": {"low": 0, "mode": 1, "high": 4}, "lognormal": {"mean": 2, "sd": 1},
    "truncated-normal": {"mean": 0, "sd": 1, "low": -1, "high": 2}, "choice": {"levels": [1, 4], "weights": [3, 1]},
}
# Standard normal truncated to -1 .. 2: density at both ends, and the probability between them.
_LOW, _HIGH, _INSIDE = stats.norm.pdf(-1), stats.norm.pdf(2), stats.norm.cdf(2) - stats.norm.cdf(-1)
_MEAN = (_LOW - _HIGH) / _INSIDE
MOMENTS = {
    "uniform": (4.0, sqrt(16 / 12)), "log-uniform": (9 / log(10), sqrt(99 / 2 / log(10) - (9 / log(10)) ** 2)),
    "normal": (3.0, 2.0), "triangular": (5 / 3, sqrt(13 / 18)), "lognormal": (2.0, 1.0),
    "truncated-normal": (_MEAN, sqrt(1 + (-_LOW - 2 * _HIGH) / _INSIDE - _MEAN**2)), "choice": (1.75, sqrt(1.6875)),
}


def method(write: Write, name: str, samples: int = 24) -> Campaign:
    text = GRID if name == "grid" else SMALL.replace("seed = 5", f'seed = 5\nmethod = "{name}"')
    return load_study(write(text.replace("samples = 24", f"samples = {samples}")))


@pytest.mark.parametrize("name", others_slow([*RANDOM, "grid"], lambda name: name == "sobol"))
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(indices=st.lists(st.integers(0, 23), min_size=1, max_size=30))
def test_sample_does_not_depend_on_the_others_drawn_with_it(write: Write, name: str, indices: list[int]) -> None:
    assert np.array_equal(method(write, name).draw(indices), method(write, name).draw(range(24))[indices])


@pytest.mark.parametrize("name", RANDOM)
def test_another_seed_changes_every_value(write: Write, name: str) -> None:
    other = SMALL.replace("seed = 5", f'seed = 6\nmethod = "{name}"')
    first = method(write, name).draw(range(24))
    assert not np.any(first == load_study(write(other)).draw(range(24)))


def test_more_samples_do_not_change_the_first_ones(write: Write) -> None:
    for name in ("monte-carlo", "sobol"):
        assert np.array_equal(method(write, name, 24).draw(range(24)), method(write, name, 99).draw(range(24)))


def test_latin_hypercube_has_one_sample_in_every_layer(write: Write) -> None:
    temperature = method(write, "latin-hypercube", 50).draw(range(50))[:, 1]
    assert sorted(np.floor((temperature + 6.0) / 30.0 * 50).astype(int)) == list(range(50))


def test_grid_has_every_point_once(write: Write) -> None:
    points = method(write, "grid").draw(range(24))
    assert len({tuple(point) for point in points.tolist()}) == 24
    assert points[0].tolist() == [0.2, -6.0, 1.0]
    assert points[1].tolist() == [0.2, -6.0, 0.0]  # the last factor changes fastest


def test_index_beyond_the_last_sample_is_refused(write: Write) -> None:
    with pytest.raises(IndexError, match="indices are 0 to 23"):
        method(write, "monte-carlo").draw([24])


@pytest.mark.parametrize("name", list(DISTRIBUTIONS))
def test_mean_and_standard_deviation_of_each_distribution(name: str) -> None:
    """Compare moments over the probabilities (k + 1/2)/n with closed forms.

    The midpoint rule with n = 200 000 misses the tails: beyond 4.6 standard deviations of a normal distribution, which
    is less than 1e-4 of its variance, and 1e-3 for the lognormal distribution.
    """
    probabilities = (np.arange(200_000) + 0.5) / 200_000
    values = distribution({"distribution": name, **EXAMPLES[name]}, PLAIN).at(probabilities)
    mean, sd = MOMENTS[name]
    assert np.mean(values) == pytest.approx(mean, rel=1e-4, abs=1e-4)
    assert np.std(values) == pytest.approx(sd, rel=1e-3)


def test_monte_carlo_samples_have_the_specified_distributions(write: Write) -> None:
    """Kolmogorov's distance of n samples exceeds 1.95/sqrt(n) for one seed in a thousand; the seed is fixed."""
    drawn = method(write, "monte-carlo", 2000).draw(range(2000))
    for column, theory in zip(drawn.T, (stats.norm(0.11, 0.0033), stats.uniform(-6, 30), stats.uniform(-40, 40)),
                              strict=True):
        assert stats.kstest(column, theory.cdf).statistic < 1.95 / sqrt(2000)
    # The correlation of independent samples exceeds 3.3/sqrt(n) once in a thousand.
    correlation = np.corrcoef(drawn.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 3.3 / sqrt(2000)

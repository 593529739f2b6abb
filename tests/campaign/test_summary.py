"""Percentiles, sensitivities with their uncertainty, failures and worst samples of rows with known results."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from math import inf, isnan, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from emcas_fmu.bench.metrics import FIGURES
from emcas_fmu.bench.writers import write_json
from emcas_fmu.studies.campaign import report, sample, summary
from emcas_fmu.studies.campaign.quantiles import PERCENTILES
from emcas_fmu.studies.campaign.report import write_report
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import load_study
from tests.marks import slow

from .conftest import SMALL, Write

Summarised = Callable[..., summary.Summary]


@pytest.fixture
def summarised(write: Write, tmp_path: Path) -> Summarised:
    """Function that summarises 100 rows; figures are 1, 2, 3, ... by index unless a column is passed."""
    def summarise(text: str = SMALL, **columns: Any) -> summary.Summary:
        study = load_study(write(text))
        drawn = np.tile(np.arange(100.0)[:, np.newaxis] % 7, len(study.factors))
        rows = {**sample.failed(study, range(100), drawn, [""] * 100),
                **dict.fromkeys(sample.columns(study), np.arange(100) + 1.0), "status": ["ok"] * 100, **columns}
        with Store(tmp_path / "out", study) as store:
            store.write(rows)
            return summary.summarise(study, store.table())

    return summarise


def spreads(found: summary.Summary, experiment: str, *names: str) -> list[summary.Spread]:
    return [next(s for s in found.spreads if s.name == f"{experiment}.{name}") for name in names]


def test_percentiles_and_worst_samples(summarised: Summarised) -> None:
    spread, rate = spreads(summarised(), "step", "rise_time", "sustained_rate")
    assert spread.percentiles == {p: float(p) for p in PERCENTILES}
    assert spread.worst == ((99, 100.0), (98, 99.0), (97, 98.0))
    assert rate.worst == ((0, 1.0), (1, 2.0), (2, 3.0))  # a smaller rate is worse
    assert spread.mean == 50.5


def test_missing_figure_is_worse_than_any_number(summarised: Summarised) -> None:
    """Ten of a hundred samples have no figure: the 95th percentile is infinite, other percentiles and mean finite."""
    times = [nan if i % 10 == 3 else 1.0 + i / 1000 for i in range(100)]
    spread, rate = spreads(summarised(**{"step.rise_time": times, "step.sustained_rate": times}), "step",
                           "rise_time", "sustained_rate")
    assert spread.without == 10
    assert (spread.percentiles[95], spread.percentiles[99]) == (inf, inf)
    assert (rate.percentiles[1], rate.percentiles[5]) == (-inf, -inf)
    assert [i for i, _ in spread.worst] == [i for i, _ in rate.worst] == [3, 13, 23]
    assert spread.mean == pytest.approx(np.nanmean(times), rel=1e-14)
    assert np.isfinite([rate.percentiles[p] for p in PERCENTILES[2:]]).all()
    assert {summary.text(FIGURES["rise_time"], inf), summary.text(FIGURES["sustained_rate"], -inf)} == {"not reached"}
    assert summary.text(FIGURES["bandwidth_3db"], inf) == "beyond the sweep"


def test_bandwidths_at_the_ends_of_their_search_are_marked_as_bounds(
        summarised: Summarised, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = SMALL + '[experiments.sweep]\nkind = "sweep"\namplitude = "1 deg"\nlow = "1 Hz"\nhigh = "9 Hz"\n'
    found = summarised(text, **{"sweep.bandwidth_3db": [0.0] * 50 + [5.0] * 50})
    (band,) = spreads(found, "sweep", "bandwidth_3db")
    assert [summary.measured(band, band.percentiles[p]) for p in (5, 95)] == ["below the sweep", "5"]
    required = replace(band, name="requirement.bandwidth")
    assert [summary.measured(required, value) for value in (2.0, 12.0, 60.0)] == ["< 2", "12", "> 60"]
    assert summary.measured(required, -inf) == "not reached"
    monkeypatch.setattr(report, "drawings", lambda _: ())
    write_report(found, tmp_path / "page.html", "emcas campaign")
    assert '<td class="n">below the sweep</td>' in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_infinite_figures_keep_their_sign(summarised: Summarised) -> None:
    """A gain of -inf dB is the smallest, a bandwidth beyond the sweep the largest; nan is the worst sample."""
    text = SMALL + '[experiments.sweep]\nkind = "sweep"\namplitude = "1 deg"\nlow = "1 Hz"\nhigh = "9 Hz"\n'
    gains = [-inf if i == 7 else nan if i == 8 else i / 100 for i in range(100)]
    found = summarised(text, **{"sweep.peak_gain": gains, "sweep.bandwidth_3db": [-gain for gain in gains]})
    gain, band = spreads(found, "sweep", "peak_gain", "bandwidth_3db")
    assert (gain.smallest, gain.largest, gain.worst[0]) == (-inf, inf, (8, inf))
    assert (band.smallest, band.largest, band.worst[0]) == (-inf, inf, (8, -inf))
    assert summary.text(FIGURES["peak_gain"], -inf) == "no response"


def test_sensitivities_of_a_linear_figure() -> None:
    """y = 3a - b + noise with standard deviations 3, 1 and 0.5: coefficients 3, -1 over sqrt(10.25).

    Their standard errors are about 0.5/sqrt(10.25 n) = 0.0035; the tolerance is four of them, and the seed is fixed.
    """
    rng = np.random.default_rng(1)
    a, b, c, noise = rng.standard_normal((4, 2000))
    explained, effects = summary.sensitivities(3 * a - b + 0.5 * noise, {"a": a, "b": b, "c": c, "still": 0 * a})
    found = {e.factor: e for e in effects}
    assert list(found) == ["a", "b", "c"]
    total = sqrt(10.25)
    for name, slope in (("a", 3.0), ("b", -1.0), ("c", 0.0)):
        # The standard error is itself an estimate, uncertain by 1/sqrt(2n) = 1.6 %.
        assert found[name].standard_error == pytest.approx(0.5 / total / sqrt(2000), rel=0.1)
        # The coefficient is divided by sample standard deviations, which are uncertain by 1.6 %.
        assert found[name].standardised_coefficient == pytest.approx(
            slope / total, abs=4 * found[name].standard_error, rel=4 * 0.016)
        assert found[name].low < found[name].rank_correlation < found[name].high
    assert (found["a"].sure, found["b"].sure, found["c"].sure) == (True, True, False)
    assert explained == pytest.approx(1.0 - 0.25 / 10.25, abs=0.005)


def test_95_percent_intervals_contain_the_true_correlation_in_95_percent_of_cases() -> None:
    """Of 400 intervals 380 +- 4.4 should contain it (binomial); the tolerance is four standard deviations.

    The rank correlation of normal pairs with r = 0.5 is 6/pi asin(r/2).
    """
    rng = np.random.default_rng(2)
    truth, containing = 6.0 / np.pi * np.arcsin(0.25), 0
    for _ in range(400):
        x, noise = rng.standard_normal((2, 60))
        y = 0.5 * x + sqrt(0.75) * noise
        _, (effect,) = summary.sensitivities(y, {"x": x})
        assert effect.rank_correlation == pytest.approx(float(stats.spearmanr(x, y).statistic))
        containing += effect.low <= truth <= effect.high
    assert 380 - 18 <= containing <= 380 + 18


def test_interval_agrees_with_hand_calculation() -> None:
    """12 ranks with two neighbours exchanged: r = 1 - 6*2/(12*143), with the interval of the documentation."""
    x = np.arange(12.0)
    y = x.copy()
    y[[4, 5]] = y[[5, 4]]
    _, (effect,) = summary.sensitivities(y, {"x": x})
    rank = 1.0 - 12.0 / 1716.0
    half = 1.959963984540054 * sqrt((1.0 + rank**2 / 2.0) / 9.0)
    # A dozen roundings; arctanh near 1 multiplies them by two hundred.
    assert effect.rank_correlation == pytest.approx(rank, abs=1e-14)
    assert (effect.low, effect.high) == pytest.approx(
        (np.tanh(np.arctanh(rank) - half), np.tanh(np.arctanh(rank) + half)), abs=1e-12)


def test_few_samples_or_a_constant_figure_have_no_sensitivities() -> None:
    few = np.arange(5.0)
    assert summary.sensitivities(few, {"a": few})[1] == ()
    many = np.arange(50.0)
    explained, effects = summary.sensitivities(0 * many, {"a": many})
    assert isnan(explained)
    assert effects == ()


@pytest.mark.parametrize("level", [0.0, 0.02, -inf], ids=["decayed", "constant", "never"])
def test_figure_or_factor_that_differs_only_by_rounding_has_no_sensitivity(level: float) -> None:
    many = np.arange(50.0)
    figure = level * (1.0 + 1e-14 * many) + 1e-15 * many
    assert np.isinf(level) or len(np.unique(figure)) > 10
    assert summary.sensitivities(figure, {"a": many})[1] == ()
    constant = 3e-10 * (1.0 + 1e-14 * many)
    assert [e.factor for e in summary.sensitivities(many, {"a": many[::-1], "constant": constant})[1]] == ["a"]
    rising = figure + 1e-6 * many if np.isfinite(level) else np.where(many > 25.0, level, 0.0)
    assert len(summary.sensitivities(rising, {"a": many})[1]) == 1


def test_factor_of_another_experiment_has_no_sensitivity(summarised: Summarised) -> None:
    text = SMALL + '[experiments.other]\nkind = "hold"\namplitude = { distribution = "uniform", low = "0 deg", ' \
                   'high = "9 deg" }\nduration = "0.2 s"\n'
    causes = {s.name.partition(".")[0]: {e.factor for e in s.effects} for s in summarised(text).spreads}
    assert "experiments.other.amplitude" in causes["other"]
    assert "experiments.other.amplitude" not in causes["step"]


def test_failures_are_counted_by_reason(summarised: Summarised) -> None:
    status = ["failed" if i in (4, 7, 9) else "ok" for i in range(100)]
    errors = ["at 0.1 s: lost" if i == 4 else "at 0.2 s: lost" if i == 7 else "odd" if i == 9 else ""
              for i in range(100)]
    found = summarised(status=status, error=errors)
    assert found.failures == (("at … s: lost", 2, 4), ("odd", 1, 9))
    assert (found.done, found.failed, len(found.spreads[0].values)) == (100, 3, 97)


@pytest.mark.drawn
@pytest.mark.parametrize("pages", [1, *slow(2)], ids=["one", "reproducible"])
def test_page_and_json_contain_failures_and_worst_samples(summarised: Summarised, tmp_path: Path, pages: int) -> None:
    status = ["failed" if i == 4 else "ok" for i in range(100)]
    times = [nan if i == 3 else 0.05 + i / 1000 for i in range(100)]
    found = summarised(SMALL.replace("samples = 24", "samples = 100"), status=status,
                       error=[f"<b>{s}" for s in status], **{"step.rise_time": times})
    paths = [tmp_path / f"{k}.html" for k in range(pages)]
    for path in paths:
        write_report(found, path, "emcas campaign small.toml")
    text, *others = (path.read_text(encoding="utf-8") for path in paths)
    assert others == [text] * (pages - 1)
    for part in (found.study.guid, "emcas campaign small.toml --only 3", "emcas campaign small.toml --only 4", "<svg",
                 "&lt;b&gt;failed", "not reached"):
        assert part in text, part
    assert "http" not in text.replace("http://www.w3.org", "").replace("/*! https://", "")  # a library's first line
    write_json(summary.as_dict(found, "emcas campaign small.toml"), tmp_path / "s.json")
    document = json.loads((tmp_path / "s.json").read_text(encoding="utf-8"))
    rise = next(f for f in document["figures"] if f["name"] == "step.rise_time")
    assert rise["worst"][0] == {"index": 3, "value": None}
    assert document["failed"] == 1
    assert document["guid"] == found.study.guid


def test_page_of_a_campaign_whose_samples_all_failed(summarised: Summarised, tmp_path: Path) -> None:
    found = summarised(status=["failed"] * 100, error=["odd"] * 100)
    write_report(found, tmp_path / "a.html", "emcas campaign small.toml")
    assert "100 of them failed" in (tmp_path / "a.html").read_text(encoding="utf-8")

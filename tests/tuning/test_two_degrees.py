"""The set `two-degrees-of-freedom` of every actuator with feed-forward meets its study; studies based on others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from emcas_fmu.actuators import NAMES, NONLINEAR, get
from emcas_fmu.actuators.capabilities import POSITION_LOOP
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import judge, missed
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.studies.analysis.final_values import final_values
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import Study, StudyError, load_study, shipped_study
from emcas_fmu.support.files import models_directory, named_sets
from tests.marks import others_slow, slow

SET = "two-degrees-of-freedom"
WITH_POSITION_LOOP = [name for name in NAMES if POSITION_LOOP in get(name).provides]
WITH_FEED_FORWARD = [name for name in WITH_POSITION_LOOP if get(name).feed_forward is not None]
STUDIES = models_directory() / "tuning"


def _missed(study: Study) -> list[str]:
    """Return the requirements that the study's set misses, with case and measured value."""
    (evaluation,) = evaluate(study, [{}])
    return [f"{j.requirement} in {j.case}: {j.measured:.4g}" for j in evaluation.judgements if not j.met]


@pytest.mark.parametrize("kind", others_slow(WITH_FEED_FORWARD, lambda name: name in (NONLINEAR, "electrohydraulic")))
def test_nominal_actuator_meets_its_study(kind: str) -> None:
    study = shipped_study(load_parameters(SET, model=kind))
    assert not _missed(replace(study, cases=study.cases[:1], requirements=tuple(
        r for r in study.requirements if r.cases is None or "nominal" in r.cases)))


@pytest.mark.parametrize("kind", slow(*WITH_FEED_FORWARD))
def test_every_case_meets_its_study(kind: str) -> None:
    study = shipped_study(load_parameters(SET, model=kind))
    assert len(study.cases) >= 5
    assert not _missed(study)


@pytest.mark.parametrize("kind", slow(*WITH_FEED_FORWARD))
def test_set_meets_the_shipped_requirements(kind: str) -> None:
    parameters = load_parameters(SET, model=kind)
    judged = judge(ParameterSubject(parameters), load_requirements(None, parameters))
    assert [f"{j.name}: {j.measured:.4g}" for j in missed(judged)] == []


@pytest.mark.parametrize("kind", WITH_FEED_FORWARD)
def test_set_is_within_the_bounds_of_a_study_with_sufficient_margins(kind: str) -> None:
    """A search that begins with the set begins within the bounds; 45 deg and 8 dB are usual for a robust loop."""
    parameters = load_parameters(SET, model=kind)
    study = shipped_study(parameters)
    assert all(t.lower <= float(parameters.values[t.name]) <= t.upper for t in study.tunables)
    limits = {r.name: r.limit for r in study.requirements}
    assert limits["phase_margin"] >= 0.785
    assert limits["gain_margin"] >= 8.0


@pytest.mark.parametrize("kind", others_slow(WITH_FEED_FORWARD, lambda name: name in (NONLINEAR, "ozkan")))
def test_final_values_of_the_set_are_stable(kind: str) -> None:
    parameters = load_parameters(SET, model=kind)
    assert all(row["stable"] for row in final_values(parameters.values, model=parameters.model).values())


@pytest.mark.parametrize("kind", [name for name in NAMES if name in WITH_POSITION_LOOP or name == "second-order"])
def test_kind_has_the_set_or_the_error_lists_the_kinds_that_have_it(kind: str) -> None:
    if kind in WITH_FEED_FORWARD:
        found = load_parameters(SET, model=kind)
        assert found.model in (f"{kind}+trajectory", f"{kind}+filters+trajectory")
        assert [name for name, _ in found.files] == [SET]
        assert not found.unused
        return
    with pytest.raises(ParameterError, match=rf"^{SET}: is made for nonlinear, .*servo.* and not for {kind},"):
        load_parameters(SET, model=kind)


def test_every_file_of_a_named_set_belongs_to_a_kind() -> None:
    folders = [path.with_suffix("") for path in named_sets().values()]
    assert {file.stem for folder in folders for file in folder.glob("*.toml")} <= {*WITH_FEED_FORWARD}
    assert {path.name for path in (models_directory() / "sets").iterdir() if path.is_dir()} <= {*named_sets()}


@pytest.mark.parametrize("kind", others_slow(WITH_FEED_FORWARD, lambda name: name in (
    NONLINEAR, "electrohydraulic", "servo")))
def test_trajectory_generator_changes_no_margin(kind: str) -> None:
    """The generator is outside the loop. 1e-9 is the rounding of two linearisations."""
    base = load_parameters(model=f"{kind}+trajectory")
    base = base.with_values(base.having({"drive.current_offset": 0.0}))  # no integral at rest
    without, with_generator = (measure(Test("linear"), ParameterSubject(base.with_values(
        {"trajectory.natural_frequency": frequency})), [{}], ("gain_margin", "phase_margin"), ("minimum",) * 2)[0]
        for frequency in (0.0, 60.0))
    assert with_generator == pytest.approx(without, rel=1e-9)


@pytest.mark.parametrize("kind", WITH_POSITION_LOOP)
def test_warning_if_the_generator_has_the_limits_of_another_actuator(kind: str) -> None:
    unused = load_parameters(model=f"{kind}+trajectory")
    assert not any("trajectory" in warning for warning in unused.warnings)
    used = unused.with_values({"trajectory.natural_frequency": 100.0})
    warned = [warning for warning in used.warnings if "trajectory.rate_limit, " in warning]
    assert bool(warned) == (kind != NONLINEAR)
    assert all(f"{kind} may be slower or faster; set them, or begin with a set" in warning for warning in warned)
    if kind in WITH_FEED_FORWARD:
        assert not any("trajectory" in warning for warning in load_parameters(SET, model=kind).warnings)


BELOW = """
[tunables]
"controller.position.kp" = { lower = "40 1/s", upper = "54 1/s" }
[cases.nominal]
[[requirements]]
name = "first"
test = { kind = "step", amplitude = "1 deg", duration = "1 s" }
figure = "overshoot"
maximum = "3 %"
source = "estimate"
[[requirements]]
name = "second"
test = { kind = "step", amplitude = "5 deg", duration = "1 s" }
figure = "overshoot"
maximum = "3 %"
source = "estimate"
"""


def _study_based_on_other(folder: Path, text: str) -> Study:
    (folder / "below.toml").write_text(BELOW, encoding="utf-8")
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "mine.toml", load_parameters())


def test_study_based_on_another_leaves_out_the_named_requirements(tmp_path: Path) -> None:
    mine = 'over = "below.toml"\nwithout = ["second"]\n' + BELOW.split("[cases.nominal]")[1].split(
        "[[requirements]]\nname = \"second\"")[0].replace("3 %", "4 %")
    study = _study_based_on_other(tmp_path, mine)
    assert [(r.name, r.limit) for r in study.requirements] == [("first", 0.04)]
    assert [t.name for t in study.tunables] == ["controller.position.kp"]


@pytest.mark.parametrize(("text", "words"), [
    ('over = "below.toml"\nwithout = ["secnd"]', r"below\.toml has no requirement secnd.*did you mean second\?"),
    ("over = 1", "over = 1 .*expected the file of a study"),
    ('without = ["second"]', "over = None .*expected the file of a study"),
    ('over = "below.toml"\nrequirements = [1]', "expected tables"),
    ('over = "none.toml"', r"none\.toml: cannot be read"),
])
def test_error_of_a_study_based_on_another(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        _study_based_on_other(tmp_path, text)

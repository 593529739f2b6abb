"""Kernel, Python FMU and native FMU give the same bits, one run at a time or many."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from emcas_fmu.bench.excitation import Excitation, reference_case, slew_to, step_to
from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject, Subject
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.interface import fin_sets
from emcas_fmu.parameters import ParameterError, load_parameters

from ..fmu.built import lean
from .subjects import FIN_PORT, Play

Subjects = Mapping[str, Subject]


@pytest.fixture(scope="module")
def subjects(units: Mapping[str, Path]) -> Iterator[Subjects]:
    """The default actuator as kernel, Python FMU and native FMU."""
    with ExitStack() as stack:
        yield {name: stack.enter_context(open_subject(path)) for name, path in {"kernel": None, **units}.items()}


SPRING = replace(step_to(0.2, 0.1), spring=300.0)


@pytest.mark.parametrize(("excitation", "changes", "substeps"), [
    (reference_case("sag"), {}, 1), (slew_to(-0.3, 0.1, 60.0), {"controller.position.kp": 40.0}, 1),
    (step_to(0.2, 0.1), {"encoder.enabled": False, "encoder.pulses": 2000}, 5), (SPRING, {"fin.start_angle": 0.02}, 5),
    (step_to(0.1, 0.1), {"drive.supply_voltage": 31.0}, 1)],
    ids=["case", "parameter", "substeps", "spring", "supply"])
def test_kernel_and_fmus_give_the_same_bits(subjects: Subjects, excitation: Excitation, changes: dict[str, Any],
                                            substeps: int) -> None:
    runs = {name: subject.run(excitation, changes, substeps=substeps, fine=("supply_power", "at_stop"))
            for name, subject in subjects.items()}
    expected = runs["kernel"]
    assert {name: len(column) for name, column in expected.columns.items()} == {
        name: (len(excitation.time) - 1) * (substeps if name in ("supply_power", "at_stop") else 1) + 1
        for name in ("time", *subjects["kernel"].outputs)}
    for run in runs.values():
        assert run.stopped is None
        assert list(run.columns) == ["time", *subjects["kernel"].outputs]
        for name, column in expected.columns.items():
            np.testing.assert_array_equal(run.columns[name], column, err_msg=name)


class OneByOne(ParameterSubject):
    """The kernel, which computes many runs one after another as an FMU does."""

    run_all = Subject.run_all

    def run(self, *arguments: Any) -> Run:
        return ParameterSubject(self.parameters).run(*arguments)


@pytest.mark.parametrize("spring", [0.0, np.array([300.0, 0.0, 100.0, 0.0])], ids=["", "springs"])
def test_many_runs_together_equal_single_runs(spring: Any) -> None:
    """Also if one run is refused and another ends early."""
    step = step_to(0.2, 0.1)
    load = np.outer([0.0, 10.0, 0.0, 1e300], step.time > step.time[-30])
    excitation = replace(step, columns={"fin_command": step.command, "aero_torque": load}, spring=spring)
    changes = {"controller.position.kp": np.array([40.0, 50.0, -1.0, 60.0]),
               "encoder.pulses": np.array([500, 2000, 500, 2000]),
               "drive.supply_voltage": np.array([31.0, 39.0, 39.0, 39.0])}
    recorded: Any = (("fin_angle", "supply_power"), 5, ("supply_power",))
    for subject in (ParameterSubject(load_parameters()), OneByOne(load_parameters())):
        runs = subject.run_all(excitation, changes, *recorded)
        assert (len(runs), list(runs.refused), list(runs.stopped)) == (4, [2], [3])
        for index in range(4):
            changes_of_run = {name: values[index].item() for name, values in changes.items()}
            alone = partial(subject.run, excitation.of(index), changes_of_run, *recorded)
            if index == 2:
                for refused in (alone, partial(runs.__getitem__, index)):
                    with pytest.raises(ParameterError, match=r"controller\.position\.kp = -1 "):
                        refused()
                continue
            expected, run = alone(), runs[index]
            assert (run.stopped, run.messages) == (expected.stopped, expected.messages)
            if index == 3:  # the first row with the huge load: the row's time is exact up to rounding
                assert run.stopped == pytest.approx(step.time[-29], abs=1e-12)
            for name, column in expected.columns.items():
                np.testing.assert_array_equal(run.columns[name], column, err_msg=name)


def test_run_does_not_change_the_next_run(subjects: Subjects) -> None:
    for subject in subjects.values():
        first = subject.run(step_to(0.1, 0.1), outputs=["fin_angle"])
        subject.run(SPRING, {"controller.position.kp": 40.0})
        again = subject.run(step_to(0.1, 0.1), outputs=["fin_angle"])
        assert list(again.columns) == ["time", "fin_angle"]
        np.testing.assert_array_equal(first.columns["fin_angle"], again.columns["fin_angle"])


def test_substeps_record_points_between_rows() -> None:
    subject = ParameterSubject(load_parameters())
    coarse, fine, every = (subject.run(step_to(0.2, 0.1, step=step), substeps=n, fine=["fin_angle"]).columns
                           for step, n in ((1e-3, 1), (1e-3, 5), (2e-4, 1)))
    assert len(fine["fin_rate"]) == len(fine["time"]) == len(coarse["time"])
    # The end of a step is reached up to rounding of the time, which changes an angle of 0.2 rad by less than 1e-12.
    np.testing.assert_allclose(fine["fin_angle"][::5], coarse["fin_angle"], atol=1e-12)
    np.testing.assert_allclose(fine["fin_angle"], every["fin_angle"], atol=1e-12)


def test_spring_is_a_hinge_torque_proportional_to_the_angle(subjects: Subjects) -> None:
    run = subjects["kernel"].run(SPRING)
    torque = -SPRING.spring * run.columns["fin_angle"]
    excitation = Excitation("torque", {"fin_command": SPRING.command, "aero_torque": torque})
    np.testing.assert_array_equal(subjects["native"].run(excitation).columns["fin_angle"], run.columns["fin_angle"])


def test_actuator_is_homed_unless_the_excitation_homes_it() -> None:
    """An actuator that is not homed follows no command. An excitation with `home` begins with the search."""
    step = step_to(0.02, 0.1)
    plain, homing = (ParameterSubject(load_parameters(model=model)) for model in ("nonlinear", "nonlinear+homing"))
    np.testing.assert_array_equal(homing.run(step).columns["fin_angle"], plain.run(step).columns["fin_angle"])
    assert np.all(homing.run(step).columns["homed"])
    searching = homing.run(step.holding({"home": 1.0}))
    assert not np.any(searching.columns["homed"])
    assert np.ptp(searching.columns["fin_angle"]) > 0.0
    assert not np.any(homing.run(step, {"homing.required": True}).columns["fin_angle"])
    # A variant with homing required changes no other variant.
    variants = [{}, *({"homing.required": required} for required in (False, True))]
    angles = measure(Test("step", 0.02, 0.3), homing, variants, ("held_angle",), ("minimum",))[:, 0]
    assert angles[0] == angles[1] == pytest.approx(0.02, abs=1e-3)
    assert angles[2] == 0.0


def test_error_names_the_variables_that_a_subject_lacks(subjects: Subjects) -> None:
    for subject in subjects.values():
        with pytest.raises(EmcasError, match=r"this actuator has no steam, valve\.gain"):
            subject.run(Excitation("t", {"steam": np.zeros(10)}), {"valve.gain": 1.0})
        with pytest.raises(ParameterError, match=r"controller\.position\.kp"):
            subject.run(step_to(0.1, 0.1), {"controller.position.kp": -1.0})
        assert subject.lacking(("fin_angle", "pressure")) == "this actuator has no pressure"
    bare = Play(outputs=FIN_PORT)
    assert bare.lacking(("fin_angle",)) == ""
    assert bare.lacking(("motor_current",)) == "this actuator has no motor_current"
    assert bare.obstacle(step_to(0.1, 0.1)) == ""
    assert "valve.gain" in bare.obstacle(step_to(0.1, 0.1).with_start_values({"valve.gain": 1.0}))


def test_fmu_for_model_exchange_only_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "exchange.fmu"
    with ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", (
            '<fmiModelDescription fmiVersion="2.0" modelName="x" guid="y"><ModelExchange modelIdentifier="x"/>'
            '<ModelVariables><ScalarVariable name="a" valueReference="0" causality="parameter" variability="fixed">'
            '<Real start="1"/></ScalarVariable></ModelVariables><ModelStructure/></fmiModelDescription>'))
    with pytest.raises(EmcasError, match=r"is not a co-simulation FMU of FMI 2\.0 or 3\.0"), open_subject(path):
        pass


def test_one_fin_of_several(tmp_path: Path) -> None:
    (tmp_path / "worn.toml").write_text('[friction]\nfin_coulomb = "5 N*m"\n', encoding="utf-8")
    sets = fin_sets(load_parameters(model="elastic"), 2, "plus", {2: tmp_path / "worn.toml"})
    fmu = lean(load_parameters(model="elastic"), tmp_path / "Two.fmu", fins=2, layout="plus",
               files={2: tmp_path / "worn.toml"})
    with open_subject(fmu, fin=2) as subject:
        about = subject.identification
        assert (subject.model, about.fin) == ("elastic", 2)
        assert set(about.differences) == {"friction.fin_coulomb", "mounting.azimuth"}
        found = subject.run(step_to(0.1, 0.1)).columns["fin_angle"]
    expected = ParameterSubject(sets[1]).run(step_to(0.1, 0.1)).columns["fin_angle"]
    np.testing.assert_array_equal(found, expected)
    with pytest.raises(EmcasError, match="its model is elastic"), open_subject(fmu, "linear"):
        pass
    with pytest.raises(EmcasError, match="has 2 fins, there is no fin 0"), open_subject(fmu, fin=0):
        pass
    with pytest.raises(EmcasError, match="leave --fin out"), open_subject(tmp_path / "worn.toml", fin=1):
        pass

"""One sample: its figures equal those of the bench, and its failure does not stop the campaign."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf, isnan, nan, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench import metrics
from emcas_fmu.bench.excitation import Excitation, slew_to, step_to
from emcas_fmu.bench.frequency_response import frequency_response
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.motions import LEAD_IN, MOTIONS, OLD_WORDS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.cases import CASES
from emcas_fmu.runtime import library
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.campaign import experiments, sample
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.experiments import Experiment, Profile, excitation
from emcas_fmu.studies.campaign.study import Campaign, load_study
from tests.bench.subjects import Broken

from .conftest import SMALL, Write, assert_same_rows, row_of, rows_of

SUBJECT = ParameterSubject(load_parameters())
FAULTY = SMALL + """
[experiments.step.inputs.supply_voltage]
kind = "window"
value = { distribution = "uniform", low = "10 V", high = "39 V" }
begin = "10 ms"
end = "40 ms"

[experiments.off]
kind = "hold"
amplitude = "2 deg"
duration = "0.2 s"

[experiments.off.inputs.enable]
kind = "window"
value = false
begin = "50 ms"
end = "90 ms"

[experiments.off.inputs.aero_torque]
kind = "spring"
stiffness = "150 N.m/rad"
"""


def figures(experiment: Experiment, numbers: Mapping[str, float]) -> dict[str, float]:
    """Return the figures of an experiment with the shipped parameters, by the bench's names."""
    _, run = SUBJECT.run_all(excitation(experiment, SUBJECT.values, numbers, SUBJECT.model), {},
                             substeps=experiments.POWER_ROWS, fine=[experiments.POWER]).finished()
    found = experiments.measured(experiment, numbers, run, experiments.leaps(SUBJECT, {}, run))
    return {name: values.item() for name, values in found.items()}


@pytest.mark.parametrize(("kind", "motion"), [("step", step_to), ("slew", slew_to)])
def test_step_and_slew_have_the_figures_of_the_bench(kind: str, motion: Callable[[float, float], Excitation]) -> None:
    """Figures are those of the last jump. Additional rows of the power split the kernel's ticks: rounding differs."""
    found = figures(Experiment("a", kind, 0.6), {"experiments.a.amplitude": radians(5.0)})
    run = SUBJECT.run(motion(radians(5.0), 0.6))
    expected = {**metrics.usage_figures(run), **metrics.motion_figures(run, -1)}
    for name in ("rise_time", "settling_time", "overshoot", "sustained_rate", "peak_current", "rms_tracking_error"):
        assert found[name] == pytest.approx(expected[name], rel=1e-9), name
    assert found["steady_error"] == pytest.approx(abs(expected["steady_error"]), rel=1e-9)


def test_sweep_has_the_bandwidth_of_the_reference_case(values: Mapping[str, Any]) -> None:
    """The rows of the reference case are rounded to nine digits, which changes the bandwidth by less than 1e-4."""
    case = next(c for c in CASES if c.name == "chirp_1deg")
    inputs = case.inputs()
    angle = simulate(values, case.stop_time, fin_command=inputs["fin_command"])["fin_angle"]
    expected = frequency_response(inputs["time"], inputs["fin_command"], angle, 0.5, 30.0)
    found = figures(Experiment("a", "sweep", case.stop_time - LEAD_IN), {
        "experiments.a.amplitude": case.amplitude, "experiments.a.low": 0.5, "experiments.a.high": 30.0})
    assert found["bandwidth_3db"] == pytest.approx(expected.bandwidth, rel=1e-4)
    assert found["bandwidth_90deg"] == pytest.approx(expected.phase_bandwidth, rel=1e-4)


@pytest.mark.parametrize("compiled", [True, False])
def test_spring_torque_is_proportional_to_the_previous_angle(monkeypatch: pytest.MonkeyPatch, compiled: bool) -> None:
    if not compiled:
        monkeypatch.setattr(library, "available", lambda *_: False)
    experiment = Experiment("a", "step", 0.2, (Profile("aero_torque", "spring", "inputs.aero_torque"),))
    numbers = {"experiments.a.amplitude": radians(10.0), "inputs.aero_torque.stiffness": 200.0,
               "inputs.aero_torque.offset": -3.0}
    found = SUBJECT.run(excitation(experiment, SUBJECT.values, numbers, SUBJECT.model), substeps=5,
                        fine=["supply_power"]).columns
    # Without gravity and acceleration the hinge torque is that of the spring, up to rounding.
    assert found["hinge_torque"][1:] == pytest.approx(-3.0 - 200.0 * found["fin_angle"][:-1], abs=1e-12)
    assert found["fin_angle"][-1] > radians(9.0)


def test_low_supply_voltage_slows_only_its_experiment(write: Write) -> None:
    study = load_study(write(FAULTY))
    drawn = [0.11, 24.0, -20.0]
    low, full = (row_of(study, 0, [*drawn, volts], SUBJECT) for volts in (12.0, 39.0))
    assert low["status"] == full["status"] == "ok"
    # 12 V is a third of the supply voltage: the fin is much slower.
    assert low["step.rise_time"] > 1.5 * full["step.rise_time"]
    assert low["off.net_energy"] == full["off.net_energy"]


def test_row_has_seed_index_drawn_values_and_figures(write: Write) -> None:
    study = load_study(write(FAULTY))
    row = rows_of(study, [3], study.draw([3]))[0]
    assert row["index"] == 3
    assert row["seed"] == 5
    assert {"motor.torque_constant", "motor.back_emf_constant", "friction.temperature", "inputs.aero_torque.value",
            "experiments.step.inputs.supply_voltage.value"} < set(row)
    # A settling time longer than the run is infinite, not nan.
    assert not any(isnan(row[name]) for name in sample.columns(study))
    assert list(row) == list(sample.failed(study, [3], study.draw([3]), [""]))


def test_failed_sample_is_recorded_with_its_reason(write: Write) -> None:
    """Invalid combination, value beyond its limit, unexpected exception, run that ends early."""
    text = SMALL + '[vary."fin.start_angle"]\ndistribution = "normal"\nmean = "0 deg"\nsd = "20 deg"\n'
    study = load_study(write(text))
    rows = rows_of(study, [0, 1, 2], np.array([[0.11, 20.0, radians(40.0), 0.0], [-1.0, 20.0, 0.0, 0.0],
                                               [0.11, 20.0, 0.0, 0.0]]))
    assert [row["status"] for row in rows] == ["failed", "failed", "ok"]
    assert "fin.start_angle" in rows[0]["error"]
    assert "motor.torque_constant = -1 is below its minimum" in rows[1]["error"]
    assert all(isnan(rows[0][name]) for name in sample.columns(study))

    class Raising(ParameterSubject):
        def run_all(self, *_: Any, **__: Any) -> Any:
            raise KeyError("odd")

    row = row_of(study, 5, [0.11, 20.0, 0.0, 0.0], Raising(SUBJECT.parameters))
    assert row["error"] == "KeyError: 'odd'"
    stopped = row_of(study, 5, [0.11, 20.0, 0.0, 0.0], Broken(SUBJECT.values))
    assert (stopped["status"], stopped["error"]) == ("failed", "error: the bridge is open")


def test_sample_that_never_reaches_the_command_does_not_fail(small: Campaign) -> None:
    """A load beyond the motor's torque turns the fin to the stop: the rise time is missing, other figures are not."""
    row = row_of(small, 0, [0.11, 20.0, -2000.0], SUBJECT)
    assert row["status"] == "ok"
    assert isnan(row["step.rise_time"])
    assert row["step.at_stop_share"] > 0.0


SWEPT = """
[campaign]
samples = 8
[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"
[inputs.enable]
kind = "constant"
value = { levels = [false, true] }
[experiments.sweep]
kind = "chirp"
amplitude = "2 deg"
low = "2 Hz"
high = { levels = ["20 Hz", "6 Hz"] }
duration = "2 s"
"""


@pytest.mark.parametrize("kind", [*MOTIONS, *OLD_WORDS])
def test_every_kind_of_motion_is_an_experiment(write: Write, kind: str) -> None:
    shape = "".join(f'{field} = "{hertz} Hz"\n' for field, hertz in zip(
        MOTIONS[OLD_WORDS.get(kind, kind)].shape, (5, 20), strict=False))
    study = load_study(write(SMALL.replace('kind = "step"\n', f'kind = "{kind}"\n{shape}')))
    row = row_of(study, 0, [0.11, 20.0, -10.0], SUBJECT)
    assert (row["status"], row["error"]) == ("ok", "")
    assert row["step.peak_rate"] > 0.01
    assert ("step.rise_time" in row) == MOTIONS[study.experiments[0].kind].jumps
    assert ("step.bandwidth_3db" in row) == MOTIONS[study.experiments[0].kind].sweeps


def test_disabled_actuator_has_zero_bandwidth_and_no_gain(write: Write, recwarn: pytest.WarningsRecorder) -> None:
    """The bandwidth of the enabled actuator, about 30 Hz, is beyond the end of the sweep and thus infinite."""
    study = load_study(write(SWEPT))
    disabled, enabled = (row_of(study, 0, [0.11, enable, 6.0], SUBJECT) for enable in (0.0, 1.0))
    assert disabled["status"] == enabled["status"] == "ok"
    assert [disabled[f"sweep.{name}"] for name in ("bandwidth_3db", "bandwidth_90deg", "peak_gain")] == [0.0, 0.0, -inf]
    assert (enabled["sweep.bandwidth_3db"], enabled["sweep.bandwidth_90deg"]) == (inf, inf)
    assert -3.0 < enabled["sweep.peak_gain"] < 3.0
    assert not recwarn.list


def test_error_names_drawn_values_in_the_wrong_order(write: Write) -> None:
    text = SMALL + """
[experiments.step.inputs.supply_voltage]
kind = "window"
value = "20 V"
begin = "20 ms"
end = { distribution = "uniform", low = "10 ms", high = "40 ms" }
"""
    study = load_study(write(text))
    wrong, right = (row_of(study, 0, [0.11, 20.0, 0.0, end], SUBJECT) for end in (0.012, 0.03))
    assert right["status"] == "ok"
    assert wrong["error"] == "a window's end = 0.012 s is before its begin = 0.02 s"
    tails = SWEPT.replace('{ levels = ["20 Hz", "6 Hz"] }', '{ distribution = "normal", mean = "20 Hz", sd = "5 Hz" }')
    study = load_study(write(tails))
    row = row_of(study, 0, [0.11, 1.0, 1.5], SUBJECT)
    assert row["error"] == "the sweep's low = 2 Hz is not below its high = 1.5 Hz"


@pytest.mark.fmu
def test_fmu_gives_the_kernels_figures(write: Write, native: Path) -> None:
    path = write(FAULTY)
    by_fmu, by_kernel = load_study(path, native), load_study(path)
    assert by_fmu.guid == by_kernel.guid != ""
    assert_same_rows(by_fmu, by_kernel, by_kernel.draw(range(3)))


@pytest.mark.fmu
def test_fmu_runs_after_a_failed_sample_and_must_not_change(write: Write, native: Path, tmp_path: Path) -> None:
    study = load_study(write(SMALL), native)
    subject = sample.subject_of(study)
    good = [0.11, 20.0, 0.0]
    before = row_of(study, 0, good, subject)
    bad = row_of(study, 0, [0.11, 20.0, nan], subject)
    assert bad["status"] == "failed"
    assert "aero_torque" in bad["error"]
    assert row_of(study, 0, good, subject) == before
    with pytest.raises(CampaignError, match="is not the file with which the campaign began"):
        sample.subject_of(replace(study, fmu_sha256="0" * 64))

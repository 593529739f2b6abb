"""Figures of the report agree with closed forms of simple subjects and signals."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, isnan, nan, pi, radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench import metrics
from emcas_fmu.bench.frequency_response import Sines, held
from emcas_fmu.bench.metrics import unit_of
from emcas_fmu.bench.runs import StoppedError
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import kinematics
from emcas_fmu.studies.report import accuracy, budget, mission, responses, stiffness
from emcas_fmu.studies.report.outcome import FigureGroup, Outcome, Quantity, Rig

from ..bench.subjects import Broken, Known, Play, SecondOrder, count

FRICTIONLESS = {f"friction.{name}": 0.0 for side in ("positive", "negative")
                for name in (f"viscous.{side}", *(f"coulomb.{side}[{k}]" for k in range(7)))}


def test_bidirectional_figures_agree_with_hand_calculation() -> None:
    below = np.array([[nan, nan], [1.0, 3.0], [2.0, 2.0]])
    above = np.array([[0.0, 0.0], [-1.0, -1.0], [nan, nan]])
    found = metrics.bidirectional(below, above)
    # Means 2 and -1 at the middle target; the sample standard deviation of 1 and 3 is the square root of 2.
    assert found["hysteresis"] == pytest.approx(3.0)
    assert found["largest_error"] == 3.0
    assert found["repeatability"] == pytest.approx(4.0 * 2**0.5)
    assert found["bidirectional_accuracy"] == pytest.approx((2.0 + 2.0 * 2**0.5) - -1.0)
    assert found["mean_error"] == pytest.approx((1.0 + 3.0 + 2.0 + 2.0 + 0.0 + 0.0 - 1.0 - 1.0) / 8.0)
    assert isnan(found["reversal"][0])
    assert isnan(found["reversal"][2])


@pytest.mark.parametrize("half", [0.002, 0.05])
def test_play_has_the_hysteresis_of_its_width(half: float) -> None:
    found = accuracy.static(Rig(Play(half_width=half))).figures["grid"]
    # Only the conversion between degrees and radians rounds.
    assert found["hysteresis_deg"] == pytest.approx(2.0 * half, abs=1e-12)
    assert found["largest_error_deg"] == pytest.approx(half, abs=1e-12)
    assert found["bidirectional_accuracy_deg"] == pytest.approx(2.0 * half, abs=1e-12)
    assert found["repeatability_deg"] == pytest.approx(0.0, abs=1e-12)


class Spring(Known):
    """Follows the previous row's command exactly, and yields to a load by 1 deg for 500 N.m."""

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        return np.append(0.0, command[:-1]) + np.radians(np.asarray(torque) / 500.0)


def test_budget_of_play_and_spring_agrees_with_hand_calculation() -> None:
    """No parameter affects these subjects: other terms are zero, and drawn samples are identical."""
    play, spring = (budget.measure(Rig(subject)).figures for subject in (Play(half_width=0.03), Spring()))
    for figures, loop, friction in ((play, (0.0, 0.0), (0.03, 0.03)), (spring, (0.0, 0.2), (0.0, 0.0))):
        sums = ("worst_case", "root_of_squares", "monte_carlo_95", "monte_carlo_99", "as_set", "required")
        assert {name for name in figures if name not in sums} > {"loop", "friction", "encoder", "screw_lead"}
        for k, load in enumerate(("unloaded_deg", "loaded_deg")):
            expected = {"loop": loop[k], "friction": friction[k]}
            for name in figures.keys() - {*sums}:
                assert figures[name][load] == pytest.approx(expected.get(name, 0.0), abs=1e-12)
            assert figures["worst_case"][load] == pytest.approx(loop[k] + friction[k], abs=1e-12)
            for name in ("monte_carlo_95", "monte_carlo_99", "as_set"):
                assert figures[name][load] == pytest.approx(max(loop[k], friction[k]), abs=1e-12)
            assert figures["required"][load] == pytest.approx(0.2, abs=1e-12)


def test_search_of_the_smallest_size_encloses_a_known_threshold() -> None:
    tried: list[float] = []

    def moves(size: float) -> bool:
        tried.append(size)
        return size >= 0.3

    assert 0.3 <= accuracy.smallest(moves, 1e-3, 10.0, 1.02) <= 0.3 * 1.02
    assert max(size for size in tried if size < 0.3) * 1.02 >= 0.3
    assert isnan(accuracy.smallest(lambda _: False, 1e-3, 10.0))
    assert accuracy.smallest(lambda _: True, 1e-3, 10.0) == 1e-3


def test_hunting_does_not_count_as_a_response() -> None:
    hunting = np.tile([0.0, 0.1], 50)
    assert accuracy.motion_beyond(hunting, 50, 1.0) == 0.0
    moved = hunting + np.where(np.arange(100) > 50, 0.06, 0.0)
    assert [accuracy.motion_beyond(moved, 50, sign) for sign in (1.0, -1.0)] == pytest.approx([0.06, 0.0])


@pytest.mark.parametrize("half", [0.01, 0.2])
def test_play_has_the_thresholds_of_its_width(half: float, values: Mapping[str, Any]) -> None:
    found = accuracy.threshold(Rig(Play(half_width=half))).figures
    # The fin crosses half the play, all of it, or nothing, and then moves by one count.
    for group, crossed in (("from_rest", half), ("after_reversal", 2.0 * half), ("increment", 0.0)):
        expected = crossed + count(values)
        for value in found[group].values():
            # The detection threshold is half a thousandth of a count lower.
            assert expected * (1.0 - 5e-4) <= value <= expected * accuracy.RATIO


def test_fundamental_of_a_sine_with_offset_drift_and_harmonic() -> None:
    sines, time = Sines(np.array([4.0]), (0.0, 0.7), (8.0, 0.0), drift=True), np.arange(2701) * 1e-3
    values = 3.0 * np.cos(2 * pi * 4.0 * time + 0.4) + 5.0 + 0.2 * time
    (found,) = sines.fit(values[np.newaxis])
    assert found == pytest.approx(3.0 * np.exp(0.4j), abs=1e-9)
    # Over whole cycles a harmonic enters only through the drift, which fits up to 6/(pi 24) of 24 cycles and adds
    # 2/(pi 8) of itself to the 8 cycles of the fundamental.
    values += 0.5 * np.cos(2 * pi * 12.0 * time)
    leakage = 0.5 * 6 / (pi * 24) * 2 / (pi * 8)
    (found,) = sines.fit(values[np.newaxis])
    assert found == pytest.approx(3.0 * np.exp(0.4j), abs=leakage)


def test_fundamental_of_a_held_sinusoid() -> None:
    frequency, step, fine = 40.0, 1e-3, 200
    time = np.arange(100 * fine) * step / fine  # four cycles
    samples = np.cos(2 * pi * frequency * np.floor(np.arange(100 * fine) / fine) * step)
    found = 2.0 * np.mean(samples * np.exp(-2j * pi * frequency * time))
    # The sum over the fine grid is an integral shifted by half a fine step: 40 Hz x 2 pi x 2.5 us.
    assert held(1.0, frequency, step) == pytest.approx(found, abs=1e-3)


def test_stiffness_of_a_second_order_system() -> None:
    subject = SecondOrder()
    found, locked, _ = stiffness.sweep(Rig(subject), 50.0, True)
    expected = subject.dynamic_stiffness(np.array(stiffness.FREQUENCIES))
    # After 0.5 s the transient is exp(-40 * 0.5). Sampling folds the response to the hold's image at 960 Hz to 40 Hz:
    # 1/24 of the hold times 1/576 of the inertia.
    assert found == pytest.approx(expected, rel=2e-4)
    assert not locked
    powered = stiffness.measure(Rig(subject)).figures["powered"]
    least = stiffness.FREQUENCIES[np.argmin(np.abs(expected))]
    assert powered["least_stiffness_at_hz"] == least
    assert powered["stiffness_10hz_n_m_per_rad"] == pytest.approx(abs(subject.dynamic_stiffness(10.0)), rel=2e-4)


def test_breakaway_of_a_record() -> None:
    moment = np.linspace(0.0, 10.0, 101)
    angle = np.where(moment > 4.0, 1e-3, 0.0)
    assert metrics.breakaway(moment, angle) == pytest.approx(4.1)
    assert metrics.breakaway(-moment, angle) == pytest.approx(4.1)
    assert isnan(metrics.breakaway(moment, np.zeros(101)))


def _ratio(values: Mapping[str, Any]) -> float:
    """Return the ratio of motor angle to fin angle at 0 deg."""
    return float(values["kinematics.moment_arm"] / values["screw.lead"]
                 / cos(values["kinematics.initial_angle"]) ** 2)


def test_breakaway_is_the_friction_at_the_hinge() -> None:
    parameters = load_parameters().with_values({"friction.fin_coulomb": 3.0})
    values = parameters.values
    found = stiffness.measure(Rig(ParameterSubject(parameters)))
    for side in ("positive", "negative"):
        expected = _ratio(values) * values[f"friction.coulomb.{side}[0]"] + 3.0
        # The resolution is a thousandth of the rated load.
        assert expected - 1e-6 <= found.figures["breakaway"][f"{side}_n_m"] <= expected + 0.1
    assert found.figures["unpowered_below_breakaway"]["friction_locked"] is True
    assert "unpowered_below_breakaway" not in found.curves
    assert found.figures["unpowered_above_breakaway"]["friction_locked"] is False
    assert any("friction-locked" in note for note in found.notes)


def test_unpowered_without_friction_is_an_inertia() -> None:
    parameters = load_parameters().with_values(FRICTIONLESS)
    values = parameters.values
    found = stiffness.measure(Rig(ParameterSubject(parameters)))
    assert "unpowered_below_breakaway" not in found.figures
    fin = values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]
    motor = values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * values["screw.lead"] ** 2
    inertia = fin + _ratio(values) ** 2 * motor
    curve = found.curves["unpowered_above_breakaway"]
    fast = curve["frequency_hz"] >= 5.0
    # Below 5 Hz the fin moves by degrees, and the ratio changes; above 5 Hz by less than 0.1 deg and 0.1 %.
    expected = inertia * (2 * pi * curve["frequency_hz"][fast]) ** 2
    assert curve["stiffness_n_m_per_rad"][fast] == pytest.approx(expected, rel=5e-3)
    assert np.abs(curve["phase_deg"][fast]) == pytest.approx(180.0, abs=1.0)


def test_report_says_that_the_actuator_is_self_locking() -> None:
    parameters = load_parameters().with_values({"friction.fin_coulomb": 500.0})
    found = stiffness.measure(Rig(ParameterSubject(parameters)))
    assert all(isnan(value) for value in found.figures["breakaway"].values())
    assert "unpowered_above_breakaway" not in found.figures
    assert any("does not move on under the rated load" in note for note in found.notes)


def test_energies_of_a_sine() -> None:
    time = np.linspace(0.0, 1.0, 2001)
    found = metrics.power_figures(np.sin(2 * pi * time), metrics.leap_weights(len(time), time[1], np.empty(0)))
    # The trapezoidal rule is off by h^2/12 times the change of slope, 4 pi: 2.6e-7.
    assert found["energy_drawn"] == pytest.approx(1.0 / pi, abs=1e-6)
    assert found["energy_returned"] == pytest.approx(1.0 / pi, abs=1e-6)


@pytest.mark.parametrize(("limit", "load"), [(20.0, 100.0), (12.0, 7.0)])
def test_synthetic_mission_keeps_range_rate_and_load(limit: float, load: float) -> None:
    command, moment = mission.synthetic(limit, load)
    assert len(command) == len(moment) == 15001
    assert 0.85 * limit < np.max(np.abs(command)) <= limit
    assert np.max(np.abs(np.diff(command))) <= mission.RATE * 1e-3 * (1 + 1e-9)
    assert 0.85 * load < np.max(np.abs(moment)) <= load
    late = round(mission.LAG / 1e-3)
    assert np.all(moment[late:] * command[:-late] <= 0.0)  # restoring


def test_steps_and_slew_of_a_second_order_system() -> None:
    subject = SecondOrder()
    found = responses.steps(Rig(subject))
    assert list(found.figures) == [f"{sign}_{size}deg" for size in (1, 5, 10, 20) for sign in ("plus", "minus")]
    natural = (subject.stiffness / subject.mass) ** 0.5
    damping = subject.damping / (2.0 * subject.mass * natural)
    overshoot = 100.0 * np.exp(-pi * damping / (1.0 - damping**2) ** 0.5)
    for figures in found.figures.values():  # linear: equal for every size and sign
        assert figures["overshoot_percent"] == pytest.approx(overshoot, abs=0.1)  # the row nearest to the peak
        assert figures["steady_error_deg"] == pytest.approx(0.0, abs=1e-9)
    slew = responses.slews(Rig(subject)).figures
    # Without the output fin_rate the sustained rate is computed from the angle, alike in both directions.
    assert slew["unloaded_positive"]["sustained_rate_deg_per_s"] == pytest.approx(
        slew["unloaded_negative"]["sustained_rate_deg_per_s"], rel=1e-9)
    # 100 N.m deflects this spring by 0.64 deg: the fin arrives later against the load and earlier with it.
    times = [slew[f"{load}_positive"]["time_to_90_percent_s"] for load in ("aiding", "unloaded", "opposing")]
    assert times == sorted(times)
    assert times[0] < times[2]


def test_sizes_stay_within_the_range_of_commands(values: Mapping[str, Any]) -> None:
    small = Rig(Play(values={**values, "command.limit": radians(7.5)}))
    assert list(responses.steps(small).figures) == [f"{sign}_{size}deg" for size in ("1", "5", "7p5")
                                                    for sign in ("plus", "minus")]


def test_encoder_count_at_the_fin(values: Mapping[str, Any]) -> None:
    assert degrees(accuracy.detected_motion(Play())[0]) == pytest.approx(count(values))
    turn = 360.0 / (values["encoder.pulses"] * values["encoder.multiplier"])
    assert accuracy.detected_motion(Play(values={**values, "encoder.on_fin": True}))[0] == pytest.approx(radians(turn))
    size, words = accuracy.detected_motion(Play(values={**values, "encoder.enabled": False}))
    assert degrees(size) == pytest.approx(0.002)
    assert words == "1 % of the accuracy of Table 2 of Yerlikaya (2016)"


@pytest.mark.parametrize("initial", [0.0, 40.0])
@pytest.mark.parametrize("model", ["nonlinear", "habibi"])
def test_encoder_count_is_the_largest_motion_of_a_count(model: str, initial: float) -> None:
    """Compare with differences of the fin angle at 2,001 motor angles; 1e-3 is for their curvature."""
    parameters = load_parameters(model=model).with_values({"kinematics.initial_angle": radians(initial)})
    p = parameters.actuator.plant(parameters.values)
    turn = 2.0 * pi / (p.encoder.pulses * p.encoder.multiplier)
    low, high = (kinematics.motor_angle(FLOATS, p, side * p.command.limit) for side in (-1.0, 1.0))
    motor = np.linspace(low, high, 2001)
    angles = [kinematics.fin_at(FLOATS, p, angle) for angle in motor.tolist()]
    expected = np.diff(angles).max() * turn / (motor[1] - motor[0])
    assert accuracy.detected_motion(ParameterSubject(parameters))[0] == pytest.approx(expected, rel=1e-3)


def test_error_if_a_run_ends_early() -> None:
    with pytest.raises(StoppedError, match=r"no further than 0\.01 s: error: the bridge is open"):
        responses.steps(Rig(Broken()))


@pytest.mark.parametrize(("key", "unit"), [
    ("rise_time_s", "s"), ("sustained_rate_deg_per_s", "deg/s"), ("stiffness_1hz_n_m_per_rad", "N.m/rad"),
    ("positive_n_m", "N.m"), ("friction_locked", "1"), ("overshoot_percent", "%"), ("peak_gain_db", "dB")])
def test_unit_of_a_figure(key: str, unit: str) -> None:
    assert unit_of(key) == unit


def test_groups_without_common_figures_are_separate_tables() -> None:
    keys = tuple(Quantity(k, "", k) for k in ("a_s", "b_s", "c_s"))
    groups = {"one": {"a_s": 1.0}, "two": {"b_s": 1.0, "c_s": 2.0}, "three": {"b_s": 3.0}}
    outcome = Outcome("m", {name: FigureGroup(name, figures) for name, figures in groups.items()}, quantities=keys)
    assert [([q.key for q in columns], [group.label for group in table]) for columns, table in outcome.tables()] == [
        (["a_s"], ["one"]), (["b_s", "c_s"], ["two", "three"])]

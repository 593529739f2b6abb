"""Faults: each against the plain model told the same in its own words, and properties of all of them together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import ceil, degrees, exp, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NAMES
from emcas_fmu.consistency import LONGEST_COMMAND_DELAY
from emcas_fmu.kernels import program
from emcas_fmu.kernels.compiled import CompiledCore
from emcas_fmu.options.fault_list import FAULTS
from emcas_fmu.options.monitors import MONITORS
from emcas_fmu.options.status import DEGRADED, DISABLED, FAILED, OPERATIONAL
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.variables import OUTPUTS

MODEL = "nonlinear+faults"
BASE = load_parameters(model=MODEL)
PLAIN = load_parameters()
BIT = {fault.name: 2.0**i for i, fault in enumerate(FAULTS)}
TRIPPED = {name: 2**i for i, (name, _) in enumerate(MONITORS)}
SHARED = [v.name for v in OUTPUTS]
ALWAYS = {"begin": 0.0, "end": 1e9}


def wave(t: float) -> float:
    return 0.15 * sin(2.0 * pi * 3.0 * t)


def gust(t: float) -> float:
    return 40.0 * sin(2.0 * pi * 1.7 * t)


def scheduled(model: str, *faults: str, begin: float = 0.0, end: float = 1e9, **more: Any) -> Mapping[str, Any]:
    """A model's values with faults in a window; more values by name, ``__`` for the dot."""
    windows = {f"fault.{name}.{edge}": time for name in faults for edge, time in (("begin", begin), ("end", end))}
    return load_parameters(model=model).replace(
        windows | {name.replace("__", "."): value for name, value in more.items()}).values


def equal(one: Mapping[str, Any], other: Mapping[str, Any], rows: slice = slice(None)) -> bool:
    return all(np.array_equal(one[name][rows], other[name][rows]) for name in SHARED)


# -- nothing wrong ------------------------------------------------------------------


@pytest.mark.parametrize("model", NAMES)
def test_without_a_fault_it_is_the_model(model: str) -> None:
    plain = simulate(load_parameters(model=model).values, 0.4, model=model, fin_command=wave, aero_torque=gust)
    values = load_parameters(model=f"{model}+faults").values
    found = simulate(values, 0.4, model=f"{model}+faults", fin_command=wave, aero_torque=gust)
    assert equal(found, plain)
    assert not found["fault_word"].any()
    assert not found["built_in_test"].any()
    assert (found["status"] == OPERATIONAL).all()


def _swept(t: float) -> float:
    """From 0.1 to 20 Hz in 6 s."""
    return sin(2.0 * pi * (0.1 * t + (20.0 - 0.1) / 12.0 * t * t))


def _triangle(t: float) -> float:
    return 1.0 - abs((t * 3.75) % 4.0 - 2.0)  # 150 deg/s at 20 deg each way


HARD: Mapping[str, Callable[[float], float]] = {
    "step": lambda t: radians(20.0), "step down": lambda t: -radians(20.0),
    **{f"{angle} deg at {rate} Hz": lambda t, a=angle, r=rate: radians(a) * sin(2.0 * pi * r * t)  # type: ignore[misc]
       for angle, rate in ((3.0, 10.0), (5.0, 5.0), (7.0, 5.0), (10.0, 3.0), (20.0, 1.5))},
    "triangle": lambda t: radians(20.0) * _triangle(t), "chirp": lambda t: radians(3.5) * _swept(t),
    "square 4 Hz": lambda t: radians(10.0 if t % 0.25 < 0.125 else -10.0),
    "square 2 Hz": lambda t: radians(20.0 if t % 0.5 < 0.25 else -20.0),
}


@pytest.mark.parametrize("command", HARD)
@pytest.mark.parametrize("load", [-100.0, 0.0, 100.0])
def test_no_false_alarm(command: str, load: float) -> None:
    """Hard use within the rating of Table 2: nothing is wrong, and nothing is told."""
    run = simulate(BASE.values, 6.0, model=MODEL, fin_command=HARD[command], aero_torque=load)
    assert not run["built_in_test"].any()


@pytest.mark.parametrize("model", NAMES)
def test_no_false_alarm_in_any_model(model: str) -> None:
    values = load_parameters(model=f"{model}+faults").values
    for command in HARD.values():
        assert not simulate(values, 3.0, model=f"{model}+faults", fin_command=command)["built_in_test"].any()


# -- when ---------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [f.name for f in FAULTS])
def test_switched_on_or_scheduled(fault: str) -> None:
    on = BASE.replace({f"fault.{fault}.active": True}).values
    one = simulate(on, 0.15, model=MODEL, fin_command=wave, aero_torque=gust)
    other = simulate(scheduled(MODEL, fault), 0.15, model=MODEL, fin_command=wave, aero_torque=gust)
    assert all(np.array_equal(one[name], other[name]) for name in one)
    assert (one["fault_word"][1:] == BIT[fault]).all()


def test_begins_and_ends_with_samples() -> None:
    """From the first sample at or after begin to the last before end; a row shows the samples before it."""
    run = simulate(scheduled(MODEL, "command_freeze", begin=0.0105, end=0.020), 0.03, model=MODEL)
    active = run["fault_word"] == BIT["command_freeze"]
    np.testing.assert_array_equal(np.flatnonzero(active), np.arange(12, 21))  # samples at 11 to 19 ms


def test_on_a_sample_whatever_rounding_says() -> None:
    """3 times 0.1 is not 0.3 in floating point, and neither are sample times that hosts compute."""
    for sample in (3, 7, 29, 113):
        begin = sum(1e-3 for _ in range(sample))
        run = simulate(scheduled(MODEL, "jam", begin=begin), 0.12, model=MODEL)
        assert np.flatnonzero(run["fault_word"])[0] == sample + 1


# -- each against the plain model, told the same in its own words -------------------


def test_derating_is_a_lower_limit() -> None:
    found = simulate(scheduled(MODEL, "current_derating", fault__current_derating__share=0.2), 0.3, model=MODEL,
                     fin_command=radians(15.0))
    lower = PLAIN.replace({"drive.current_limit": 0.2 * PLAIN.values["drive.current_limit"]}).values
    assert equal(found, simulate(lower, 0.3, fin_command=radians(15.0)))


def test_brown_out_is_a_lower_supply() -> None:
    found = simulate(scheduled(MODEL, "brown_out", fault__brown_out__share=0.5), 0.3, model=MODEL,
                     fin_command=radians(15.0))
    assert equal(found, simulate(PLAIN.values, 0.3, fin_command=radians(15.0), supply_voltage=19.5))


def test_friction_rise_is_more_friction() -> None:
    factor = 2.5
    more = {name: factor * value for name, value in PLAIN.values.items()
            if name.startswith(("friction.viscous", "friction.coulomb", "friction.fin"))}
    for name in ("friction.fin_viscous", "friction.fin_coulomb"):
        more[name] = factor * 2.0
    # The controller goes on compensating for what was identified: here nothing.
    both = {"compensation.gain": 0.0}
    fin = {"friction.fin_viscous": 2.0, "friction.fin_coulomb": 2.0}
    window = {"fault.friction_rise.end": 1e9, "fault.friction_rise.factor": factor}
    found = simulate(BASE.replace({**both, **fin, **window}).values, 0.3, model=MODEL, fin_command=wave)
    assert equal(found, simulate(PLAIN.replace({**more, **both}).values, 0.3, fin_command=wave))


def test_backlash_growth_is_a_wider_gap() -> None:
    model = "elastic"
    plain = load_parameters(model=model)
    gap = plain.values["drive_line.backlash"]
    found = simulate(scheduled(f"{model}+faults", "backlash_growth", fault__backlash_growth__gap=0.2e-3), 0.2,
                     model=f"{model}+faults", fin_command=wave)
    wider = plain.replace({"drive_line.backlash": gap + 0.2e-3}).values
    assert equal(found, simulate(wider, 0.2, model=model, fin_command=wave))


def test_a_grown_gap_stays() -> None:
    model = "elastic+faults"
    healed = simulate(scheduled(model, "backlash_growth", begin=0.02, end=0.05), 0.2, model=model, fin_command=wave)
    lasting = simulate(scheduled(model, "backlash_growth", begin=0.02), 0.2, model=model, fin_command=wave)
    assert all(np.array_equal(healed[name], lasting[name]) for name in healed)


def test_loss_of_drive_is_an_open_bridge() -> None:
    """To the plant it is what a disabled drive is; the controller goes on, and does not know."""
    found = simulate(scheduled(MODEL, "drive_loss", begin=0.1), 0.3, model=MODEL, fin_command=wave, aero_torque=gust)
    plain = simulate(PLAIN.values, 0.3, fin_command=wave, aero_torque=gust, enable=lambda t: t < 0.0999)
    for name in ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "supply_power"):
        assert np.array_equal(found[name], plain[name])
    assert not np.array_equal(found["drive_reference"], plain["drive_reference"])


def test_freeze_of_the_command() -> None:
    found = simulate(scheduled(MODEL, "command_freeze", begin=0.1), 0.3, model=MODEL, fin_command=wave)
    plain = simulate(PLAIN.values, 0.3, fin_command=lambda t: wave(min(t, 0.099)))
    assert all(np.array_equal(found[name], plain[name]) for name in SHARED if name != "tracking_error")


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (7.4e-3, 7), (50e-3, LONGEST_COMMAND_DELAY)])
def test_delay_of_the_command(delay: float, samples: int) -> None:
    found = simulate(scheduled(MODEL, "command_delay", fault__command_delay__time=delay), 0.3, model=MODEL,
                     fin_command=wave)
    plain = simulate(PLAIN.values, 0.3, fin_command=lambda t: wave(t - samples * 1e-3) if t > (samples - 0.5) * 1e-3
                     else 0.0)
    for name in ("fin_angle", "motor_current", "drive_reference"):
        # The delayed sine is that of times k T - n T, here of (k - n) T: the last digit of the command differs.
        np.testing.assert_allclose(found[name], plain[name], rtol=0.0, atol=1e-9)


# -- each against what it must do ---------------------------------------------------


def test_jam_holds_and_lets_go() -> None:
    run = simulate(scheduled(MODEL, "jam", begin=0.05, end=0.15), 0.5, model=MODEL, fin_command=radians(15.0),
                   aero_torque=-60.0)
    held = slice(51, 151)
    assert (run["fin_angle"][held] == run["fin_angle"][51]).all()
    assert not run["motor_speed"][held].any()
    assert abs(degrees(run["fin_angle"][-1] - radians(15.0))) < 0.5  # afterwards it goes on as before


def test_stall_current_of_a_jam() -> None:
    """Against a blocked rotor the current is that of the drive's reference; its integral moves it by less than 5 %."""
    run = simulate(scheduled(MODEL, "jam", controller__position__ki=0.0), 0.3, model=MODEL, fin_command=radians(10.0))
    asked = 8.19 * run["drive_reference"][-1] - 0.015
    expected = (5.0 * asked) / (5.0 + 0.25)  # K_p i_ref/(K_p + R), what proportional control leaves
    assert run["motor_current"][-1] == pytest.approx(min(expected, 60.0), rel=0.05)


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "second-order"])
def test_a_broken_fin_falls_by_its_own_inertia(model: str) -> None:
    """From rest under a constant moment: (J_fin + J_shaft) delta = T t^2/2, which the step rule has exactly."""
    torque, inertia = 2.0, 0.05 + 0.004
    values = scheduled(f"{model}+faults", "free_fin", fin__stop_angle="60 deg")
    run = simulate(values, 0.1, model=f"{model}+faults", aero_torque=torque)
    np.testing.assert_allclose(run["fin_angle"], 0.5 * torque / inertia * run["time"] ** 2, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(run["fin_rate"], torque / inertia * run["time"], rtol=1e-9, atol=1e-12)
    assert abs(run["motor_angle"]).max() < 0.5  # the rest stays where its command is


def test_a_broken_fin_with_viscous_friction() -> None:
    """T/b (1 - exp(-b t/J)); the midpoint rule's error with ticks of 0.15 ms is (b h/J)^2/12 of it, 1e-6."""
    torque, inertia, viscous = 2.0, 0.054, 0.8
    run = simulate(scheduled(MODEL, "free_fin", friction__fin_viscous=viscous, fin__stop_angle="79 deg"), 0.2,
                   model=MODEL, aero_torque=torque)
    exact = torque / viscous * (1.0 - exp(-viscous * 0.2 / inertia))
    assert run["fin_rate"][-1] == pytest.approx(exact, rel=2e-6)


def test_a_broken_fin_coasts_to_rest_and_is_held() -> None:
    """Pushed for 50 ms against dry friction, then alone: T_c stops it after v^2 J/(2 T_c), where it stays."""
    inertia, dry, torque = 0.054, 3.0, 8.0
    run = simulate(scheduled(MODEL, "free_fin", friction__fin_coulomb=dry, fin__stop_angle="79 deg"), 0.4, model=MODEL,
                   aero_torque=lambda t: torque if t < 0.0499 else 0.5 * dry)
    speed = (torque - dry) / inertia * 0.05
    expected = 0.5 * (torque - dry) / inertia * 0.05**2 + 0.5 * inertia * speed**2 / (0.5 * dry)
    assert run["fin_angle"][-1] == pytest.approx(expected, rel=1e-9)
    assert run["fin_rate"][-1] == 0.0


def test_a_broken_fin_swings_as_a_pendulum() -> None:
    """Mass and centre of mass of the fin alone: a pendulum of period 2 pi sqrt(J/(m g r)), here with small angles."""
    values = scheduled(MODEL, "free_fin", loads__gravity=True, center_of_mass__fin__x=0.0, center_of_mass__fin__z=0.2,
                       center_of_mass__fork__x=0.3, mass__fork=5.0, mass__fin=3.0, mass__shaft=0.0,
                       fin__start_angle="1 deg")
    run = simulate(values, 2.0, model=MODEL, step=1e-3)
    expected = 2.0 * pi * np.sqrt(0.054 / (3.0 * 9.80665 * 0.2))
    angle = run["fin_angle"]
    crossings = np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))
    share = angle[crossings] / (angle[crossings] - angle[crossings + 1])
    period = np.diff(run["time"][crossings] + 1e-3 * share).mean()
    assert period == pytest.approx(expected, rel=1e-4)  # 1 deg of swing makes it longer by 2e-5


def test_a_broken_fin_meets_the_stop_and_stays() -> None:
    run = simulate(scheduled(MODEL, "free_fin", begin=0.05, end=0.06), 0.3, model=MODEL, aero_torque=30.0)
    assert run["fin_angle"][-1] == radians(25.0)
    assert run["at_stop"][-1]
    assert run["fault_word"][-1] == BIT["free_fin"]  # for good


def test_no_hard_over_of_a_disabled_drive() -> None:
    run = simulate(scheduled(MODEL, "hard_over"), 0.1, model=MODEL, enable=False)
    assert not run["drive_reference"].any()


@pytest.mark.parametrize("share", [1.0, -0.5])
def test_hard_over(share: float) -> None:
    run = simulate(scheduled(MODEL, "hard_over", begin=0.02, fault__hard_over__share=share), 0.5, model=MODEL)
    assert (run["drive_reference"][21:] == share * 10.0).all()
    assert run["fin_angle"][-1] == pytest.approx(np.sign(share) * radians(25.0), rel=1e-12)
    assert run["at_stop"][-1]


def test_bias_of_the_encoder() -> None:
    """The loop brings what it reads to the command: the fin is off by the bias, to a count and what integration is
    left after 3 s (0.03 deg, as without bias)."""
    run = simulate(scheduled(MODEL, "encoder_bias", fault__encoder_bias__angle="1.5 deg"), 3.0, model=MODEL,
                   fin_command=radians(5.0))
    assert degrees(run["fin_angle"][-1]) == pytest.approx(5.0 - 1.5, abs=0.03)
    assert degrees(run["measured_fin_angle"][-1]) == pytest.approx(5.0, abs=0.03)


@pytest.mark.parametrize("on_fin", [False, True])
@pytest.mark.parametrize(("fault", "gain", "missed"), [
    ("encoder_freeze", 0.0, 0.0), ("encoder_reversed", -1.0, 0.0), ("encoder_dropped", 1.0, 0.2)])
def test_counts_of_the_encoder(on_fin: bool, fault: str, gain: float, missed: float) -> None:
    """What is counted is the motion of what the encoder sits on, to a count: of the motor or of the fin 0.044 deg."""
    values = scheduled(MODEL, fault, encoder__on_fin=on_fin, fault__encoder_dropped__share=0.2)
    run = simulate(values, 0.2, model=MODEL, fin_command=lambda t: radians(2.0) * sin(30.0 * t))
    ratio, start = 0.05 / (5e-3 / (2.0 * pi)), radians(5.0)
    seen, turned = run["measured_fin_angle"], run["fin_angle"]
    if not on_fin:
        seen, turned = ratio * (np.tan(seen + start) - np.tan(start)), run["motor_angle"]
    moved = np.diff(turned)
    counted = np.cumsum(gain * (moved - missed * np.maximum(moved, 0.0)))
    # A row shows the angle now and what the last sample, a millisecond before, has measured.
    assert np.abs(seen[2:] - counted[:-1]).max() <= 2.0 * pi / 8192 + 1e-9
    assert np.abs(turned).max() > 0.03


def test_speed_without_an_encoder_is_counted_too() -> None:
    """Reversed, the velocity loop pushes with the motion: u = +K w, with nothing else in the loops."""
    values = scheduled(MODEL, "encoder_reversed", encoder__enabled=False, controller__position__kp=0.0,
                       controller__position__ki=0.0, compensation__gain=0.0)
    run = simulate(values, 0.02, model=MODEL, aero_torque=40.0)
    pushed = values["controller.velocity.kp"] * run["motor_speed"][:-1]
    assert run["drive_reference"][1:] == pytest.approx(np.clip(pushed, -10.0, 10.0), abs=1e-12)
    assert pushed.max() > 0.1


def test_missed_counts_stay_missed_and_add_up() -> None:
    """Of every cycle a share of the motion upwards is lost, and the fin drifts up by it."""
    run = simulate(scheduled(MODEL, "encoder_dropped", fault__encoder_dropped__share=0.02), 3.0, model=MODEL,
                   fin_command=lambda t: radians(5.0) * (1.0 - np.cos(2.0 * pi * t)))
    motor = run["motor_angle"]
    upwards = sum(np.maximum(np.diff(motor[1000:2001]), 0.0))
    # What is measured comes back to where it was, to a count or two and 1e-3 rad of the integral's creep.
    assert motor[2000] - motor[1000] == pytest.approx(0.02 * upwards, abs=3e-3)
    assert motor[2000] - motor[1000] > 0.2
    healed = simulate(scheduled(MODEL, "encoder_dropped", end=0.5, fault__encoder_dropped__share=0.3), 4.0, model=MODEL,
                      fin_command=radians(5.0))
    assert degrees(healed["measured_fin_angle"][-1]) == pytest.approx(5.0, abs=0.03)
    assert degrees(healed["fin_angle"][-1]) > 5.5


def test_a_broken_fin_goes_on_at_its_rate() -> None:
    """No load, no friction at the hinge: what it had when the shaft broke it keeps."""
    run = simulate(scheduled(MODEL, "free_fin", begin=0.05), 0.1, model=MODEL,
                   fin_command=lambda t: radians(20.0) * sin(8.0 * t))
    rate = run["fin_rate"][50]
    assert degrees(rate) > 50.0
    np.testing.assert_allclose(run["fin_rate"][51:], rate, rtol=1e-12)
    coasted = run["fin_angle"][50] + rate * (run["time"][50:] - 0.05)
    np.testing.assert_allclose(run["fin_angle"][50:], coasted, rtol=0.0, atol=1e-12)


def test_the_drive_is_rid_of_a_broken_fin() -> None:
    """It moves as that of an actuator with the fork and a stub only, without load."""
    loads = {"loads.gravity": True, "mass.fin": 8.0, "mass.shaft": 2.0, "center_of_mass.fin.x": 0.3,
             "friction.fin_coulomb": 4.0}
    window = {"fault.free_fin.active": True}
    found = simulate(BASE.replace({**loads, **window}).values, 0.3, model=MODEL, fin_command=wave, aero_torque=gust)
    fork = {"mass.fin": 0.0, "mass.shaft": 0.0, "friction.fin_coulomb": 0.0, "inertia.shaft": 0.0,
            "inertia.fin": 1e-3 * PLAIN.values["inertia.fin"]}
    plain = simulate(PLAIN.replace({**loads, **fork}).values, 0.3, fin_command=wave)
    assert np.array_equal(found["motor_angle"], plain["motor_angle"])
    assert np.array_equal(found["motor_current"], plain["motor_current"])


def test_friction_rises_on_a_broken_fin_too() -> None:
    values = scheduled(MODEL, "free_fin", "friction_rise", friction__fin_coulomb=3.0, fault__friction_rise__factor=3.0)
    run = simulate(values, 0.2, model=MODEL, aero_torque=lambda t: 8.9 if t < 0.1 else 9.1)
    assert not run["fin_angle"][:101].any()
    assert run["fin_angle"][-1] > 0.0


def test_encoder_on_the_fin_sees_the_broken_fin() -> None:
    run = simulate(scheduled(MODEL, "free_fin", encoder__on_fin=True), 0.2, model=MODEL, aero_torque=1.0)
    # A count of the fin is 0.044 deg; the sample is a millisecond old, in which the fin moves less than 0.3 deg.
    assert np.degrees(np.abs(run["measured_fin_angle"][1:] - run["fin_angle"][:-1])).max() < 0.35
    on_motor = simulate(scheduled(MODEL, "free_fin"), 0.2, model=MODEL, aero_torque=1.0)
    assert abs(on_motor["measured_fin_angle"]).max() < radians(0.1)


# -- built-in test ------------------------------------------------------------------


def test_persistence_is_whole_samples() -> None:
    """Undervoltage from 0.1 to 0.3 s: tripped and cleared a persistence later, to the sample."""
    for persistence in (0.0, 0.05, 0.0333):
        values = BASE.replace({"monitor.persistence": persistence}).values
        run = simulate(values, 0.6, model=MODEL, supply_voltage=lambda t: 20.0 if 0.0999 < t < 0.2999 else 39.0)
        tripped = np.flatnonzero(run["built_in_test"] == TRIPPED["supply"])
        samples = max(ceil(persistence / 1e-3 - 1e-6), 1)
        np.testing.assert_array_equal(tripped, np.arange(100 + samples, 300 + samples))
        assert (run["status"][tripped] == DEGRADED).all()


@pytest.mark.parametrize(("fault", "monitor"), [
    ("jam", "tracking"), ("hard_over", "tracking"), ("drive_loss", "drive"), ("encoder_freeze", "tracking"),
    ("encoder_reversed", "stall"), ("current_derating", "drive"), ("brown_out", "supply"),
])
def test_what_is_found(fault: str, monitor: str) -> None:
    """A square wave of 10 deg; a free fin, bias, missed counts and stale commands no sensor here can tell."""
    values = scheduled(MODEL, fault, begin=0.2, fault__current_derating__share=0.05)
    run = simulate(values, 2.0, model=MODEL, fin_command=lambda t: radians(10.0 if t % 1.0 < 0.5 else -10.0))
    assert any(int(word) & TRIPPED[monitor] for word in run["built_in_test"])
    assert not run["built_in_test"][:200].any()


@pytest.mark.parametrize("fault", ["free_fin", "encoder_bias", "encoder_dropped", "command_freeze", "command_delay"])
def test_what_is_not_found(fault: str) -> None:
    run = simulate(scheduled(MODEL, fault, begin=0.2), 2.0, model=MODEL,
                   fin_command=lambda t: radians(10.0 if t % 1.0 < 0.5 else -10.0))
    assert not run["built_in_test"].any()
    assert (run["status"] == OPERATIONAL).all()


def test_status() -> None:
    run = simulate(scheduled(MODEL, "jam", begin=0.1), 1.0, model=MODEL, enable=lambda t: t < 0.7999,
                   fin_command=lambda t: radians(8.0) if t > 0.2 else 0.0)
    assert run["status"][100] == OPERATIONAL
    assert run["status"][799] == FAILED
    assert (run["status"][801:] == DISABLED).all()
    again = simulate(scheduled(MODEL, "jam", begin=0.1, end=0.85), 1.0, model=MODEL,
                     enable=lambda t: t < 0.7999 or t > 0.8999, fin_command=lambda t: radians(8.0) if t > 0.2 else 0.0)
    assert again["status"][799] == FAILED
    assert (again["status"][902:] == OPERATIONAL).all()  # what was told before says nothing after a reset
    beyond = simulate(BASE.values, 0.5, model=MODEL, fin_command=radians(21.0))
    assert beyond["status"][-1] == DEGRADED
    assert beyond["built_in_test"][-1] == TRIPPED["command"]


# -- whatever comes -----------------------------------------------------------------

_windows = st.dictionaries(st.sampled_from([f.name for f in FAULTS]),
                           st.tuples(st.floats(0.0, 0.15), st.floats(0.0, 0.1)), min_size=1, max_size=5)
_sizes = st.fixed_dictionaries({
    "hard_over.share": st.floats(-1.0, 1.0), "current_derating.share": st.floats(0.0, 1.0),
    "brown_out.share": st.floats(0.0, 1.0), "encoder_bias.angle": st.floats(-0.5, 0.5),
    "encoder_dropped.share": st.floats(0.0, 1.0), "command_delay.time": st.floats(0.0, 0.05),
    "friction_rise.factor": st.floats(1.0, 1e4), "backlash_growth.gap": st.floats(0.0, 0.002)})
# Largest acceleration of the fin [rad/s2]. Rigid: 200 A of a shorted motor at 63:1 give 22 N.m on 3e-4 kg.m2, 1200;
# 150 N.m on the broken fin 2800. Elastic: a rotor of 3e-4 kg.m2 at 1300 rad/s has 250 J, with which the line's
# 2e5 N.m/rad throw a fin of 0.06 kg.m2 off its stop by 1e4 N.m, 1.7e5.
RIGID, ELASTIC = 4e3, 2e5


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "second-order", "ristanovic", "ozkan"])
@settings(deadline=None, derandomize=True, max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(windows=_windows, sizes=_sizes, command=st.floats(-0.4, 0.4), load=st.floats(-150.0, 150.0),
       enabled=st.sampled_from([True, True, True, False]))
def test_never_a_jump(model: str, windows: Mapping[str, tuple[float, float]], sizes: Mapping[str, float],
                      command: float, load: float, enabled: bool) -> None:
    """Finite, no jump of the angle, stops, DAC and bus voltage kept, as faults come and go in any combination."""
    changes: dict[str, Any] = {f"fault.{name}": value for name, value in sizes.items()}
    for name, (begin, length) in windows.items():
        changes |= {f"fault.{name}.begin": begin, f"fault.{name}.end": begin + length}
    values = load_parameters(model=f"{model}+faults").replace(changes).values
    step, acceleration = (1e-5, ELASTIC) if model in ("elastic", "ozkan") else (5e-5, RIGID)
    run = simulate(values, 0.25, step, model=f"{model}+faults", fin_command=lambda t: command * sin(40.0 * t),
                   aero_torque=lambda t: load if t < 0.12 else -load, enable=lambda t: enabled or t > 0.1)
    assert all(np.isfinite(column).all() for column in run.values())
    rate, moved = np.abs(run["fin_rate"]), np.abs(np.diff(run["fin_angle"]))
    assert (moved <= step * np.maximum(rate[1:], rate[:-1]) + acceleration * step**2).all()
    assert np.abs(run["fin_angle"]).max() <= values["fin.stop_angle"] * (1.0 + 1e-12)
    if model != "second-order":
        assert np.abs(run["drive_reference"]).max() <= values["drive.reference_limit"]
        driven = run["motor_current"] != 0.0  # an open bridge shows the back-EMF
        if model != "ozkan":  # whose current is ideal
            assert np.abs(run["motor_voltage"][driven]).max(initial=0.0) <= 39.0 * (1.0 + 1e-12)


@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_both_kernels_and_kept_states(model: str) -> None:
    """Every fault in turn: the same bits from both, and from a state kept in the midst of it."""
    changes: dict[str, Any] = {}
    for i, fault in enumerate(FAULTS):
        changes |= {f"fault.{fault.name}.begin": 0.01 + 0.01 * i, f"fault.{fault.name}.end": 0.025 + 0.01 * i}
    name = f"{model}+faults"
    values = load_parameters(model=name).replace(changes).values
    slow, fast = program.core(values, name), CompiledCore(values, name)
    for k in range(1, 161):
        inputs = (wave(k * 1e-3), gust(k * 1e-3), 0.0, 0.0, 39.0, True)
        one, other = slow.run(k * 1e-3 + 3e-4, inputs), fast.run(k * 1e-3 + 3e-4, inputs)
        assert one == other
        if k % 20 == 0:
            again = CompiledCore(values, name)
            again.state = fast.state
            fast = again
            kept = slow.state
            slow = program.core(values, name)
            slow.state = kept


@pytest.mark.parametrize(("name", "value", "said"), [
    ("fault.brown_out.share", 1.5, r"must be within 0 \.\. 1"),
    ("fault.friction_rise.factor", 0.5, r"must be within 1 \.\. 10000"),
    ("fault.hard_over.share", "2", r"must be within -1 \.\. 1"),
    ("fault.command_delay.time", "5 m", "s"),
    ({"fault.command_delay.time": 0.06, "fault.command_delay.active": True}, None, "0.06 s must be at most 50 times"),
    ({"fault.command_delay.time": 0.06, "fault.command_delay.end": 1.0}, None, "controller.sample_time = 0.001 s"),
    ("fault.jam.active", 1.0, "expected true or false"),
    ("monitor.persistence", -1.0, "must be within 0"),
    ("fault.jamm.active", True, "did you mean"),
])
def test_bad_values_are_refused(name: Any, value: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        BASE.replace({name: value} if isinstance(name, str) else name)


def test_faults_are_of_models_with_faults() -> None:
    with pytest.raises(ParameterError, match="the nonlinear model has no such parameter"):
        PLAIN.replace({"fault.jam.active": True})

"""The series clutch actuator: closed forms, what must always hold, what the clutch is for, gains."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NONLINEAR, capabilities, get
from emcas_fmu.actuators.electromechanical import nonlinear, series_clutch
from emcas_fmu.errors import EmcasError
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import clutched_screw
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import shipped_study
from tests.simulation import acting, simulate

from .engaging import assert_locks, ratio

MODEL = "series-clutch"
ACTUATOR = get(MODEL)
LOAD = 100.0  # N.m


@pytest.fixture(scope="module")
def values() -> Mapping[str, Any]:
    """The shipped parameters, without the encoder's chatter."""
    return {**load_parameters(model=MODEL).values, "encoder.enabled": False}


def capacity(values: Mapping[str, Any], run: Mapping[str, Any]) -> Any:
    """The torque at which the clutch would slip, of a flux that has followed the coil current."""
    share = values["clutch.residual"] + (1.0 - values["clutch.residual"]) * (
        run["coil_current"] / values["clutch.rated_current"])
    return values["clutch.share"] * values["clutch.rated_torque"] * share


def slew(load: float = 0.0, at: float = 0.45) -> dict[str, Any]:
    """From -20 to 20 deg, with a load on the way."""
    return {"aero_torque": lambda t: load if t > at else 0.0,
            "fin_command": lambda t: radians(20.0 if t > 0.5 else -20.0)}


def test_a_load_of_a_rounding_error_is_passed(values: Mapping[str, Any]) -> None:
    """Without a load rounding says which way it acts: a step to there must not be too short to change the current."""
    p, u, left = ACTUATOR.namespace({**values, "drive.current_offset": 0.0}), acting(0.2331117138154306), 3.7874607e-8
    speed = 5.291300777307077e-06
    state = Record(**{**ACTUATOR.start(FLOATS, p), "screw_angle": -10.994144213826559, "screw_speed": speed,
                      "motor_speed": speed, "drive_integral": -0.0004683895304379187})

    def felt(current: float) -> float:
        x = state.replace(motor_current=current)
        return float(series_clutch.mode(FLOATS, nonlinear.as_built(FLOATS, p), x, u, left).motion.felt)

    low, high = 0.0, 10.0  # below, the load's inertia drives the screw; above, the screw drives it
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (low, middle) if felt(middle) == felt(10.0) else (middle, high)
    state, calls = state.replace(motor_current=low), 0
    while left > 0.0 and calls < 50:
        moved, used = ACTUATOR.step(FLOATS, p, state, u, left)
        state, left, calls = state.replace(**moved), left - used, calls + 1
    assert calls < 10


# -- closed forms ------------------------------------------------------------------


def _plain(values: Mapping[str, Any], **changes: float) -> dict[str, Any]:
    """No friction, a motor without torque, a lever so long that the ratio stays, heat that stays."""
    still = {name: 0.0 for name in values if name.startswith(("friction.coulomb", "friction.viscous", "friction.fin"))}
    return {**values, **still, "motor.coulomb_friction": 0.0, "motor.viscous_friction": 0.0,
            "motor.torque_constant": 1e-9, "motor.back_emf_constant": 0.0, "kinematics.initial_angle": 0.0,
            "screw.lead": 1e-6, "mass.nut": 0.0, "clutch.residual": 0.0, "clutch.heat_capacity": 1.0,
            "clutch.thermal_resistance": 1e6, **{name.replace("__", "."): value for name, value in changes.items()}}


@pytest.mark.parametrize(("torque", "share", "felt"), [
    (2.0, 0.0, 1.0), (3.0, 0.5, 1.0),
    (4.0, 0.5, 0.8),  # against the load 1/0.8 of it is felt, its inertia and the fin's with it
    (3.0, -1.5, 0.0)])  # and of one that moves the screw nothing
def test_time_and_energy_until_the_clutch_locks(values: Mapping[str, Any], torque: float, share: float,
                                                felt: float) -> None:
    """t = dw/a, E = T_c dw^2/(2 a), a = T_c/J_1 + (T_c - e T_L)/(J_2 + e J_l), with a load T_L of a share of T_c."""
    e = 0.0 if felt == 0.0 else 1.0 / felt
    v = _plain(values, clutch__rated_torque=torque, efficiency__forward=felt or 1.0, efficiency__backward=min(e, 1.0))
    p, begin, current = ACTUATOR.namespace(v), 50.0, v["clutch.rated_current"]
    u = acting(0.0).replace(aero_torque=-share * torque * ratio(v))
    x = Record(**{**ACTUATOR.start(FLOATS, p), "motor_speed": begin})
    assert (x.coil_current, x.flux) == (current, current)
    driving = v["inertia.motor"] + v["clutch.driving_inertia"]
    fin = (v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]) / ratio(v)**2
    driven = v["inertia.screw"] + v["clutch.driven_inertia"] + e * fin
    approach = torque / driving + torque * (1.0 - e * share) / driven
    assert_locks(ACTUATOR, v, x, u, torque, approach)


@pytest.mark.parametrize("load", [3.0 * LOAD, -3.0 * LOAD])
def test_it_holds_any_load_without_power(values: Mapping[str, Any], load: float) -> None:
    run = simulate(values, 0.5, model=MODEL, enable=False, aero_torque=load)
    assert np.all(run["fin_angle"] == 0.0)
    assert np.all(run["supply_power"] == 0.0)


def test_a_load_with_the_motion_is_turned_into_heat(values: Mapping[str, Any]) -> None:
    """At a steady rate the motor gives what it gives without load, and no-back and screw take the load's power."""
    def steady(load: float) -> tuple[float, float, float]:
        run = simulate(values, 0.35, 1e-4, model=MODEL, aero_torque=load,
                       fin_command=lambda t: radians(-18.0 + 100.0 * max(t - 0.05, 0.0)))
        part = (run["time"] > 0.2) & (run["time"] < 0.3)
        drawn = run["supply_power"] - run["braking_power"]
        return (float(drawn[part].mean()), float(run["screw_loss"][part].mean()),
                float((run["fin_rate"] * run["hinge_torque"])[part].mean()))

    loaded, heat, power = steady(LOAD)
    assert heat == pytest.approx(power, rel=0.02)  # and what little the fin's inertia takes
    # What friction and screw lose of the fin's own motion is felt without load alone: 5 % of some N.m.
    assert loaded == pytest.approx(steady(0.0)[0], rel=0.1)


def _as_before(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a nonlinear actuator with a lossy screw that has all of this one's inertia and friction."""
    v = dict(values)
    v["inertia.motor"] += v["clutch.driving_inertia"] + v["clutch.driven_inertia"]
    for way in ("positive", "negative"):
        v[f"friction.coulomb.{way}[0]"] += v["motor.coulomb_friction"]
        v[f"friction.viscous.{way}"] += v["motor.viscous_friction"]
    known = load_parameters(model=f"{NONLINEAR}+efficiency").values
    return {name: v[name] for name in known}


@pytest.mark.parametrize("load", [0.0, LOAD, -LOAD])
def test_a_clutch_that_never_slips_is_the_nonlinear_actuator_with_a_no_back(values: Mapping[str, Any], load: float
                                                                            ) -> None:
    """Fast coil, much capacity, next to no coil power: the same motion, and what came back is braked."""
    v = {**values, "clutch.rated_torque": 1e3, "clutch.rated_current": 1e-4, "coil.kp": 1e4, "clutch.eddy_time": 1e-5,
         "solver.max_tick": 2e-5}
    run = simulate(v, 0.9, model=MODEL, **slew(load))
    before = simulate(_as_before(v), 0.9, model=f"{NONLINEAR}+efficiency", **slew(load))
    assert np.all(run["slip_power"] == 0.0)
    # Two ways of stepping at ticks of 0.02 ms, with errors of some 2e-6 deg each.
    assert np.degrees(np.abs(run["fin_angle"] - before["fin_angle"]).max()) < 2e-5
    assert (run["supply_power"] - run["braking_power"]) == pytest.approx(before["supply_power"], abs=2.0)
    braked = float(np.trapezoid(run["braking_power"], run["time"]))
    returned = -float(np.trapezoid(np.minimum(before["supply_power"], 0.0), before["time"]))
    assert braked == pytest.approx(returned, rel=0.01)
    # No load's: what two slews leave in all that turns, with a speed that the loops overshoot by less than 10 %.
    turning = v["inertia.motor"] + v["clutch.driving_inertia"] + v["clutch.driven_inertia"] + v["inertia.screw"]
    assert 5.0 < braked < turning * (1.1 * v["controller.speed_limit"])**2


def test_energy_of_a_slew(values: Mapping[str, Any]) -> None:
    """Supply and load give what slip, copper, coil, brake, no-back and friction take, and what is stored; a slew into a
    reversal of the load with the drive off and on again."""
    v, step = {**values, "solver.max_tick": 1e-5, "clutch.rated_torque": 7.0}, 5e-6
    run = simulate(v, 0.2, step, model=MODEL, fin_command=0.25, enable=lambda t: not 0.05 < t < 0.065,
                   aero_torque=lambda t: -80.0 if t < 0.08 else 80.0)
    screw, motor, current, coil = (run[name] for name in ("screw_speed", "motor_speed", "motor_current",
                                                          "coil_current"))
    voltage = v["coil.resistance"] * coil + v["coil.inductance"] * np.gradient(coil, step)
    # Tables of friction are 1 at the default temperature, its polynomials constants.
    powers = {"supply": run["supply_power"], "load": run["hinge_torque"] * run["fin_rate"], "slip": run["slip_power"],
              "brake": run["braking_power"], "no-back": run["screw_loss"], "copper": v["motor.resistance"] * current**2,
              "motor": v["motor.coulomb_friction"] * np.abs(motor) + v["motor.viscous_friction"] * motor**2,
              "screw": v["friction.coulomb.positive[0]"] * np.abs(screw) + v["friction.viscous.positive"] * screw**2,
              "coil": v["coil.resistance"] * coil**2, "suppressor": np.maximum(-voltage, 0.0) * coil}
    for name in powers.keys() - {"load"}:
        # Of what starts or stops rounding's sign is left; the gradient sees a jump of voltage on both sides of it.
        assert powers[name].min() >= -1e-6, name
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}

    def stored(k: int) -> float:
        turning = v["inertia.screw"] + v["clutch.driven_inertia"] + v["mass.nut"] * v["screw.lead"]**2
        fin = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
        rotor = v["inertia.motor"] + v["clutch.driving_inertia"]
        return float(0.5 * (turning * screw[k]**2 + fin * run["fin_rate"][k]**2 + rotor * motor[k]**2
                            + v["motor.inductance"] * current[k]**2 + v["coil.inductance"] * coil[k]**2))

    given, taken = work["supply"] + work["load"], sum(work.values()) - work["supply"] - work["load"]
    # The bridge that opens takes what the winding stores, with which no output shows.
    opened = int(np.argmax(run["time"] > 0.05))
    lost = 0.5 * v["motor.inductance"] * float(current[opened - 1]**2)
    # Sums over jumps of power are off by half a step of them: 2 kW times 5e-6 s, some hundred times.
    assert given == pytest.approx(taken + lost + stored(-1) - stored(0), abs=0.2)
    assert min(work["slip"], work["brake"], work["no-back"]) > 1.0


# -- what sticks and what slides ---------------------------------------------------

_torque = st.floats(-10.0, 10.0)
_limit = st.sampled_from([0.0, 0.1, 1.0]) | st.floats(0.0, 5.0)
_speed = st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-10.0, 10.0)
_inertia = st.floats(1e-5, 1e-2)


@settings(derandomize=True, max_examples=150)
@given(inertias=st.tuples(_inertia, _inertia, _inertia), torques=st.tuples(_torque, _torque, _torque),
       limits=st.tuples(_limit, _limit, _limit, _limit, _limit), forward=st.floats(1.0, 3.0),
       backward=st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0), screw=_speed, rotor=_speed | st.none())
def test_motion_is_the_one_that_holds(inertias: Any, torques: Any, limits: Any, forward: float, backward: float,
                                      screw: float, rotor: float | None) -> None:
    """Sliding follows the acceleration, what sticks is within its limit, and e goes by the load there is."""
    rotor = screw if rotor is None else rotor
    (rotor_torque, screw_torque, behind), (dry, capacity, up, down, hinge) = torques, limits
    load = hinge - behind, -hinge - behind

    def hold(way: float, transmitted: float) -> float:
        return ((forward if transmitted * way > 0.0 else backward) - 1.0) * transmitted

    t = clutched_screw.Train(
        inertias[0], inertias[1], inertias[2], rotor_torque, screw_torque, dry, capacity, (up, down), load, behind,
        up + hinge + hold(1.0, load[0]), -(down + hinge) + hold(-1.0, load[1]), forward, backward)
    m = clutched_screw.motion(FLOATS, t, screw, rotor)
    rates = clutched_screw.accelerations(FLOATS, t, m)
    sliding = {"screw": (screw, m.screw, rates[0]), "rotor": (rotor, m.rotor, rates[1]),
               "clutch": (rotor - screw, m.clutch, rates[1] - rates[0])}
    # Overcome within 1e-9 of a limit it may stand still by rounding.
    slack = 1e-8 * (max(limits) + 30.0) / min(inertias)
    for name, (speed, way, rate) in sliding.items():
        assert way == np.sign(speed) if speed else way * rate >= -slack, name
        if way == 0.0:
            assert rate == 0.0 or (name != "clutch" and m.clutch == 0.0), name
    slack = 1e-8 * 30.0
    force = clutched_screw.torque(FLOATS, t, m)
    assert abs(clutched_screw.held(FLOATS, t, m)) <= capacity + slack or m.clutch
    if m.rotor == 0.0:
        assert abs(rotor_torque - force) <= dry + slack
    if m.screw == 0.0:
        assert t.low - slack <= screw_torque + behind + force <= t.high + slack
    else:
        transmitted = clutched_screw.transmitted(FLOATS, t, m) * m.screw
        assert m.felt == (forward if transmitted > 0.0 else backward) or abs(transmitted) < slack


# -- what the clutch is for --------------------------------------------------------


def test_an_enabled_unit_locks_to_the_bit_and_slips_while_it_engages(values: Mapping[str, Any]) -> None:
    """Switched off in a slew the rotor coasts, and the no-back holds the fin against its load; switched on the clutch
    brings both together."""
    run = simulate(values, 0.5, model=MODEL, fin_command=radians(20.0), enable=lambda t: not 0.04 < t < 0.065,
                   aero_torque=-LOAD)
    slipping = run["slip_power"] > 0.0
    time = run["time"]
    assert not slipping[time < 0.046].any()  # while the coil's flux decays
    assert slipping[(time > 0.048) & (time < 0.07)].all()
    assert not slipping[time > 0.072].any()
    assert np.all((run["motor_speed"] == run["screw_speed"]) == ~slipping)
    off = (time > 0.055) & (time < 0.065)
    assert not run["screw_speed"][off].any()
    assert run["motor_speed"][off].min() > 150.0
    assert run["fin_angle"][-1] == pytest.approx(radians(20.0), abs=radians(0.2))


def test_the_clutch_protects_the_motor_from_a_stop(values: Mapping[str, Any]) -> None:
    """Beyond a stop of 10 deg: what the rotor has in motion, and what the motor adds, becomes heat of slip."""
    v = {**values, "fin.stop_angle": radians(10.0), "command.limit": radians(10.0), "controller.position.kp": 400.0}
    run = simulate(v, 0.2, 1e-4, model=MODEL, fin_command=radians(10.0), aero_torque=20.0)
    struck = int(np.argmax(run["at_stop"] > 0.5))
    assert run["screw_speed"][struck - 1] > 100.0
    assert not run["screw_speed"][struck]
    assert run["motor_speed"][struck] > 100.0
    assert np.all(np.abs(run["clutch_torque"]) <= capacity(v, run) * (1.0 + 1e-9))
    after = slice(struck, int(np.argmax((run["slip_power"] == 0.0) & (run["time"] > run["time"][struck]))))
    speed, torque = run["motor_speed"][after], run["motor_torque"][after]
    rotor = 0.5 * (v["inertia.motor"] + v["clutch.driving_inertia"]) * (speed[0]**2 - speed[-1]**2)
    rubbed = (v["motor.coulomb_friction"] + v["motor.viscous_friction"] * speed) * speed
    heat, given = (float(np.trapezoid(power, dx=1e-4)) for power in (run["slip_power"][after], torque * speed - rubbed))
    assert heat == pytest.approx(rotor + given, rel=0.01)  # trapezia of 0.1 ms
    assert rotor > 1.0


# -- what must always hold ---------------------------------------------------------

_profile = st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-350.0, 350.0), st.booleans(), st.floats(0.0, 60.0)),
                    min_size=1, max_size=6)
_clutches = st.fixed_dictionaries({}, optional={
    "clutch.rated_torque": st.floats(0.5, 20.0), "clutch.residual": st.sampled_from([0.0, 0.2]),
    "efficiency.backward": st.floats(-0.5, 1.0), "friction.fin_coulomb": st.sampled_from([0.0, 5.0, 1e4]),
    "motor.coulomb_friction": st.sampled_from([0.0, 1.0]), "coil.connected": st.sampled_from([0.0, 0.5]),
    "clutch.temperature_coefficient": st.floats(-0.1, 0.0), "clutch.heat_capacity": st.sampled_from([1.0, 50.0]),
    "fin.stop_angle": st.floats(0.35, 0.4)})
COMMON = settings(derandomize=True, max_examples=20,
                  suppress_health_check=[HealthCheck.function_scoped_fixture])


def _run(values: Mapping[str, Any], profile: list[Any], flip: float = 1.0, stop: float = 0.3) -> dict[str, Any]:
    at = np.minimum((np.arange(round(stop * 1e3) + 1) * len(profile)) // round(stop * 1e3 + 1), len(profile) - 1)
    command, load, enable, supply = (np.array(column, float)[at] for column in zip(*profile, strict=True))
    return simulate(values, stop, model=MODEL, fin_command=flip * command, aero_torque=flip * load, enable=enable,
                    supply_voltage=supply)


@COMMON
@given(profile=_profile, changes=_clutches)
def test_it_returns_no_power_and_heats_only(values: Mapping[str, Any], profile: list[Any], changes: dict[str, float]
                                            ) -> None:
    """Whatever the clutch and its faults; a run that events do not let go on would stop with an error."""
    run = _run({**values, **changes}, profile)
    assert all(np.isfinite(column).all() for column in run.values())
    assert run["supply_power"].min() >= 0.0
    assert run["braking_power"].min() >= 0.0
    assert not (run["supply_power"] * run["braking_power"]).any()
    # A locked clutch has none to the bit; one that just starts has rounding's sign.
    assert run["slip_power"].min() >= 0.0
    assert run["screw_loss"].min() >= -1e-9
    assert run["coil_current"].min() >= -1e-12


@COMMON
@given(profile=_profile)
def test_a_symmetric_one_is_odd(values: Mapping[str, Any], profile: list[Any]) -> None:
    v = {**values, "kinematics.initial_angle": 0.0, "drive.current_offset": 0.0, "clutch.rated_torque": 4.0}
    one, other = _run(v, profile), _run(v, profile, -1.0)
    # Difference quotients of ROS2 step the same way in both: some 1e-9 of it is left.
    assert other["fin_angle"] == pytest.approx(-one["fin_angle"], abs=1e-6)
    assert other["motor_speed"] == pytest.approx(-one["motor_speed"], abs=1e-3)


def test_it_has_its_losses_and_its_brake_itself() -> None:
    assert not {capabilities.SCREW_LOAD, capabilities.RETURNS_POWER} & ACTUATOR.provides
    with pytest.raises(EmcasError, match="efficiency needs a screw without losses"):
        get(f"{MODEL}+efficiency")
    with pytest.raises(EmcasError, match="supply needs a motor that returns power to its supply"):
        get(f"{MODEL}+supply")


# -- gains -------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1.0, 5.0, 10.0, 20.0])
def test_steps_overshoot_by_less_than_5_percent(size: float) -> None:
    run = simulate(load_parameters(model=MODEL).values, 0.6, model=MODEL, fin_command=radians(size))
    assert 0.98 * radians(size) < run["fin_angle"].max() < 1.05 * radians(size)


@pytest.mark.slow
def test_the_shipped_gains_meet_every_requirement() -> None:
    study = shipped_study(load_parameters(model=MODEL))
    assert "worn_clutch" in {case.name for case in study.cases}  # its own
    (found,) = evaluate(study, [{t.name: study.base.values[t.name] for t in study.tunables}])
    assert {j.requirement: j.measured for j in found.judgements if not j.share <= 1.0} == {}

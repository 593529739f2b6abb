"""Homing on the hard stops: from anywhere, past obstacles, when disabled, in both back ends, as FMUs."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from math import cos, pi, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.kernels import program
from emcas_fmu.options import homing_run
from emcas_fmu.options.status import DISABLED, FAILED, HOMING, OPERATIONAL, UNREFERENCED
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.variables import OUTPUTS

from ..fmu.host import OK, Fmu, Instance

MODEL = "nonlinear+homing"
BASE = load_parameters(model=MODEL)
STOP = BASE.values["fin.stop_angle"]
SPEED = BASE.values["homing.speed"]
COUNT = 2.0 * pi / 8192  # rad at the motor
RATIO = BASE.values["kinematics.moment_arm"] / BASE.values["screw.lead"]
INITIAL = BASE.values["kinematics.initial_angle"]
NAMES = [v.name for v in get(MODEL).outputs]


def _motor(fin: Any) -> Any:
    """(2.5), written out."""
    return RATIO * (np.tan(fin + INITIAL) - tan(INITIAL))


def _run(overrides: Mapping[str, Any], stop: float, model: str = MODEL, **inputs: Any) -> dict[str, Any]:
    return simulate(load_parameters(model=model).replace(overrides).values, stop, model=model, **inputs)


def _phases(run: Mapping[str, Any]) -> list[float]:
    """The statuses in their order, each once."""
    status = run["status"]
    return [status[0], *status[1:][np.diff(status) != 0.0]]


def _since(run: Mapping[str, Any], status: float) -> float:
    """When a status is shown for the first time [s]."""
    return float(run["time"][np.argmax(run["status"] == status)])


# -- a run ------------------------------------------------------------------------


@settings(deadline=None, derandomize=True, max_examples=40)
@given(start=st.floats(-STOP, STOP), positive=st.booleans(), encoder=st.booleans(), command=st.floats(-0.35, 0.35))
def test_homes_from_anywhere(start: float, positive: bool, encoder: bool, command: float) -> None:
    run = _run({"fin.start_angle": start, "homing.positive_first": positive, "encoder.enabled": encoder}, 8.0,
               home=lambda t: t > 0.0995, fin_command=command)
    assert _phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
    # Nobody knew where it was; then the reading is floored to a count, and the zero exact: rigid stops are met to
    # rounding, both alike. What is shown at a sample is of the step that begins there.
    assert run["measured_fin_angle"][0] == pytest.approx(0.0, abs=1e-15)
    known = np.flatnonzero(run["homed"])[1:]
    error = run["fin_angle"][known - 1] - run["measured_fin_angle"][known]
    assert np.all(error > -1e-9)
    assert np.all(error < (COUNT / RATIO if encoder else 0.0) + 1e-9)
    assert run["fin_angle"][-1] == pytest.approx(np.clip(command, -radians(20), radians(20)), abs=radians(0.05))
    # Both ways at the mean rate in motor angle, two stalls and the time at zero. Besides, each stall waits for the
    # push to reach its limit, and the target for the motor to catch up: within 0.03 s each, five times.
    first = STOP if positive else -STOP
    span = _motor(STOP) - _motor(-STOP)
    travel = abs(_motor(first) - _motor(start)) + span + abs(_motor(first) - span * (1 if positive else -1))
    least = travel / span * 2.0 * STOP / SPEED + 3.0 * 0.1
    took = _since(run, OPERATIONAL) - 0.1
    assert least - 0.02 <= took <= least + 0.15
    _assert_sound(run)


def _assert_sound(run: Mapping[str, Any]) -> None:
    """No stop is passed, no current beyond what the push allows while homing, no jump."""
    assert np.abs(run["fin_angle"]).max() <= STOP * (1.0 + 1e-12)
    # Beyond the reference by no more than what the back-EMF drives against the current loop's gain.
    homing = run["status"] == HOMING
    driven = BASE.values["motor.back_emf_constant"] * np.abs(run["motor_speed"][homing]) / BASE.values["drive.kp"]
    assert np.abs(run["motor_current"][homing]).max() <= 8.19 * 1.0 + 0.015 + driven.max()
    # In 1 ms no more than the rate at its two ends allows.
    rate = np.abs(run["fin_rate"])
    assert np.all(np.abs(np.diff(run["fin_angle"])) <= np.maximum(rate[1:], rate[:-1]) * 1e-3 * 1.5 + radians(0.02))


def test_the_stops_stop_it_and_hold_the_push() -> None:
    run = _run({"fin.start_angle": 0.1}, 7.0, home=True)
    stalled = (run["at_stop"] > 0.0) & (run["status"] == HOMING)
    angles = run["fin_angle"][stalled]
    assert {round(float(a), 9) for a in angles} == {round(STOP, 9), round(-STOP, 9)}
    # As long as the stall, what comes before its limit, and the drive's delay of the way back (3.7 ms).
    assert stalled.sum() * 1e-3 == pytest.approx(2 * 0.1, abs=2 * 0.05)
    assert np.abs(run["drive_reference"][run["status"] == HOMING]).max() == 1.0
    # Where the belief jumps, at the second stop, the speed measured does not: pushed away from it at once.
    (jump,) = np.flatnonzero(np.abs(np.diff(run["measured_fin_angle"])) > 0.05) + 1
    assert run["drive_reference"][jump - 1] == -1.0
    assert run["drive_reference"][jump] > 0.0
    # Slow on the way: within a tenth of the speed beyond start and turns, where the lever makes it vary with 1/R.
    underway = (run["status"] == HOMING) & (np.abs(run["fin_rate"]) > 0.5 * SPEED)
    mean = (_motor(STOP) - _motor(-STOP)) / (2.0 * STOP)
    expected = SPEED * mean / (RATIO / np.cos(run["fin_angle"] + INITIAL)**2)
    assert np.median(np.abs(run["fin_rate"][underway]) / expected[underway]) == pytest.approx(1.0, abs=0.02)


def test_one_stop_only_and_either_encoder() -> None:
    quick = _run({"homing.verify": False}, 4.0, home=True)
    assert _phases(quick) == [UNREFERENCED, HOMING, OPERATIONAL]
    assert quick["fin_angle"].min() > -radians(0.5)  # zero is passed by the loop's overshoot, 0.17 deg at this speed
    assert abs(quick["fin_angle"][-1] - quick["measured_fin_angle"][-1]) < COUNT / RATIO
    # On the fin a count is 0.044 deg, and the speed measured a comb of 44 deg/s: it shakes, and knows a count's worth.
    on_fin = _run({"encoder.on_fin": True, "fin.start_angle": -0.3}, 8.0, home=True, fin_command=0.1)
    assert _phases(on_fin) == [UNREFERENCED, HOMING, OPERATIONAL]
    known = np.flatnonzero(on_fin["homed"])[1:]
    error = on_fin["fin_angle"][known - 1] - on_fin["measured_fin_angle"][known]
    assert np.all((error > -1e-9) & (error < COUNT + 1e-9))


@pytest.mark.parametrize("model", ["elastic", "habibi", "ozkan", "ristanovic"])
def test_every_model_with_a_motor(model: str) -> None:
    run = _run({"fin.start_angle": -0.2}, 9.0, f"{model}+homing", home=True, fin_command=0.1)
    assert _phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.1))


def test_gap_and_give_cancel_out_of_the_zero() -> None:
    """Both stops are met with the same error; one alone leaves half the gap and the give of the push."""
    def error(verify: bool) -> float:
        run = _run({"fin.start_angle": 0.1, "homing.verify": verify}, 7.0, "elastic+homing", home=True)
        assert run["status"][-1] == OPERATIONAL
        return float(_motor(run["measured_fin_angle"][-1]) - run["motor_angle"][-1])

    values = load_parameters(model="elastic").values
    lead = values["screw.lead"]
    half_gap = 0.5 * values["drive_line.backlash"] / lead
    compliance = values["drive_line.torsional_compliance"] + (
        values["drive_line.axial_compliance"] + 1.0 / values["drive_line.contact_stiffness"]) / lead**2
    # Wound up by the push and the impact, the motor's friction (0.3 N.m at a stop) holds it anywhere between these.
    push, friction = 8.19 * values["motor.torque_constant"], 0.3
    alone = -error(False) - half_gap
    assert (push - friction) * compliance < alone < (push + friction) * compliance + COUNT
    # Of both stops: what the friction of both directions differs by, 0.06 N.m, and the rounding to counts.
    assert abs(error(True)) < 0.06 * compliance + 1.5 * COUNT


def test_cold_and_loaded() -> None:
    for load in (-25.0, 25.0):
        run = _run({"friction.temperature": -6.0}, 8.0, home=True, aero_torque=load)
        assert _phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
        _assert_sound(run)


# -- commands ---------------------------------------------------------------------


def test_not_asked_it_stays_unreferenced_and_still() -> None:
    run = _run({"fin.start_angle": 0.2}, 1.0, fin_command=-0.3, aero_torque=5.0)
    assert np.all(run["status"] == UNREFERENCED)
    assert np.all(run["fin_angle"] == run["fin_angle"][0])
    assert not np.any(run["motor_current"])
    assert np.all(run["tracking_error"] == -0.3 - run["fin_angle"])
    # The bridge is open: a load beyond friction moves the fin.
    assert _run({}, 1.0, fin_command=-0.3, aero_torque=40.0)["fin_angle"][-1] == pytest.approx(STOP, rel=1e-9)


@pytest.mark.parametrize("more", [{}, {"encoder.enabled": False}, {"encoder.on_fin": True}])
@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_without_need_it_is_the_plain_model(model: str, more: Mapping[str, Any]) -> None:
    values = load_parameters(model=model).replace({"fin.start_angle": 0.1, **more}).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.3 if t < 0.2 else -0.5, "aero_torque": -50.0,
                              "enable": lambda t: not 0.3 < t < 0.32}
    plain = simulate(values, 0.5, model=model, **inputs)
    run = _run({"fin.start_angle": 0.1, "homing.required": False, **more}, 0.5, f"{model}+homing", **inputs)
    for v in OUTPUTS:
        assert np.array_equal(plain[v.name], run[v.name]), v.name
    assert _phases(run) == [OPERATIONAL, DISABLED, OPERATIONAL]


def test_homing_again_and_edges() -> None:
    """A level is no edge; an edge during a run or while disabled is none either."""
    run = _run({}, 16.0, home=lambda t: 0.1 < t < 0.3 or 1.0 < t < 7.0 or t > 8.0, fin_command=0.1)
    assert _phases(run) == [UNREFERENCED, HOMING, OPERATIONAL, HOMING, OPERATIONAL]
    assert np.flatnonzero(np.diff(run["homed"]) < 0.0)[0] * 1e-3 == pytest.approx(8.0, abs=2e-3)
    settled = np.abs(run["time"] - 7.9) < 0.05
    assert run["fin_angle"][settled] == pytest.approx(0.1, abs=radians(0.05))
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.05))
    _assert_sound(run)
    late = _run({}, 0.5, home=lambda t: t > 0.1, enable=lambda t: t > 0.2)
    assert _phases(late) == [DISABLED, UNREFERENCED]


def test_disabled_in_a_run_it_knows_nothing() -> None:
    run = _run({}, 9.0, home=lambda t: t < 0.5 or t > 2.0, enable=lambda t: not 1.0 <= t + 1e-9 < 1.2,
               fin_command=0.3)
    assert _phases(run) == [UNREFERENCED, HOMING, DISABLED, UNREFERENCED, HOMING, OPERATIONAL]
    between = (run["time"] > 1.2) & (run["time"] < 2.0)
    assert np.ptp(run["fin_angle"][between]) == 0.0
    assert not np.any(run["motor_current"][between])


# -- obstacles --------------------------------------------------------------------


def _blocked(torque: Callable[[float, float], float], stop: float, home: Callable[[float], bool],
             overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A run under a torque [N.m] of time [s] and fin angle [rad], at steps of 1 ms."""
    core = program.core(BASE.replace(overrides or {}).values, MODEL)
    rows = []
    angle = 0.0
    for k in range(round(stop / 1e-3)):
        inputs = (0.2, torque(k * 1e-3, angle), 0.0, 0.0, 39.0, True, home(k * 1e-3))
        rows.append(core.run((k + 1) * 1e-3, inputs))
        angle = rows[-1][0]
    return {"time": np.arange(1, len(rows) + 1) * 1e-3, **dict(zip(NAMES, np.array(rows, dtype=float).T, strict=True))}


def _wedge(at: float) -> Callable[[float], float]:
    """A stiff thing in the way from `at` [rad] on, on either side."""
    return lambda angle: -3e3 * max(angle - at, 0.0) if at > 0.0 else -3e3 * min(angle - at, 0.0)


@pytest.mark.parametrize("at", [12.0, -12.0])
def test_an_obstacle_fails_safe_and_a_retry_works(at: float) -> None:
    wedge = _wedge(radians(at))
    run = _blocked(lambda t, angle: wedge(angle) if t < 5.0 else 0.0, 14.0, lambda t: t < 0.1 or t > 6.0)
    assert _phases(run) == [HOMING, FAILED, HOMING, OPERATIONAL]
    failed = (run["status"] == FAILED) & (run["time"] > _since(run, FAILED) + 2e-3)
    assert not np.any(run["motor_current"][failed])
    assert not np.any(run["drive_reference"][failed])
    assert not np.any(run["homed"][failed])
    # Pushed back by the wedge where it failed on it, or held by friction on the stop; the command is 0.2.
    assert np.ptp(run["fin_angle"][failed & (run["time"] > 5.5)]) == 0.0
    _assert_sound(run)
    assert run["fin_angle"][-1] == pytest.approx(0.2, abs=radians(0.1))


@settings(deadline=None, derandomize=True, max_examples=12)
@given(angle=st.floats(-STOP, STOP).filter(lambda a: abs(a) > 0.02), begin=st.floats(0.0, 6.0),
       length=st.floats(0.1, 8.0), positive=st.booleans())
def test_never_operational_at_a_wrong_zero(angle: float, begin: float, length: float, positive: bool) -> None:
    """Whatever is in the way and when. The middle is off by half of what the way may be short of, 1 deg times the
    mean of the ratio over that at zero, 1.1; and by the reading's age and count, 0.02 deg."""
    wedge = _wedge(angle)
    run = _blocked(lambda t, fin: wedge(fin) if begin < t < begin + length else 0.0, 7.5, lambda _: True,
                   {"homing.positive_first": positive})
    assert _phases(run)[-1] in (HOMING, OPERATIONAL, FAILED)
    known = np.flatnonzero(run["homed"])[1:]
    error = run["fin_angle"][known - 1] - run["measured_fin_angle"][known]
    assert np.all(np.abs(error) < radians(0.5 * 1.1 + 0.02))
    assert np.abs(run["fin_angle"]).max() <= STOP * (1.0 + 1e-12)


def test_an_obstacle_passes_for_a_stop_without_verification() -> None:
    wedge = _wedge(radians(12.0))
    run = _blocked(lambda _, angle: wedge(angle), 4.0, lambda _: True, {"homing.verify": False})
    assert run["status"][-1] == OPERATIONAL
    assert run["measured_fin_angle"][-1] - run["fin_angle"][-1] > radians(10.0)


def test_the_way_back_may_be_blocked_too() -> None:
    run = _blocked(lambda t, angle: _wedge(radians(-10.0))(angle) if t > 4.5 else 0.0, 8.0, lambda _: True,
                   {"homing.positive_first": False})
    assert _phases(run) == [HOMING, OPERATIONAL]  # in the way of nothing
    # Beyond the push from either side: on the way back from the negative stop.
    run = _blocked(lambda t, angle: -3e3 * max(angle + radians(15.0), 0.0) if t > 4.3 else 0.0, 8.0, lambda _: True)
    assert _phases(run) == [HOMING, FAILED]


def test_held_up_it_does_not_lunge() -> None:
    """Let go just before it would be a stall. The target waits from a quarter of that time on, 25 ms ahead and the
    20 ms at most until the reference is at its limit: with kp = 60/s, 1 + 60 0.045 = 3.7 times the speed. Else 4.3."""
    wedge = _wedge(radians(10.0))
    run = _blocked(lambda t, angle: wedge(angle) if t < 0.635 else 0.0, 1.0, lambda _: True)
    assert not np.any(run["fin_rate"][(run["time"] > 0.57) & (run["time"] < 0.63)])
    assert np.all(run["status"] == HOMING)
    assert 1.5 * SPEED < np.abs(run["fin_rate"]).max() < 3.7 * SPEED
    assert run["fin_angle"][-1] > radians(15.0)  # and on it goes


def test_no_motion_at_all_fails() -> None:
    """Without supply, or with a push that friction holds, both stops seem to be where the fin is."""
    for more, supply in (({}, 0.0), ({"homing.reference_limit": 0.1}, 39.0)):
        run = _run(more, 2.0, home=True, supply_voltage=supply)
        assert _phases(run) == [UNREFERENCED, HOMING, FAILED]
        assert np.ptp(run["fin_angle"]) == 0.0


def test_too_late_fails() -> None:
    """At 1.5 V the back-EMF keeps the motor to half the speed asked for: always at the limit, never at rest."""
    run = _run({"homing.timeout": 7.0}, 8.0, home=True, supply_voltage=1.5)
    assert _phases(run) == [UNREFERENCED, HOMING, FAILED]
    assert _since(run, FAILED) == pytest.approx(7.0, abs=3e-3)


def test_travel_beyond_the_stops_fails() -> None:
    """No fin of the model's passes its stops, so the samples are shown one that does: a broken lever."""
    actuator = get(MODEL)
    _, _, _, sample, *_ = program.make(model=MODEL)(BASE.values)
    initial = program.make(model=MODEL)(BASE.values)[2]()
    plant, kept = list(initial[:4]), list(initial[4:4 + len(actuator.kept)])
    phase, angle, least = initial[-1], 0.0, (2.0 * STOP + radians(1.0))
    while phase in (homing_run.UNKNOWN, homing_run.SEEKING):
        _, *found = sample(angle, plant[1], plant[2], plant[3], *kept, phase, 0.0, 39.0, True, True)
        kept, phase = found[:len(kept)], found[-1]
        angle += 0.02
    assert phase == homing_run.FAILED
    assert angle == pytest.approx(least * (_motor(STOP) - _motor(-STOP)) / (2.0 * STOP), abs=0.05)


@pytest.mark.parametrize("fault", ["jam", "drive_loss", "encoder_freeze", "encoder_reversed"])
def test_faults_in_a_run_fail_it(fault: str) -> None:
    """Of the option `faults`, from amid the second way on: the way between the stops is not what it should be."""
    run = _run({"fin.start_angle": 0.2, f"fault.{fault}.begin": 1.0, f"fault.{fault}.end": 99.0}, 4.0,
               f"{MODEL}+faults", home=True)
    assert run["status"][990] == HOMING
    assert run["status"][-1] == FAILED
    assert not np.any(run["homed"])
    assert not np.any(run["motor_current"][-100:])


def test_monitors_rest_until_it_is_homed() -> None:
    """A command far from where the run takes the fin trips nothing; afterwards it is followed within persistence."""
    run = _run({"fin.start_angle": -0.3}, 7.0, f"{MODEL}+faults", home=True, fin_command=radians(-19.0))
    assert run["status"][-1] == OPERATIONAL
    assert not run["built_in_test"].any()


# -- refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(("overrides", "said"), [
    ({"homing.reference_limit": 12.0}, ["homing.reference_limit = 12 V", "drive.reference_limit = 10 V"]),
    ({"homing.timeout": 6.0}, ["homing.timeout = 6 s", "homing.stall_time = 6.55 s"]),
    ({"homing.speed": 0.0}, ["homing.speed", "must be within"]),
    ({"homing.stall_time": -1.0}, ["homing.stall_time", "must be within"]),
])
def test_bad_values_are_refused(overrides: Mapping[str, Any], said: list[str]) -> None:
    with pytest.raises(ParameterError) as refused:
        BASE.replace(overrides)
    assert all(word in str(refused.value) for word in said), refused.value


def test_models_it_is_not_for() -> None:
    with pytest.raises(EmcasError, match="homing needs a motor"):
        get("second-order+homing")
    with pytest.raises(EmcasError, match="homing needs a limit of the reference"):
        get("linear+homing")
    with pytest.raises(ParameterError, match="no such parameter"):
        load_parameters(model=NONLINEAR).replace({"homing.speed": 0.1})


# -- back ends --------------------------------------------------------------------


@pytest.mark.parametrize("model", ["nonlinear+homing", "elastic+homing"])
def test_kernels_are_one(model: str) -> None:
    python, compiled = (_run({"fin.start_angle": 0.4}, 5.5, model, kernel=kernel, home=lambda t: t > 0.1,
                             fin_command=0.1, aero_torque=lambda t: 20.0 * cos(3.0 * t))
                        for kernel in ("python", "compiled"))
    assert _phases(python) == [UNREFERENCED, HOMING, OPERATIONAL]
    for name, values in python.items():
        assert np.array_equal(values, compiled[name]), name


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    folder = tmp_path_factory.mktemp("homing")
    return {"python": build(BASE, folder / "python.fmu").path,
            "native": build(BASE, folder / "native.fmu", "native", cc="gcc").path}


@pytest.mark.fmu
def test_fmus_home_by_their_input(built: Mapping[str, Path], tmp_path: Path) -> None:
    """Under fmpy in a fresh process, `home` as a signal; and a state kept amid the run continues bit for bit."""
    (tmp_path / "host.py").write_text(_HOST)
    found = {}
    for backend, unit in built.items():
        assert validate_fmu(str(unit)) == []
        done = subprocess.run([sys.executable, "host.py", unit], cwd=tmp_path, capture_output=True, text=True,
                              timeout=120)
        assert done.returncode == 0, done.stderr
        found[backend] = json.loads(done.stdout.splitlines()[-1])
    assert found["python"] == found["native"]
    same = simulate(BASE.values, 7.0, 0.01, model=MODEL, home=lambda t: t > 0.2 - 1e-9)
    for name in ("fin_angle", "measured_fin_angle", "status", "homed"):
        assert found["native"]["signal"][name] == same[name].tolist(), name
    assert found["native"]["continued"] == found["native"]["restored"]
    assert found["native"]["continued"][-1][2] == OPERATIONAL


_HOST = """
import json, sys
import numpy as np
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
assert "emcas_fmu" not in sys.modules
path, names = sys.argv[1], ["fin_angle", "measured_fin_angle", "status", "homed"]
signal = np.array([(0.0, False), (0.2, False), (0.2, True), (8.0, True)], dtype=[("time", float), ("home", bool)])
run = simulate_fmu(path, stop_time=7.0, step_size=0.01, output_interval=0.01, input=signal, output=names)
description = read_model_description(path)
at = {v.name: v.valueReference for v in description.modelVariables}
slave = FMU2Slave(guid=description.guid, unzipDirectory=extract(path), instanceName="fin",
                  modelIdentifier=description.coSimulation.modelIdentifier)
slave.instantiate()
slave.setupExperiment(startTime=0.0)
slave.enterInitializationMode()
slave.exitInitializationMode()
slave.setBoolean([at["home"]], [True])
slave.setReal([at["fin_command"]], [0.1])
def move(begin, end):
    rows = []
    for k in range(begin, end):
        slave.doStep(k * 0.0103, 0.0103)
        rows.append(slave.getReal([at["fin_angle"], at["motor_current"]]) + slave.getInteger([at["status"]]))
    return rows
move(0, 200)
state = slave.getFMUstate()
kept = slave.serializeFMUstate(state)
first = move(200, 650)
slave.setFMUstate(slave.deSerializeFMUstate(kept))
print(json.dumps({"signal": {n: run[n].astype(float).tolist() for n in names}, "continued": first,
                  "restored": move(200, 650)}))
"""


@pytest.mark.fmu
def test_four_fins_home_each_for_itself(tmp_path: Path) -> None:
    """On a stiff bus each is a single one."""
    path = build(BASE, tmp_path / "four.fmu", "native", cc="gcc", fins=4).path
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "four")
    unit = Instance(Fmu(str(tmp_path / "four")))
    starts, times = (0.3, -0.2, 0.0, 0.1), (0.1, 1.0, 9.0, 0.4)  # the third is not asked
    assert max(unit.initialize(**{f"fin[{k}].fin.start_angle": a for k, a in enumerate(starts, 1)})) == OK
    rows: list[list[float]] = [[] for _ in starts]
    for i in range(800):
        for k, asked in enumerate(times, 1):
            assert unit.set(f"fin[{k}].home", i * 0.01 > asked - 1e-9) == OK
        assert unit.step(i * 0.01, 0.01) == OK
        for k, row in enumerate(rows, 1):
            row.append(unit.get(f"fin[{k}].fin_angle"))
    ends = [unit.get_vr("Integer", [unit.fmu.references[f"fin[{k}].status"]])[1][0] for k in range(1, 5)]
    unit.free()
    assert ends == [OPERATIONAL, OPERATIONAL, UNREFERENCED, OPERATIONAL]
    for start, asked, row in zip(starts, times, rows, strict=True):
        signal = np.arange(801) * 0.01 > asked - 1e-9
        alone = simulate(BASE.replace({"fin.start_angle": start}).values, 8.0, 0.01, model=MODEL, home=signal)
        assert row == alone["fin_angle"][1:].tolist()

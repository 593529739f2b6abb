"""Errors and warnings of a user's functions that only a run shows: impure, endless, not finite, unstable."""

from __future__ import annotations

import operator
import re
from contextlib import nullcontext
from functools import partial
from itertools import product
from math import inf, isnan
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from emcas_fmu.errors import BuildError, EmcasError
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.package import interface_guid
from emcas_fmu.fmi.pictures import response_pictures
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.ops.located import LocatedFloats, located
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import codegen, library
from emcas_fmu.simulation import simulate, simulate_fins

from .example import FILE, FOLDER, MODEL, changed

_SPRING = "- p.spring.stiffness * x.fin_angle"
_DAMPING = "- p.hinge.damping * x.fin_rate"
_STEP = """
def step(ops, p, x, u, h):
    rates = derivatives(ops, p, x, u)
    return RESULT


def output_values"""
STATES = '{name: getattr(x, name) + h * rates[name] for name in ("fin_angle", "fin_rate", "current")}'


def simulate_briefly(path: Path | str) -> None:
    """Simulate 2 ms of an actuator in Python, which suffices for the checks of a first simulation."""
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))


def stepped_by(result: str) -> tuple[tuple[str, str], ...]:
    """Return the changes of the example to a step() that returns `result`."""
    return (("\ndef output_values", _STEP.replace("RESULT", result)),
            ("    derivatives=derivatives,", "    step=step,"),
            ("ACTUATOR = em.Actuator(", 'PARAMETERS += (em.parameter("step.share", "1", -1.0, 3.0, "of h"),)\n'
             "ACTUATOR = em.Actuator("),
            ("    values=ESTIMATES,", '    values={**ESTIMATES, "step.share": 1.0},'))


def stepped(folder: Path, result: str) -> Path:
    """Write the example with a step() that returns `result`."""
    return changed(folder, *stepped_by(result))


@pytest.mark.parametrize(("result", "says"), [
    (STATES, "step() returns dict; return a mapping of states and the time [s] that the step has advanced"),
    (f"{STATES}, None", "step() returns the time of the step = None; return a number"),
])
def test_a_step_that_returns_no_time_is_refused(tmp_path: Path, result: str, says: str) -> None:
    with pytest.raises(EmcasError, match=r"mine\.py, line \d+: " + re.escape(says)):
        codegen.traced(model=str(stepped(tmp_path, result)))


@pytest.mark.parametrize("kernel", ["python", "compiled"])
def test_every_loop_ends(tmp_path: Path, kernel: str) -> None:
    """The step advances by zero, a negative, tiny or too long time, or one that is not a number."""
    model = str(stepped(tmp_path, f"{STATES}, p.step.share * h + 0.0 * ops.sqrt(2.0 - p.step.share)"))
    if kernel == "compiled" and not library.available(model):
        pytest.skip("no compiler")
    for share in (0.0, -1.0, 1e-9, 2.0, 3.0):
        with pytest.raises(ArithmeticError, match=r"at 0(\.001)? s: "):
            simulate({**load_parameters(model=MODEL).values, "step.share": share}, 0.01, kernel=kernel, model=model)


_IMPURE = "import random\nfrom itertools import count\nfrom pathlib"


@pytest.mark.parametrize(("before", "after", "name"), [
    ("- p.hinge.damping * x.fin_rate", "- random.random() * x.fin_rate", "derivatives"),
    ("- p.hinge.damping * x.fin_rate", "- next(COUNTER) * x.fin_rate", "derivatives"),
    ("- p.hinge.damping * x.fin_rate", "- (2.0 if next(COUNTER) else 1.0) * x.fin_rate", "derivatives"),  # once only
    ("c.kd * x.fin_rate", "c.kd * (next(COUNTER) + p.hinge.damping)", "sample"),
    ('"motor_current": x.current', '"motor_current": random.random() + 0.0 * x.current', "output_values"),
    ('"motor_current": x.current', '"motor_current": random.random()', "output_values"),
])
def test_functions_that_change_between_calls_are_refused(tmp_path: Path, before: str, after: str, name: str) -> None:
    """Their values would be constants that differ from FMU to FMU. The error names the line or the function."""
    path = changed(tmp_path, ("from pathlib", _IMPURE), ("PARAMETERS = (", "COUNTER = count()\nPARAMETERS = ("),
                   (before, after))
    with pytest.raises(EmcasError, match=rf"mine\.py, line \d+: {name}\(\) is not the same when") as refused:
        codegen.traced(model=str(path))
    line = path.read_text(encoding="utf-8").splitlines()[int(str(refused.value).split(", line ")[1].split(":")[0]) - 1]
    assert after in line or line.startswith(f"def {name}(")


def test_the_guid_follows_the_equations(tmp_path: Path) -> None:
    """A state that is stored with other equations must not be restored."""
    guids = set()
    for name, sign in (("mine", "-"), ("other", "+"), ("same", "-")):
        model = str(changed(tmp_path, (_SPRING, _SPRING.replace("-", sign)), name=f"{name}.py"))
        shown = FmuInterface(1, model)
        guids.add(interface_guid(start_values(shown, [load_parameters(model=model).values]), shown))
    assert len(guids) == 2


@pytest.mark.parametrize(("kernel", "before", "after", "says"), [
    ("python", _DAMPING, "- 1e-3 / x.fin_rate", "derivatives(): 0.001 / 0 = inf; divide by a value that is never 0"),
    ("compiled", _DAMPING, "+ ops.where(x.fin_rate > 1e9, 1.0 / x.fin_rate, 0.0) - 1e-3 / (0.0 * x.fin_rate)",
     "derivatives(): 0.001 / 0 = inf; divide by a value that is never 0, as in ops.where"),
    ("python", '"motor_current": x.current', '"motor_current": ops.sqrt(-0.04 - x.current)',
     "output_values(): sqrt(-0.04) = nan; use ops.sqrt(ops.maximum(x, 0.0))"),
    ("python", "c.kd * x.fin_rate", "ops.log(x.fin_rate)", "sample(): log("),
    ("python", '"motor_current": x.current', '"motor_current": ops.pow(-1.0 - x.current, 1.5)',
     "output_values(): pow(-1, 1.5) = nan; use ops.pow(ops.maximum(x, 0.0), y)"),
    ("python", '"motor_current": x.current', '"motor_current": 1e308 * (1e308 * x.current)',
     "= inf; the values have grown without bound"),
])
def test_error_names_the_first_line_that_is_not_finite(tmp_path: Path, kernel: str, before: str, after: str, says: str
                                                       ) -> None:
    """A division that `where` leaves out is not named."""
    path = changed(tmp_path, (before, after))
    if kernel == "compiled" and not library.available(str(path)):
        pytest.skip("no compiler")
    line = next(i for i, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if after in text)
    with pytest.raises(ArithmeticError, match=re.escape(says)) as refused:
        simulate(load_parameters(model=str(path)).values, 0.05, kernel=kernel, model=str(path), fin_command=0.01)
    assert re.search(r"at [\d.]+ s: \w+ is -?(inf|nan): " + re.escape(f"{path}, line {line}: "), str(refused.value))


def test_located_numbers_are_floats() -> None:
    """Operations have the same bits as with floats, and results of IEEE 754 where Python's floats raise."""
    at = partial(located, path=FILE)
    for a, b in product((-2.5, -0.0, 0.0, 0.3, 1e300, inf), repeat=2):
        for operation in (operator.add, operator.sub, operator.mul, operator.truediv):
            with np.errstate(all="ignore"):
                expected = operation(np.float64(a), np.float64(b))
            for found in (operation(at(a), b), operation(a, at(b)), operation(at(a), at(b))):
                assert repr(float(found)).lstrip("-" * isnan(found)) == repr(float(expected)).lstrip("-" * isnan(found))
    ops = LocatedFloats(FILE)
    for name in ("sin", "cos", "tan", "atan", "exp", "log", "sqrt", "fabs", "floor"):
        assert getattr(ops, name)(at(0.7)) == getattr(FLOATS, name)(0.7)
    assert (-at(0.7), abs(at(-0.7)), ops.clip(at(3.0), 0.0, 1.0)) == (-0.7, 0.7, 1.0)


def test_values_that_are_not_finite_in_several_fins_and_on_the_page_of_an_fmu(tmp_path: Path) -> None:
    """A division by zero that `where` leaves out raises an error in Python only."""
    path = changed(tmp_path, (_DAMPING, "- 1e-3 / x.fin_rate"))
    parameters = load_parameters(model=str(path))
    place = re.escape(f"{path}, line ") + r"\d+: derivatives\(\): 0\.001 / 0 = inf"
    with pytest.raises(ArithmeticError, match=place):
        simulate_fins([parameters.values] * 2, 0.01, model=str(path))
    with pytest.raises(BuildError, match="the responses on the FMU's page cannot be computed: at 0.001 s: .*" + place):
        response_pictures(parameters)
    path = changed(tmp_path, (_DAMPING, "+ ops.where(x.fin_rate > 1e9, q, 0.0) + ops.where(x.fin_rate > 2e9, q, 0.0)"),
                   ("    load = ", "    q = 1.0 / x.fin_rate\n    load = "), name="unused.py")
    with pytest.raises(ArithmeticError, match=r"at 0\.001 s: .*division by zero; Python raises it also for the value"):
        simulate(load_parameters(model=str(path)).values, 0.01, kernel="python", model=str(path))


@pytest.mark.parametrize(("before", "after", "says"), [
    (_SPRING, _SPRING.replace("-", "+"), "the states grow without bound while disabled, by a factor of e in 1.61 s"),
    ("p.motor.torque_constant * x.current + load", "-p.motor.torque_constant * x.current + load",
     "the states grow without bound while disabled, by a factor of e in 0.00262 s"),
    (_DAMPING, _DAMPING.replace("-", "+"), "d(fin_rate)/dt rises with fin_rate, by 3.33 1/s: it drives itself"),
    ('"reference": ops.where(inputs.enable, voltage', '"reference": ops.where(inputs.enable, -voltage',
     "fin_angle grows from 0.5 to 25 deg while enabled"),
    (_DAMPING, _DAMPING, ""),
])
def test_wrong_signs_are_warned_of_once(tmp_path: Path, caplog: pytest.LogCaptureFixture, before: str, after: str,
                                        says: str) -> None:
    path = changed(tmp_path, (before, after))
    for _ in range(2):
        simulate_briefly(path)
    warnings = [record.getMessage() for record in caplog.records]
    assert len(warnings) == bool(says)
    if says:
        assert f"{path}: from rest, without command and load, {says}" in warnings[0]
        assert warnings[0].endswith("; check the signs of stiffness, damping, motor torque and control")


def test_a_wrong_sign_is_named_before_its_consequences(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The current grows until rounding hides the effect of friction."""
    path = changed(tmp_path, ("- p.motor.resistance * x.current", "+ p.motor.resistance * x.current"),
                   (_DAMPING, "- u.rub"), ("    sample=s", '    discontinuities=(em.Coulomb("rub", "fin_rate", '
                                           '"hinge.damping"),), sample=s'))
    simulate_briefly(path)
    (message,) = caplog.messages
    assert "d(current)/dt rises with current" in message


def test_a_table_whose_points_do_not_rise_is_refused(tmp_path: Path) -> None:
    """Without a rule of the actuator, the error names the table and the line that reads it."""
    path = changed(tmp_path, (_SPRING, "- ops.interp(x.fin_angle, p.spring.angle, p.spring.torque)"),
                   ("PARAMETERS = (", """PARAMETERS = (
                    *em.array("spring.angle", 3, "rad", -1.0, 1.0, ""),
                    *em.array("spring.torque", 3, "N.m", 0.0, 1.0, ""),
                    """), ("ESTIMATES = {", """ESTIMATES = {
                    **{f"spring.angle[{i}]": (0.0, 0.2, 0.1)[i] for i in range(3)},
                    **{f"spring.torque[{i}]": 0.0 for i in range(3)},"""))
    line = path.read_text(encoding="utf-8")[:path.read_text(encoding="utf-8").index("- ops.interp")].count("\n") + 1
    with pytest.raises(EmcasError, match=re.escape(
            f"{path}, line {line}: TableError: the points of a table must rise; they are 0, 0.2, 0.1; spring.angle: "
            "refuse such values by rules=(em.rising('spring.angle', 3),)")):
        simulate(load_parameters(model=str(path)).values, 0.002, model=str(path))


@pytest.mark.parametrize(("after", "says"), [
    ("ops.where(u.enabled, em.fin_port.hinge_torque(ops, p, x.fin_angle, u), 0.0)", ""),  # like a brake
    ("0.0 * x.fin_angle", "d(fin_rate)/dt does not depend on aero_torque; add em.fin_port.hinge_torque"),
    ("-em.fin_port.hinge_torque(ops, p, x.fin_angle, u)", "d(fin_rate)/dt falls with aero_torque; check the sign")])
def test_a_missing_or_reversed_load_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture, after: str,
                                                 says: str) -> None:
    path = changed(tmp_path, ("load = em.fin_port.hinge_torque(ops, p, x.fin_angle, u)", f"load = {after}"))
    simulate_briefly(path)
    assert [message.startswith(f"{path}: {says}") for message in caplog.messages] == [True] * bool(says)


def test_a_drive_that_ignores_enable_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It suffices that either the sample or the plant uses enable."""
    sampled = ('{"reference": ops.where(inputs.enable, voltage, 0.0)', '{"reference": voltage')
    driven = ("ops.where(u.enabled, ops.clip(u.reference, -u.supply, u.supply), 0.0)",
              "ops.clip(u.reference, -u.supply, u.supply)")
    for name, changes in (("plant", [sampled]), ("sample", [driven]), ("none", [sampled, driven])):
        simulate_briefly(changed(tmp_path, *changes, name=f"{name}.py"))
    (message,) = caplog.messages
    assert message.startswith(f"{tmp_path / 'none.py'}: fin_angle follows fin_command while disabled")


@pytest.mark.parametrize("change", [(), (("ops.clip(u.reference, -u", "ops.clip(1e-9 * u.reference, -u"),)])
def test_a_command_that_is_not_clipped_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture,
                                                    change: tuple[tuple[str, str], ...]) -> None:
    """If the drive does not reach the limit in time, the reference shows it."""
    path = changed(tmp_path, ("em.fin_port.clipped_command(ops, p, inputs.command)", "inputs.command"), *change)
    simulate_briefly(path)
    (message,) = caplog.messages
    assert message.startswith(f"{path}: fin_angle follows fin_command beyond command.limit; clip the command")


_TOOTH = (("PARAMETERS = (", 'PARAMETERS = (em.parameter("gear.tooth", "m", 0.0, 1.0, "size of a tooth"),'),
          ("ESTIMATES = {", 'ESTIMATES = {"gear.tooth": "1 mm", '))
_UNUSED = "nothing depends on {}; use it in an equation or a rule, or leave it out"


@pytest.mark.parametrize(("name", "changes"), [
    ("gear.tooth", _TOOTH),
    ("gear.tooth", (*_TOOTH, ("    rise = ", "    rise = 0.0 * p.gear.tooth\n    rise = "))),  # read without effect
    ("hinge.damping", ((_DAMPING, ""),)),
    ("air.temperature", (
        ("    sample=s", '    further_inputs=(em.real_input("air.temperature", "K", "of the air"),), sample=s'),)),
    ("", (*_TOOTH, ("    sample=s", '''
    rules=(em.rule("a tooth of %g m")(lambda ops, p, _: (p.gear.tooth - 0.01, p.gear.tooth)),), sample=s'''))),
    ("", (*_TOOTH, ("    faults=(", '''    faults=(em.PlantFault(
        "skipped", "the gear has skipped a tooth", lambda ops, p, amounts: {"hinge.damping": p.gear.tooth}),'''))),
    ("", (*_TOOTH, ("lambda ops, p: 1.0 / p.motor.inductance", "lambda ops, p: 1.0 / p.gear.tooth"))),
])
def test_unused_parameters_and_inputs_are_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str,
                                                    changes: tuple[tuple[str, str], ...]) -> None:
    """A parameter that only a rule, a fault or the bus of several fins reads is used."""
    path = changed(tmp_path, *changes)
    simulate_briefly(path)
    lines = [i for i, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if f'"{name}"' in line]
    assert caplog.messages == [f"{path}, line {lines[0]}: {_UNUSED.format(name)}" for _ in range(bool(name))]


@pytest.mark.parametrize("extension", ["", "+faults"])
def test_a_supply_without_effect_on_motion_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture,
                                                        extension: str) -> None:
    """Its effect on power and a monitor does not suffice."""
    path = changed(tmp_path, ("-inputs.supply, inputs.supply", "-39.0, 39.0"), ("> inputs.supply", "> 39.0"),
                   ("-u.supply, u.supply", "-39.0, 39.0"), ("voltage(ops, u) * x.current}", "u.supply * x.current}"),
                   ("em.capabilities.POSITION_LOOP", "em.capabilities.SUPPLY_VOLTAGE"))
    simulate_briefly(f"{path}{extension}")
    (message,) = caplog.messages
    assert message.startswith(f"{path}: no motion depends on supply_voltage; limit the drive by inputs.supply")


@pytest.mark.parametrize(("output", "says"), [
    ('"fin_angle": 57.3 * x.fin_angle', "fin_angle = 0.573 instead of 0.01; leave it out: the fin port has it"),
    ('"fin_rate": -x.fin_rate', "fin_rate = -0.01 instead of 0.01"),
    ('"tracking_error": x.fin_angle - u.command', "tracking_error = 0.01 instead of -0.01"),
    ('"fin_angle": x.fin_angle, "tracking_error": em.fin_port.clipped_command(ops, p, u.command) - x.fin_angle', ""),
])
def test_outputs_that_contradict_the_port_are_refused(tmp_path: Path, output: str, says: str) -> None:
    path = changed(tmp_path, ('"motor_current": x', f'{output}, "motor_current": x'))
    expected = pytest.raises(EmcasError, match=r"mine\.py, line \d+: output_values\(\) returns " + re.escape(says))
    for _ in range(2):
        with expected if says else nullcontext():
            simulate_briefly(path)


_MOTOR = '"motor_angle": p.gear.ratio * start.fin_angle'
_HALF = '"pressure_1": 0.4 * u.supply, "pressure_2": 0.4 * u.supply'


@pytest.mark.parametrize(("name", "before", "after", "says"), [
    ("strain_wave", _MOTOR, "", "fin_angle leaves fin.start_angle = 0.5 deg by 0.473 deg, though commanded to stay; "),
    ("strain_wave", _MOTOR, f'{_MOTOR}, "fin_angle": 0.1',
     "fin_angle starts at 5.73 deg for fin.start_angle = 0.5 deg; let initial() set the states from start.fin_angle"),
    # The pressures start at half their equilibrium, which is stable.
    ("hot_gas", _HALF.replace("4", "8"), _HALF, ""),
])
def test_a_wrong_start_angle_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str, before: str,
                                          after: str, says: str) -> None:
    text, path = (FOLDER / f"{name}.py").read_text(encoding="utf-8"), tmp_path / "mine.py"
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    simulate_briefly(path)
    assert [message.startswith(f"{path}: {says}") for message in caplog.messages] == [True] * bool(says)


@pytest.mark.parametrize("name", ["direct_drive", "strain_wave", "hot_gas"])
def test_no_shipped_example_warns(tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str) -> None:
    simulate_briefly(Path(copytree(FOLDER, tmp_path / "examples")) / f"{name}.py")  # a process checks a file only once
    assert not caplog.records


_SWITCHED = """
def mode(ops, p, x, u, h):
    return em.Record(held=ops.both(ops.fabs(x.fin_angle) >= em.fin_port.stop_edge(p), x.fin_angle * x.fin_rate >= 0.0))


def rates(ops, p, x, u, m):
    return derivatives(ops, p, x, u)


def margins(ops, p, x, u, m):
    return {"stop": ops.where(m.held, 1.0, MARGIN)}


def landed(ops, p, begin, x, u, m, events):
    return {"fin_rate": ops.where(ops.either(m.held, events["stop"]), 0.0, x.fin_rate)}


def output_values"""


def inverted(margin: str) -> tuple[tuple[str, str], ...]:
    """Return the changes of the example to one with events, with an event margin of the stop."""
    return (("\ndef output_values", _SWITCHED.replace("MARGIN", margin)),
            ("    derivatives=derivatives,", "    step=SYSTEM.step(lambda ops, p: p),"),
            ("ACTUATOR = em.Actuator(", "SYSTEM = em.Switched(mode, rates, margins, landed)\nACTUATOR = em.Actuator("),
)


@pytest.mark.parametrize(("margin", "sound"), [("p.fin.stop_angle - ops.fabs(x.fin_angle)", True),
                                               ("ops.fabs(x.fin_angle) - p.fin.stop_angle", False)])
def test_an_inverted_event_margin_is_refused(tmp_path: Path, margin: str, sound: bool) -> None:
    path = changed(tmp_path, *inverted(margin))
    values = load_parameters(model=str(path)).values
    if sound:
        assert simulate(values, 0.002, kernel="python", model=str(path))["fin_angle"][-1] == 0.0
        return
    for _ in range(2):
        with pytest.raises(EmcasError, match=r"mine\.py, line \d+: margins\(\): stop = -0\.43\d* is below 0 in 10 st"):
            simulate_briefly(path)


@pytest.mark.parametrize("extension", ["", "+faults"])
def test_a_controller_state_that_no_sample_sets_is_refused(tmp_path: Path, extension: str) -> None:
    path = changed(tmp_path, (' "integral": ops.where(inputs.enable, moved, 0.0),', ""))
    with pytest.raises(EmcasError, match=r"mine\.py, line \d+: sample\(\) returns no integral, which nothing else"):
        simulate_briefly(f"{path}{extension}")

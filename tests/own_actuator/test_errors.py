"""What is wrong in a user's file is said with file, line and remedy."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from emcas_fmu import actuators
from emcas_fmu.actuators import external, get
from emcas_fmu.errors import BuildError, EmcasError
from emcas_fmu.fmi.figures import response_pictures
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.package import interface_guid
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.runtime import codegen, library
from emcas_fmu.simulation import simulate, simulate_fins

from .example import FILE, MODEL, changed

_SPRING = "- p.spring.stiffness * x.fin_angle"


@pytest.mark.parametrize(("change", "place", "says"), [
    ((_SPRING, "- p.spring.stifness * x.fin_angle"), _SPRING, "no stifness; did you mean stiffness?"),
    ((_SPRING, "- p.spring.stiffness * x.fin_angel"), _SPRING, "no fin_angel; did you mean fin_angle?"),
    (('"fin_rate": x.fin_rate,\n', "\n"), "def output_values", "output_values() returns no fin_rate"),
    (('"motor_current": x.current', '"motor_curent": x.current'), "def output_values", "returns no motor_current"),
    (("    clipped = ops", "    if demand > 0.0: pass\n    clipped = ops"), "    clipped = ops",
     "no truth: use ops.where"),
    (("    clipped = ops", "    import math; math.sin(demand)\n    clipped = ops"), "    clipped = ops",
     "not Expr; use ops.sin"),
    (("ACTUATOR = Actuator(", "ACTUATOR = = Actuator("), "ACTUATOR = Actuator(", "invalid syntax"),
    (('State("current", "A")', 'State("fin_rate", "A")'), "ACTUATOR = Actuator(", "fin_rate is the name of two things"),
    (('State("current", "A")', 'State("the current", "A")'), None,
     "'the current': a state's name is a Python identifier"),
    (("    derivatives=derivatives,\n", ""), "ACTUATOR = Actuator(", "has neither step nor derivatives"),
    (('"fin_rate": torque / inertia, ', ""), "def derivatives", "derivatives() returns no fin_rate"),
    (("rise / p.motor.inductance", "rise / 0.0"), "    return {\"fin_angle\": x.fin_rate, \"fin", "division by 0"),
    (('"fin_rate": x.fin_rate,\n', '"fin_rate": None,\n'), "def output_values",
     "returns fin_rate = None; a number is needed"),
    (('"fin_rate": x.fin_rate,\n', '"fin_rate": [x.fin_rate],\n'), "def output_values", "a number is needed"),
    (('"fin_rate": x.fin_rate,\n', '"fin_rate": float("nan"),\n'), "def output_values", "returns fin_rate = nan"),
    (('State("fin_angle", "rad"), ', ""), "ACTUATOR = Actuator(", "there is no state fin_angle; the sensors read"),
    (("    clipped = ops", "    ops.tanh(demand)\n    clipped = ops"), "    clipped = ops",
     "ops has no tanh; did you mean tan?"),
    (("    clipped = ops", "    demand ** 2\n    clipped = ops"), "    clipped = ops", "write x * x"),
    (('State("current", "A")', 'State("replace", "A")'), None, "the name of a method of x"),
    (('"fin_rate": torque / inertia', '"fin_rte": torque / inertia'), "def derivatives",
     "derivatives() returns no fin_rate; it returns fin_rte, which is not declared; did you mean fin_rate?"),
    (('"integral": ops', '"integrl": ops'), "def sample", "returns integrl, which is not declared; did you mean "
     "integral?; there is"),
    (('"motor_current", "A", "motor current", 10.0', '"motor_current", "A", "motor current", 0.0'),
     "ACTUATOR = Actuator(", "motor_current has nominal 0; give its order of magnitude"),
    (('real_output("motor_voltage", "V"', 'real_output("motor voltage", "V"'), "ACTUATOR = Actuator(",
     "name 'motor voltage': hosts accept letters, digits and _"),
    (("lambda ops, p: 1.0", "lambda p: 1.0"), "    supply=Supply(",
     "inverse_inductance has 1 argument; give a function of (ops, p) or of (ops, p, interval)"),
    (("MOTOR_CURRENT = real_output(\"motor_current\"", "MOTOR_CURRENT = real_output(\"motor.inertia\""),
     "ACTUATOR = Actuator(", "motor.inertia is declared twice"),
    (('"hinge.damping", "N.m.s/rad", 0.0,', '"hinge.damping", "N.m.s/rad", 2e3,'), "ACTUATOR = Actuator(",
     "hinge.damping has minimum 2000 above maximum 1000"),
    (('real_input("supply_voltage", "V"', 'real_input("supply_heat", "K"'), "    supply=Supply(",
     "supply supply_heat [K]: the line that feeds an actuator is one of voltage [V] or of pressure [Pa]"),
    (('real_output("supply_power", "W"', 'real_output("pump_power", "W"'), "    supply=Supply(",
     "every actuator's is supply_power [W]"),
    (("capabilities.POSITION_LOOP}", "'a motor curent'}"), "ACTUATOR = Actuator(", "did you mean a motor current?"),
    (("capabilities.POSITION_LOOP}", "capabilities.CURRENT_LIMIT}"), "ACTUATOR = Actuator(",
     "which needs drive.current_limit"),
])
def test_file_and_line_are_named(tmp_path: Path, change: tuple[str, str], place: str | None, says: str) -> None:
    path = changed(tmp_path, change)
    with pytest.raises(EmcasError, match=re.escape(says)) as refused:
        codegen.traced(model=str(path))
    named = re.match(re.escape(f"{path}, line ") + r"(\d+)", str(refused.value))
    assert named
    if place is not None:
        expected = next(i for i, line in enumerate(FILE.read_text(encoding="utf-8").splitlines(), 1) if place in line)
        assert int(named[1]) == expected


@pytest.mark.parametrize(("expression", "remedy"), [
    ("demand % 2.0", "write x - y * ops.floor(x / y)"),
    ("demand // 2.0", "write ops.floor(x / y)"),
    ("2.0 ** demand", "write ops.exp(y * ops.log(x))"),
    ("int(demand)", "write ops.floor(x)"),
    ("float(demand)", "leave float() out"),
    ("round(demand)", "write ops.floor(x + 0.5)"),
    ("[1.0, 2.0][demand]", "choose between values by ops.where"),
    ("range(demand)", "a loop needs a fixed number"),
    ("np.interp(demand, [0.0, 1.0], [0.0, 2.0])", "put the pieces together by ops.where"),
    ("np.clip(demand, -1.0, 1.0)", "use ops.clip"),
    ("np.sin(demand)", "use ops.sin"),
    ("max(demand, 0.0)", "use ops.maximum"),
    ("math.atan2(demand, 1.0)", "use functions of ops, as in ops.sin(x)"),
])
def test_the_remedy_fits(tmp_path: Path, expression: str, remedy: str) -> None:
    path = changed(tmp_path, ("    clipped = ops", f"    {expression}\n    clipped = ops"),
                   ("from pathlib", "import math\n\nimport numpy as np\nfrom pathlib"))
    with pytest.raises(EmcasError, match=r"line \d+: TypeError: .*" + re.escape(remedy)):
        codegen.traced(model=str(path))


_STEP = """
def step(ops, p, x, u, h):
    rates = derivatives(ops, p, x, u)
    return RESULT


def output_values"""
_STATES = '{name: getattr(x, name) + h * rates[name] for name in ("fin_angle", "fin_rate", "current")}'


def stepped(folder: Path, result: str) -> Path:
    """The example with a step() that returns `result`."""
    return changed(folder, ("\ndef output_values", _STEP.replace("RESULT", result)),
                   ("    derivatives=derivatives,", "    step=step,"),
                   ("ACTUATOR = Actuator(", 'PARAMETERS += (parameter("step.share", "1", -1.0, 3.0, "of h"),)\n'
                    "ACTUATOR = Actuator("))


@pytest.mark.parametrize(("result", "says"), [
    (_STATES, "step() returns dict; a mapping of states and the time until then are needed"),
    (f"{_STATES}, None", "step() returns the time of the step = None; a number is needed"),
])
def test_what_a_step_returns(tmp_path: Path, result: str, says: str) -> None:
    with pytest.raises(EmcasError, match=r"mine\.py, line \d+: " + re.escape(says)):
        codegen.traced(model=str(stepped(tmp_path, result)))


@pytest.mark.parametrize("kernel", ["python", "compiled"])
def test_every_loop_ends(tmp_path: Path, kernel: str) -> None:
    """Of a step that takes no time, a negative one, hardly any, more than there is, or one that is not a number."""
    model = str(stepped(tmp_path, f"{_STATES}, p.step.share * h + 0.0 * ops.sqrt(2.0 - p.step.share)"))
    if kernel == "compiled" and not library.available(model):
        pytest.skip("no compiler")
    for share in (0.0, -1.0, 1e-9, 2.0, 3.0):
        with pytest.raises(ArithmeticError, match=r"at 0(\.001)? s: "):
            simulate({**load_parameters(model=MODEL).values, "step.share": share}, 0.01, kernel=kernel, model=model)


_IMPURE = "import random\nfrom itertools import count\nfrom pathlib"


@pytest.mark.parametrize(("before", "after", "name"), [
    ("- p.hinge.damping * x.fin_rate", "- random.random() * x.fin_rate", "derivatives"),
    ("- p.hinge.damping * x.fin_rate", "- next(COUNTER) * x.fin_rate", "derivatives"),
    ("c.kd * x.fin_rate", "c.kd * (next(COUNTER) + p.hinge.damping)", "sample"),
    ('"hinge_torque": fin', '"hinge_torque": random.random() + 0.0 * fin', "output_values"),
    ('"fin_rate": x.fin_rate,\n', '"fin_rate": random.random(),\n', "output_values"),
])
def test_what_changes_between_calls(tmp_path: Path, before: str, after: str, name: str) -> None:
    """It would be a constant, and another one in each FMU. The line is named, or that of the function."""
    path = changed(tmp_path, ("from pathlib", _IMPURE), ("PARAMETERS = (", "COUNTER = count()\nPARAMETERS = ("),
                   (before, after))
    with pytest.raises(EmcasError, match=rf"mine\.py, line \d+: {name}\(\) is not the same when") as refused:
        codegen.traced(model=str(path))
    line = path.read_text(encoding="utf-8").splitlines()[int(str(refused.value).split(", line ")[1].split(":")[0]) - 1]
    assert after in line or line.startswith(f"def {name}(")


def test_the_guid_follows_the_equations(tmp_path: Path) -> None:
    """Not only the interface: a host or a stored state of other equations is of another FMU."""
    guids = set()
    for name, sign in (("mine", "-"), ("other", "+"), ("same", "-")):
        model = str(changed(tmp_path, (_SPRING, _SPRING.replace("-", sign)), name=f"{name}.py"))
        shown = FmuInterface(1, model)
        guids.add(interface_guid(start_values(shown, [load_parameters(model=model).values]), shown))
    assert len(guids) == 2


_DAMPING = "- p.hinge.damping * x.fin_rate"


@pytest.mark.parametrize(("kernel", "before", "after", "says"), [
    ("python", _DAMPING, "- 1e-3 / x.fin_rate", "derivatives(): 0.001 / 0 = inf; divide by a value that is never 0"),
    ("compiled", _DAMPING, "+ ops.where(x.fin_rate > 1e9, 1.0 / x.fin_rate, 0.0) - 1e-3 / (0.0 * x.fin_rate)",
     "derivatives(): 0.001 / 0 = inf; divide by a value that is never 0, as in ops.where"),
    ("python", '"motor_current": x.current', '"motor_current": ops.sqrt(-0.04 - x.current)',
     "output_values(): sqrt(-0.04) = nan; use ops.sqrt(ops.maximum(x, 0.0))"),
    ("python", "c.kd * x.fin_rate", "ops.log(x.fin_rate)", "sample(): log("),
    ("python", '"motor_current": x.current', '"motor_current": 1e308 * (1e308 * x.current)',
     "= inf; the values have grown without bound"),
])
def test_what_is_not_finite(tmp_path: Path, kernel: str, before: str, after: str, says: str) -> None:
    """Named by the line whose numbers were finite, and not by a division that `where` leaves out."""
    path = changed(tmp_path, (before, after))
    if kernel == "compiled" and not library.available(str(path)):
        pytest.skip("no compiler")
    line = next(i for i, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if after in text)
    with pytest.raises(ArithmeticError, match=re.escape(says)) as refused:
        simulate(load_parameters(model=str(path)).values, 0.05, kernel=kernel, model=str(path), fin_command=0.01)
    assert re.search(r"at [\d.]+ s: \w+ is -?(inf|nan): " + re.escape(f"{path}, line {line}: "), str(refused.value))


def test_what_is_not_finite_elsewhere(tmp_path: Path) -> None:
    """In several fins, and in the responses on an FMU's page; and what Python alone refuses."""
    path = changed(tmp_path, (_DAMPING, "- 1e-3 / x.fin_rate"))
    parameters = load_parameters(model=str(path))
    place = re.escape(f"{path}, line ") + r"\d+: derivatives\(\): 0\.001 / 0 = inf"
    with pytest.raises(ArithmeticError, match=place):
        simulate_fins([parameters.values] * 2, 0.01, model=str(path))
    with pytest.raises(BuildError, match="the responses on the FMU's page cannot be computed: at 0.001 s: .*" + place):
        response_pictures(parameters)
    path = changed(tmp_path, (_DAMPING, "+ ops.where(x.fin_rate > 1e9, q, 0.0) + ops.where(x.fin_rate > 2e9, q, 0.0)"),
                   ("    load = ", "    q = 1.0 / x.fin_rate\n    load = "), name="unused.py")
    with pytest.raises(ArithmeticError, match=r"at 0\.001 s: .*division by zero; Python refuses it in an unused value"):
        simulate(load_parameters(model=str(path)).values, 0.01, kernel="python", model=str(path))


@pytest.mark.parametrize(("before", "after", "says"), [
    (_SPRING, _SPRING.replace("-", "+"), "the states grow without bound while disabled, e-fold in 1.61 s"),
    ("p.motor.torque_constant * x.current + load", "-p.motor.torque_constant * x.current + load",
     "the states grow without bound while disabled, e-fold in 0.00262 s"),
    (_DAMPING, _DAMPING.replace("-", "+"), "d(fin_rate)/dt rises with fin_rate, by 3.33 1/s: it drives itself"),
    ('"reference": ops.where(inputs.enable, voltage', '"reference": ops.where(inputs.enable, -voltage',
     "fin_angle grows from 0.5 to 25 deg while enabled"),
    (_DAMPING, _DAMPING, ""),
])
def test_signs(tmp_path: Path, caplog: pytest.LogCaptureFixture, before: str, after: str, says: str) -> None:
    """Wrong ones are seen from rest, without command and load, at the first simulation, once."""
    path = changed(tmp_path, (before, after))
    for _ in range(2):
        simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    warnings = [record.getMessage() for record in caplog.records]
    assert len(warnings) == bool(says)
    if says:
        assert f"{path}: from rest, without command and load, {says}" in warnings[0]
        assert warnings[0].endswith("; check the signs of stiffness, damping, motor torque and control")


_SWITCHED = """
def mode(ops, p, x, u, h):
    return Record(held=ops.both(ops.fabs(x.fin_angle) >= fin_port.stop_edge(p), x.fin_angle * x.fin_rate >= 0.0))


def rates(ops, p, x, u, m):
    return derivatives(ops, p, x, u)


def margins(ops, p, x, u, m):
    return {"stop": ops.where(m.held, 1.0, MARGIN)}


def landed(ops, p, begin, x, u, m, events):
    return {"fin_rate": ops.where(ops.either(m.held, events["stop"]), 0.0, x.fin_rate)}


def output_values"""


@pytest.mark.parametrize(("margin", "sound"), [("p.fin.stop_angle - ops.fabs(x.fin_angle)", True),
                                               ("ops.fabs(x.fin_angle) - p.fin.stop_angle", False)])
def test_an_inverted_margin(tmp_path: Path, margin: str, sound: bool) -> None:
    path = changed(tmp_path, ("\ndef output_values", _SWITCHED.replace("MARGIN", margin)),
                   ("    derivatives=derivatives,", "    step=SYSTEM.step(lambda ops, p: p),"),
                   ("ACTUATOR = Actuator(", "SYSTEM = Switched(mode, rates, margins, landed)\nACTUATOR = Actuator("),
                   ("from emcas_fmu.variables", "from emcas_fmu.namespace import Record\n"
                    "from emcas_fmu.steppers.events import Switched\nfrom emcas_fmu.variables"))
    values = load_parameters(model=str(path)).values
    if sound:
        assert simulate(values, 0.002, kernel="python", model=str(path))["fin_angle"][-1] == 0.0
        return
    for _ in range(2):
        with pytest.raises(EmcasError, match=r"mine\.py, line \d+: margins\(\): stop = -0\.43\d* is below 0 in 10 st"):
            simulate(values, 0.002, kernel="python", model=str(path))


def test_a_negative_delay(tmp_path: Path) -> None:
    path = changed(tmp_path, ("    sample=sample,", "    transport_delay=lambda ops, p: -0.001,\n    sample=sample,"))
    with pytest.raises(ParameterError, match=r"drive\.transport_delay = -0\.001 s must be at least 0"):
        load_parameters(model=str(path))


def test_degrees_for_radians(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = changed(tmp_path, ("ACTUATOR = Actuator(", 'PARAMETERS += (parameter("lock.angle", "rad", 0.0, 25.0, ""),)\n'
                              "ACTUATOR = Actuator("))
    get(str(path))
    assert "lock.angle may be up to 25 rad, 1432 deg; if 25 deg is meant, write radians(25)" in caplog.text
    with pytest.raises(ParameterError, match=r"fin\.stop_angle = 25\.0 rad: is 25 rad; .* did you mean 25 deg\?"):
        load_parameters(model=MODEL).with_values({"fin.stop_angle": 25.0})


def test_a_rule_that_asks_an_angle_is_refused_where_it_is_traced(tmp_path: Path) -> None:
    """By its line; numbers alone, which parameters are checked with, it can take."""
    path = changed(tmp_path, ("ACTUATOR = Actuator(", '''from emcas_fmu.rules import Rule


def within(ops, p, share):
    return (1.0 if share * p.spring.stiffness > 900.0 else -1.0), share


ACTUATOR = Actuator(
    rules=(Rule(within, "too stiff at %.6g of the travel", True),),'''))
    sound = load_parameters(model=str(path))
    with pytest.raises(ParameterError, match=r"too stiff at 0\.91 of the travel"):
        sound.with_values({"spring.stiffness": 1000.0})
    with pytest.raises(EmcasError, match=r", line \d+: TypeError: a traced value has no truth: use ops\.where"):
        codegen.traced_rules(sound.model)


@pytest.mark.parametrize(("change", "says"), [
    (("ACTUATOR = ", "MINE = "), "defines no ACTUATOR"),
    (('"N.m/rad", 0.0', '"N.m/rod", 0.0'), "spring.stiffness: unknown unit 'N.m/rod'; did you mean rad?"),
    (("*fin_port.OUTPUTS, ", ""), "output fin_angle of the fin port is missing"),
    (("    *fin_port.PARAMETERS,\n", ""), "parameter inertia.fin of the fin port is missing"),
    (('State("current", "A")', 'State("current", "Amp")'), "current: unknown unit 'Amp'"),
    (('"rad/s"', '"rod/s"'), "fin_rate: unknown unit 'rod/s'; did you mean rad?"),  # of the output it is rad/s
    (('name="direct-drive"', 'name="elastic"'), "name 'elastic' is that of an actuator or extension that is shipped"),
    (('name="direct-drive"', 'name="direct drive"'), "name 'direct drive': use letters, digits"),
])
def test_the_declaration_is_judged(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    path = changed(tmp_path, change)
    with pytest.raises(EmcasError, match=re.escape(says)) as refused:
        get(str(path))
    assert str(path) in str(refused.value)


def test_files_that_are_missing(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=re.escape("none.py: there is no such file")):
        get(str(tmp_path / "none.py"))
    path = changed(tmp_path)
    path.with_suffix(".toml").unlink()
    with pytest.raises(EmcasError, match=r"mine\.toml: there is no such file; it has the parameters of mine\.py"):
        get(str(path))


def test_a_parameter_without_a_value(tmp_path: Path) -> None:
    path = changed(tmp_path)
    toml = path.with_suffix(".toml")
    text = toml.read_text(encoding="utf-8")
    # A motor's resistance is also one of the default actuator, whose motor is another.
    for line, name in (("[spring]\nstiffness", "spring.stiffness"), ("\nresistance", "motor.resistance")):
        toml.write_text(text.replace(line, line.replace("\n", "\n# ")), encoding="utf-8")
        with pytest.raises(EmcasError, match=re.escape(f"{name}: missing")) as refused:
            load_parameters(model=str(path))
        assert str(toml) in str(refused.value)


def test_a_reference_that_is_missing(tmp_path: Path) -> None:
    path = changed(tmp_path, ('Path(__file__).with_name("direct_drive_reference.py")', '"nope.py"'))
    missing = f"mine.py: reference {tmp_path / 'nope.py'}: there is no such file"
    with pytest.raises(EmcasError, match=re.escape(missing)):
        files.simulator(str(path))


def test_an_extension_says_what_is_missing() -> None:
    with pytest.raises(EmcasError, match="homing needs a drive whose reference has a limit; direct-drive has none, "
                                         "nonlinear, ristanovic"):
        get(f"{FILE}+homing")


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[Path]:
    """The example as an installed package with an entry point."""
    package = tmp_path / "somebodys"
    package.mkdir()
    changed(package, ('reference=Path(__file__).with_name("direct_drive_reference.py")',
                      'files=(Path(__file__).with_suffix(".toml"),)'), name="direct.py")
    metadata = tmp_path / "somebodys-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: somebodys\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(f"[{external.GROUP}]\ndirect = somebodys.direct:ACTUATOR\n",
                                               encoding="utf-8")
    sys.path.insert(0, str(tmp_path))
    external.installed.cache_clear()
    yield package
    sys.path.remove(str(tmp_path))
    external.installed.cache_clear()
    actuators._get.cache_clear()


def test_an_installed_package_gives_an_actuator(installed: Path) -> None:
    assert get("direct").title == get(str(FILE)).title
    assert load_parameters(model="direct+faults").values["spring.stiffness"] == 20.0
    with pytest.raises(EmcasError, match="there is no actuator 'dirct'; did you mean direct"):
        get("dirct")

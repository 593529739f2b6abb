"""Errors in a user's file are reported with file, line and remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from emcas_fmu.actuators import external, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.runtime import codegen

from .example import FILE, MODEL, changed

_SPRING = "- p.spring.stiffness * x.fin_angle"
_SUPPLY = "em.Supply.voltage(inverse_inductance="
_OTHER_SUPPLY = "em.Supply({}, {}, inverse_inductance="


@pytest.mark.parametrize(("change", "line_text", "message"), [
    ((_SPRING, "- p.spring.stifness * x.fin_angle"), _SPRING, "no stifness; did you mean stiffness?"),
    ((_SPRING, "- p.spring.stiffness * x.fin_angel"), _SPRING, "no fin_angel; did you mean fin_angle?"),
    (('"motor_voltage": voltage(ops, u), ', ""), "def output_values", "output_values() returns no motor_voltage"),
    (('"motor_current": x.current', '"motor_curent": x.current'), "def output_values", "returns no motor_current"),
    (("    clipped = ops", "    if demand > 0.0: pass\n    clipped = ops"), "    clipped = ops",
     "no truth: use ops.where"),
    (("    clipped = ops", "    import math; math.sin(demand)\n    clipped = ops"), "    clipped = ops",
     "not Expr; use ops.sin"),
    (("ACTUATOR = em.Actuator(", "ACTUATOR = = Actuator("), "ACTUATOR = em.Actuator(", "invalid syntax"),
    (('State("current", "A")', 'State("fin_rate", "A")'), "ACTUATOR = em.Actuator(",
     "fin_rate is the name of two things"),
    (('State("current", "A")', 'State("the current", "A")'), None,
     "'the current': a state's name is a Python identifier in ASCII and not a keyword"),
    (("    derivatives=derivatives,\n", ""), "ACTUATOR = em.Actuator(", "has neither a step nor derivatives"),
    (('"fin_rate": torque / inertia, ', ""), "def derivatives", "derivatives() returns no fin_rate"),
    (("rise / p.motor.inductance", "rise / 0.0"), "    return {\"fin_angle\": x.fin_rate, \"fin", "division by 0"),
    (('"motor_current": x.current', '"motor_current": None'), "def output_values",
     "returns motor_current = None; return a number"),
    (('"motor_current": x.current', '"motor_current": [x.current]'), "def output_values", "return a number"),
    (('"motor_current": x.current', '"motor_current": float("nan")'), "def output_values",
     "returns motor_current = nan"),
    (("*em.FIN, ", "em.FIN[1], "), "ACTUATOR = em.Actuator(", "there is no state fin_angle; the sensors read"),
    (("    clipped = ops", "    ops.sinh(demand)\n    clipped = ops"), "    clipped = ops",
     "ops has no sinh; did you mean sin?"),
    (("    clipped = ops", "    x.integral = 0.0\n    clipped = ops"), "    clipped = ops",
     "integral cannot be set here; use a local variable"),
    (("    rise = voltage", "    u.supply = 0.0\n    rise = voltage"), "    rise = voltage",
     "supply cannot be set here"),
    (("    clipped = ops", "    demand ** 2\n    clipped = ops"), "    clipped = ops", "write ops.pow(x, y)"),
    (('State("current", "A")', 'State("replace", "A")'), None, "the name of a method of x"),
    (('"fin_rate": torque / inertia', '"fin_rte": torque / inertia'), "def derivatives",
     "derivatives() returns no fin_rate; it returns fin_rte, which is not declared; did you mean fin_rate?"),
    (('"integral": ops', '"integrl": ops'), "def sample", "returns integrl, which is not declared; did you mean "
     "integral?; declared are"),
    (('"motor_current", "A", "motor current", 10.0', '"motor_current", "A", "motor current", 0.0'),
     "ACTUATOR = em.Actuator(", "motor_current has nominal 0; declare its order of magnitude"),
    (('real_output("motor_voltage", "V"', 'real_output("motor voltage", "V"'), "ACTUATOR = em.Actuator(",
     "name 'motor voltage': use letters, digits and _"),
    (("lambda ops, p: 1.0", "lambda p: 1.0"), "    supply=em.Supply.voltage(",
     "inverse_inductance has 1 argument; write a function of (ops, p) or of (ops, p, interval)"),
    (("MOTOR_CURRENT = em.real_output(\"motor_current\"", "MOTOR_CURRENT = em.real_output(\"motor.inertia\""),
     "ACTUATOR = em.Actuator(", "motor.inertia is declared twice"),
    (('"hinge.damping", "N.m.s/rad", 0.0,', '"hinge.damping", "N.m.s/rad", 2e3,'), "ACTUATOR = em.Actuator(",
     "hinge.damping has a minimum 2000 above its maximum 1000"),
    ((_SUPPLY, _OTHER_SUPPLY.format('em.real_input("supply_heat", "K", "heat")', "MOTOR_VOLTAGE")), "    supply=",
     "supply supply_heat [K]: a supply is a voltage [V] or a pressure [Pa]"),
    ((_SUPPLY, _OTHER_SUPPLY.format('em.real_input("supply_voltage", "V", "")', "MOTOR_VOLTAGE")), "    supply=",
     "declare supply_power [W]"),
    (("outputs=(MOTOR_CURRENT,", 'outputs=(em.real_output("fin_angle", "deg", "angle", 1.0), MOTOR_CURRENT,'),
     "ACTUATOR = em.Actuator(", "fin_angle of the fin port is Real [rad], not Real [deg]; "
     "leave yours out, or rename it"),
    (("parameters=PARAMETERS", 'parameters=(*PARAMETERS, em.parameter("mass.fin", "g", 0.0, 1e6, ""))'),
     "ACTUATOR = em.Actuator(", "mass.fin of the fin port is Real [kg], not Real [g]"),
    (("controller_states=(em.State(\"integral\", \"V\"),)", 'controller_states=(em.State("integral", "V"))'),
     "ACTUATOR = em.Actuator(", "controller_states is not a list; write a comma after a single entry"),
    (("def derivatives(ops, p, x, u)", "def derivatives(ops, p, x)"), "ACTUATOR = em.Actuator(",
     "derivatives() in line 62 has the arguments (ops, p, x); it is called with (ops, p, x, u)"),
    (("def sample(ops, p, x, inputs)", "def sample(ops, p, x)"), "ACTUATOR = em.Actuator(",
     "sample() in line 44 has the arguments (ops, p, x); it is called with (ops, p, x, inputs)"),
    (("def output_values(ops, p, x, u)", "def output_values(ops, p, x, u, y)"), "ACTUATOR = em.Actuator(",
     "output_values() in line 72 has the arguments (ops, p, x, u, y); it is called with (ops, p, x, u)"),
    (("    sample=sample,", "    initial=lambda ops, p: {}, sample=sample,"), "ACTUATOR = em.Actuator(",
     "<lambda>() in line 88 has the arguments (ops, p); it is called with (ops, p, start)"),
    (("    sample=sample,", '    discontinuities=(em.Coulomb("rub", "fin_rate", "hinge.damp"),), sample=sample,'),
     "ACTUATOR = em.Actuator(", "Coulomb rub: torque 'hinge.damp' is not a parameter; did you mean hinge.damping?"),
    (("    sample=sample,", '    discontinuities=(em.Limit("v", 1.0, lambda ops, p: 2.0),), sample=sample,'),
     "ACTUATOR = em.Actuator(", "Limit v, high: <lambda>() in line 88 has the arguments (ops, p); it is called with "
     "(ops, p, x, u)"),
    (("    sample=sample,", '    rules=em.rising("x", 2), sample=sample,'), "ACTUATOR = em.Actuator(",
     "rules is not a list; write a comma"),
    (("parameters=PARAMETERS", 'parameters=(*PARAMETERS, em.array("x", 2, "m", 0.0, 1.0, ""))'),
     "ACTUATOR = em.Actuator(", "an entry of parameters is a list; write * before it"),
    (("states=(*em.FIN", "states=(em.FIN"), "ACTUATOR = em.Actuator(", "an entry of states is a list"),
    (("em.capabilities.POSITION_LOOP}", "'a curent loop'}"), "ACTUATOR = em.Actuator(",
     "did you mean a current loop?"),
    (("em.capabilities.POSITION_LOOP}", "em.capabilities.CURRENT_LIMIT}"), "ACTUATOR = em.Actuator(",
     "which needs drive.current_limit"),
])
def test_error_names_file_and_line(tmp_path: Path, change: tuple[str, str], line_text: str | None, message: str
                                   ) -> None:
    path = changed(tmp_path, change)
    with pytest.raises(EmcasError, match=re.escape(message)) as refused:
        codegen.traced(model=str(path))
    named = re.match(re.escape(f"{path}, line ") + r"(\d+)", str(refused.value))
    assert named
    if line_text is not None:
        lines = FILE.read_text(encoding="utf-8").splitlines()
        expected = next(i for i, line in enumerate(lines, 1) if line_text in line)
        assert int(named[1]) == expected


_ARRAY = (("PARAMETERS = (", 'PARAMETERS = (*em.array("spring.torque", 3, "N.m", 0.0, 1.0, "torque"),'),
          ("ESTIMATES = {", 'ESTIMATES = {**{f"spring.torque[{i}]": 0.0 for i in range(3)}, '))


@pytest.mark.parametrize(("expression", "remedy"), [
    ("p.spring.torque[7]", "p.spring.torque has fewer values, counted from 0"),
    ("x[0]", "parameters, states and inputs have names, as in p.motor.resistance and x.fin_angle"),
    ("x['fin_angle']", "write x.fin_angle"),
    ("p['spring.stiffness']", "write p.spring.stiffness"),
    ("demand % 2.0", "write x - y * ops.floor(x / y)"),
    ("demand // 2.0", "write ops.floor(x / y)"),
    ("2.0 ** demand", "write ops.pow(x, y)"),
    ("int(demand)", "write ops.floor(x)"),
    ("float(demand)", "leave float() out"),
    ("round(demand)", "write ops.floor(x + 0.5)"),
    ("[1.0, 2.0][demand]", "choose between values by ops.where"),
    ("range(demand)", "a loop needs a fixed number"),
    ("np.interp(demand, [0.0, 1.0], [0.0, 2.0])", "use ops.interp"),
    ("np.clip(demand, -1.0, 1.0)", "use ops.clip"),
    ("np.abs(demand)", "use ops.fabs"),
    ("np.sin(demand)", "use ops.sin"),
    ("max(demand, 0.0)", "use ops.maximum"),
    ("math.atan2(demand, 1.0)", "use ops.atan2"),
    ("math.erf(demand)", "use functions of ops, as in ops.sin(x)"),
])
def test_error_has_the_fitting_remedy(tmp_path: Path, expression: str, remedy: str) -> None:
    path = changed(tmp_path, ("    clipped = ops", f"    {expression}\n    clipped = ops"),
                   ("from pathlib", "import math\n\nimport numpy as np\nfrom pathlib"), *_ARRAY)
    with pytest.raises(EmcasError, match=r"line \d+: (Type|Index)Error: .*" + re.escape(remedy)):
        codegen.traced(model=str(path))


@pytest.mark.parametrize(("before", "after", "name"), [
    ("    clipped = ops", "    while True: pass\n    clipped = ops", "sample"),
    ("    clipped = ops", "    while True:\n        try: x.integral\n        except Exception: pass\n    clipped = ops",
     "sample"),
    ("ESTIMATES = {", "while True: pass\nESTIMATES = {", "<module>"),
])
def test_an_endless_loop_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str, name: str
                                    ) -> None:
    monkeypatch.setattr(external, "LONGEST_IMPORT", 0.5)
    path = changed(tmp_path, (before, after))
    lines = path.read_text(encoding="utf-8").splitlines()
    loop = next(i for i, line in enumerate(lines, 1) if "while True" in line)
    with pytest.raises(EmcasError, match=rf"mine\.py, line \d+: {name} has not ended in 0\.5 s; a loop needs") as ended:
        codegen.traced(model=str(path))
    assert 0 <= int(re.findall(r", line (\d+)", str(ended.value))[0]) - loop <= 2


def test_a_negative_delay_is_refused(tmp_path: Path) -> None:
    path = changed(tmp_path, ("    sample=sample,", "    transport_delay=lambda ops, p: -0.001,\n    sample=sample,"))
    with pytest.raises(ParameterError, match=r"py: transport_delay\(ops, p\) = -0\.001 s must be at least 0"):
        load_parameters(model=str(path))


def test_degrees_instead_of_radians_are_recognised(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = changed(tmp_path, ("PARAMETERS = (", 'PARAMETERS = (em.parameter("lock.angle", "rad", 0.0, 25.0, ""),'))
    get(str(path))
    assert "lock.angle may be up to 25 rad, 1432 deg; if 25 deg is meant, write radians(25)" in caplog.text
    with pytest.raises(ParameterError, match=r"fin\.stop_angle = 25\.0 rad: is 25 rad; .* did you mean 25 deg\?"):
        load_parameters(model=MODEL).with_values({"fin.stop_angle": 25.0})


def test_a_rule_with_a_condition_on_a_value_is_refused_during_tracing(tmp_path: Path) -> None:
    """Parameters are checked with numbers, for which the rule works."""
    path = changed(tmp_path, ("ACTUATOR = em.Actuator(", '''from emcas_fmu.rules import Rule


def within(ops, p, share):
    return (1.0 if share * p.spring.stiffness > 900.0 else -1.0), share


ACTUATOR = em.Actuator(
    rules=(Rule(within, "too stiff at %.6g of the travel", True),),'''))
    sound = load_parameters(model=str(path))
    with pytest.raises(ParameterError, match=r"too stiff at 0\.91 of the travel"):
        sound.with_values({"spring.stiffness": 1000.0})
    with pytest.raises(EmcasError, match=r", line \d+: TypeError: a traced value has no truth: use ops\.where"):
        codegen.traced_rules(sound.model)


@pytest.mark.parametrize(("check", "message"), [
    ("lambda ops, p, _: (p.spring.stifness, 1.0)", ", line 88: AttributeError: there is no stifness; did you mean"),
    ("lambda p: (1.0, 1.0)", ", line 77: actuator direct-drive, rule 'at %g': <lambda>() in line 88 has the arguments "
     "(p); it is called with (ops, p, share)"),
])
def test_error_of_a_rule_names_its_line(tmp_path: Path, check: str, message: str) -> None:
    path = changed(tmp_path, ("    sample=sample,", f'    rules=(em.rule("at %g")({check}),),\n    sample=sample,'))
    with pytest.raises(EmcasError, match=re.escape(f"{path}{message}")):
        load_parameters(model=str(path))


@pytest.mark.parametrize(("change", "message"), [
    (("ACTUATOR = ", "MINE = "), ": defines no ACTUATOR"),
    (('"N.m/rad", 0.0', '"N.m/rod", 0.0'), "spring.stiffness: unknown unit 'N.m/rod'; did you mean rad?"),
    (('State("current", "A")', 'State("current", "Amp")'), "current: unknown unit 'Amp'"),
    (("*em.FIN, ", '*em.FIN[:1], em.State("fin_rate", "rod/s"), '),
     "fin_rate: unknown unit 'rod/s'; did you mean rad?"),
    (('"N.m/rad", 0.0', '"N.mm/rad", 0.0'), "spring.stiffness: N.mm/rad is 0.001 times the SI unit"),
    (('real_output("motor_current", "A"', 'real_output("motor_current", "mA"'), "motor_current: mA is 0.001 times"),
    (('State("current", "A")', 'State("current", "mA")'), "current: mA is 0.001 times the SI unit, in which equations"),
    (('name="direct-drive"', 'name="elastic"'), "name 'elastic' is that of a shipped actuator or extension"),
    (('name="direct-drive"', 'name="direct drive"'), "name 'direct drive': use letters, digits"),
])
def test_wrong_declarations_are_refused(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = changed(tmp_path, change)
    line = next((i for i, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if change[1] in text))
    line_text = f"{path}{message}" if message.startswith(": ") else f"{path}, line {line}: {message}"
    with pytest.raises(EmcasError, match=re.escape(line_text)):
        get(str(path))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=re.escape("none.py: there is no such file")):
        get(str(tmp_path / "none.py"))


def test_a_parameter_without_a_value_is_refused(tmp_path: Path) -> None:
    """Values of the default actuator are not used for parameters of the same name.

    The error names the line of the declaration; the inertia is declared by the fin port.
    """
    for name, value, line in (("spring.stiffness", "20 N*m/rad", ", line 21"),
                              ("motor.resistance", "0.5 Ohm", ", line 25"),
                              ("inertia.fin", "0.05 kg*m^2", "")):
        path = changed(tmp_path, (f'"{name}": "{value}",', ""), name=f"{name[0]}.py")
        with pytest.raises(EmcasError, match=re.escape(f"{path}{line}: {name}: missing")):
            load_parameters(model=str(path))


def test_a_parameter_file_beside_the_actuator_overrides_declared_values(tmp_path: Path) -> None:
    path = changed(tmp_path)
    path.with_suffix(".toml").write_text(
        '[spring]\nstiffness = { value = 30, unit = "N*m/rad", source = "datasheet" }\n', encoding="utf-8")
    found = {e.variable.name: e for e in load_parameters(model=str(path)).entries}
    assert (found["spring.stiffness"].value, found["spring.stiffness"].source) == (30.0, "datasheet")
    assert (found["hinge.damping"].value, found["hinge.damping"].source) == (0.2, "estimate")
    # Shaft and fork have no mass and inertia unless they are declared.
    assert (found["mass.shaft"].value, found["inertia.fork"].value, found["mass.fin"].value) == (0.0, 0.0, 3.0)


def test_a_missing_reference_is_refused(tmp_path: Path) -> None:
    path = changed(tmp_path, ('Path(__file__).with_name("direct_drive_reference.py")', '"nope.py"'))
    missing = f"mine.py: reference {tmp_path / 'nope.py'}: there is no such file"
    with pytest.raises(EmcasError, match=re.escape(missing)):
        files.simulator(str(path))


def test_an_extension_names_missing_capabilities_and_variables() -> None:
    with pytest.raises(EmcasError, match=re.escape(
            "homing needs a drive whose analogue reference has a limit, an incremental encoder on motor or fin, a "
            "motor current that follows from winding parameters; let direct-drive provide em.capabilities."
            "REFERENCE_LIMIT, em.capabilities.ENCODER, em.capabilities.MOTOR_CURRENT and declare "
            "drive.reference_limit, encoder.pulses, encoder.multiplier, encoder.enabled, "
            "state counts, or choose nonlinear, ristanovic")):
        get(f"{FILE}+homing")


def test_an_actuator_of_an_installed_package_is_found(installed: Path) -> None:
    assert get("direct").title == get(str(FILE)).title
    assert load_parameters(model="direct+faults").values["spring.stiffness"] == 20.0
    with pytest.raises(EmcasError, match="there is no actuator 'dirct'; did you mean direct"):
        get("dirct")

"""What `emcas ssp check` finds in archives that were right, with one thing spoilt."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.bench.writers import write_json
from emcas_fmu.errors import EmcasError
from emcas_fmu.ssp.archive import SSC, SSD, SSV, SspError, read_archive, write_archive
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.structure import Signal, read_variant

from .conftest import Edit

STRUCTURE = "SystemStructure.ssd"
COMMAND = 'startConnector="fin1_fin_command" endElement="fin1" endConnector="fin_command"'
ROLL = 'startConnector="attitude_roll" endElement="fin1" endConnector="attitude.roll"'
FED = 'startElement="fin2" startConnector="fin_angle" endElement="fin1" endConnector="fin_command"'


def test_what_is_written_passes(ssp: Path, wired: Path) -> None:
    report = check(ssp)
    assert report.findings == ()
    assert report.variants == ("nominal", "cold", "degraded")
    assert report.connections == 0
    report = check(wired)
    assert report.connections == 3 * 4 * 32
    assert report.errors == []
    assert [w.file for w in report.warnings] == ["SystemStructure.ssd", "cold.ssd", "degraded.ssd"]
    assert all("with which libcosim and Ecos refuse the file" in w.message for w in report.warnings)


@pytest.mark.parametrize(("old", "new", "place", "expected"), [
    (COMMAND, COMMAND.replace('"fin_command"', '"fin_comand"'), "connection fin1_fin_command -> fin1.fin_comand",
     "there is no connector fin1.fin_comand; did you mean fin1.fin_command?"),
    (COMMAND, COMMAND.replace("fin1_fin_command", "fin1_command"), "connection fin1_command -> fin1.fin_command",
     "there is no connector fin1_command; did you mean fin1_fin_command?"),
    (COMMAND, COMMAND.replace('"fin1"', '"fin"'), "connection fin1_fin_command -> fin.fin_command",
     "there is no connector fin.fin_command; did you mean fin"),
    (ROLL, ROLL.replace('"attitude_roll" endE', '"supply_voltage" endE'),
     "connection supply_voltage -> fin1.attitude.roll",
     "supply_voltage is in V, but fin1.attitude.roll is in rad; use a quantity in rad"),
    (ROLL, ROLL.replace('"attitude_roll" endE', '"enable" endE'), "connection enable -> fin1.attitude.roll",
     "enable is Boolean, but fin1.attitude.roll is Real"),
    (COMMAND, FED.replace('"fin_angle"', '"fin_command"'), "connection fin2.fin_command -> fin1.fin_command",
     "both ends are inputs"),
    (ROLL, COMMAND, "connection fin1_fin_command -> fin1.fin_command", "fin1.fin_command is fed twice"),
    ('name="attitude.roll" kind="input" description="vehicle roll angle, for gravity"><ssc:Real unit="rad"',
     'name="attitude.roll" kind="input" description=""><ssc:Real unit="V"', "connector fin1.attitude.roll",
     "is in V, but the FMU's variable is in rad"),
    ('name="enable" kind="input"', 'name="enable" kind="output"', "connector fin1.enable",
     'is declared output, but is input in the FMU; write kind="input"'),
    ('source="resources/EMCAS.fmu"', 'source="resources/EMCS.fmu"', "component fin1",
     "the archive has no .fmu file resources/EMCS.fmu; did you mean resources/EMCAS.fmu?"),
    ('source="resources/nominal_fin1.ssv"', 'source="cold.ssd"', "parameter binding fin1",
     "the archive has no .ssv file cold.ssd"),
    ('source="resources/nominal_fin1.ssv"', 'source="resources/fin1.ssv"', "parameter binding fin1",
     "the archive has no .ssv file resources/fin1.ssv; did you mean resources/"),
    ('kind="input"', 'kind="inlet"', "", "[facet 'enumeration'] The value 'inlet' is not an element of the set"),
    ('version="1.0" name="nominal"', 'version="one" name="nominal"', "",
     "The value 'one' is not accepted by the pattern"),
    ("</ssd:System>", "", "", "is not XML"),
    ('.fmu" guid="{', '.fmu" guid="{0', "component fin1", "the archive was written for {0"),
])
def test_errors(edited: Edit, old: str, new: str, place: str, expected: str) -> None:
    errors = check(edited(STRUCTURE, old, new)).errors
    found = [e for e in errors if e.place == place and expected in str(e)]
    assert found, "\n".join(map(str, errors))
    assert found[0].file == STRUCTURE
    assert found[0].remedy


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('name="motor.resistance"', 'name="motor.resistence"', "parameter motor.resistence: the FMU has no such "
     "variable; did you mean motor.resistance?"),
    ('name="motor.resistance"', 'name="fin_angle"', "parameter fin_angle: is output in the FMU and cannot be set"),
    ('value="0.25" unit="Ohm"', 'value="-1" unit="Ohm"', "parameter motor.resistance: is -1 Ohm, outside 1e-06 .. "
     "10000; write a value within the limits"),
    ('value="0.25" unit="Ohm"', 'value="0.25" unit="V"', "is in V, but the FMU's variable is in Ohm; use a "
     "quantity in Ohm"),
    ('value="0.25" unit="Ohm"', 'value="a" unit="Ohm"', "'a' is not a valid value of the atomic type 'xs:double'"),
    ('<ssv:Integer value="2048"', '<ssv:Real value="2048"', "parameter encoder.pulses: is Real, but the FMU's "
     "variable is Integer; make it Integer"),
    # Of itself within its limits; only with another it makes no sense.
    ('value="0.4363323129985824" unit="rad"', 'value="0.2" unit="rad"', "component fin1: fin.stop_angle = 0.2 rad"),
])
def test_errors_in_parameters(edited: Edit, old: str, new: str, expected: str) -> None:
    errors = check(edited("resources/nominal_fin1.ssv", old, new)).errors
    assert any(expected in str(e) for e in errors), "\n".join(map(str, errors))


def test_a_unit_without_a_definition_is_no_excuse(edited: Edit) -> None:
    text = 'name="fin1_fin_command" kind="input" description="commanded fin angle; clipped to +-command.limit">'
    spoilt = edited(STRUCTURE, f'{text}<ssc:Real unit="rad"', f'{text}<ssc:Real unit="deg"')
    said = "fin1_fin_command is in deg, but fin1.fin_command is in rad; multiply by 0.0174532925199 and add 0"
    assert any(said in str(e) for e in check(spoilt).errors)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('value="39.0" unit="V"', 'value="39000" unit="mV"',
     "supply_voltage: is in mV, but the FMU's variable is in V"),
    ('value="39.0" unit="V"', 'value="-39" unit="V"', "supply_voltage: is -39 V, outside 0 .. 1000"),
    ('<ssv:Real value="39.0" unit="V"', '<ssv:String value="much"',
     "supply_voltage: is String, but the FMU's variable is Real"),
])
def test_errors_in_the_systems_own_inputs(edited: Edit, old: str, new: str, expected: str) -> None:
    """A connector of the system is judged by the variable it is wired to."""
    errors = check(edited("resources/nominal_system.ssv", old, new)).errors
    assert any(expected in str(e) for e in errors), "\n".join(map(str, errors))


def test_value_in_another_unit_is_converted_in_the_remedy(edited: Edit) -> None:
    spoilt = edited("resources/nominal_fin1.ssv", 'value="0.7853981633974483" unit="rad"', 'value="45" unit="deg"',
                    '<ssv:Units>', '<ssv:Units><ssc:Unit name="deg">'
                    '<ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>')
    (error,) = {str(e) for e in check(spoilt).errors}
    assert error.endswith("is in deg, but the FMU's variable is in rad; write 0.785398163397 rad: no host "
                          "converts")


@pytest.mark.parametrize(("new", "expected"), [
    ("", "fin1_fin_command is in deg, but fin1.fin_command is in rad; multiply by 0.0174532925199 and add 0 where it "
     "is computed: no host converts"),
    ('factor="0.017453292519943295"', "connection fin1_fin_command -> fin1.fin_command: is of a form that emcas does "
     "not read; have only FMUs in one system, connected without transformation"),
])
def test_another_unit_at_a_connection(edited: Edit, new: str, expected: str) -> None:
    wiring = f'<ssd:Connection {COMMAND}/>'
    changed = wiring if not new else wiring[:-2] + f"><ssc:LinearTransformation {new}/></ssd:Connection>"
    text = ('name="fin1_fin_command" kind="input" description="commanded fin angle; clipped to +-command.limit">'
            '<ssc:Real unit="rad"')
    spoilt = edited(STRUCTURE, wiring, changed, text, text.replace("rad", "deg"), '<ssd:Units>',
                    '<ssd:Units><ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>')
    found = check(spoilt).findings
    assert [f.level for f in found if expected in str(f)] == ["error"], "\n".join(map(str, found))


def test_what_tools_add_to_an_archive_is_no_problem(edited: Edit) -> None:
    """The line that an editor draws for a connection, and annotations, change nothing that is computed."""
    wiring, binding = f"<ssd:Connection {COMMAND}/>", '<ssd:ParameterBinding source="resources/nominal_fin1.ssv"/>'
    note = '<ssd:Annotations><ssc:Annotation type="org.example"/></ssd:Annotations>'
    geometry = '<ssd:ConnectionGeometry pointsX="0 1" pointsY="0 1"/>'
    drawn = edited(STRUCTURE, wiring, f"{wiring[:-2]}>{geometry}</ssd:Connection>")
    assert check(drawn).errors == []
    noted = edited(STRUCTURE, wiring, f"{wiring[:-2]}>{note}</ssd:Connection>",
                   binding, f"{binding[:-2]}>{note}</ssd:ParameterBinding>")
    assert check(noted).errors == []


def test_warnings(edited: Edit) -> None:
    """An input without a wire where others have one, and what a host is known not to read."""
    unwired = check(edited(STRUCTURE, f"<ssd:Connection {ROLL}/>", ""))
    assert unwired.errors == []
    assert any("input fin1.attitude.roll: is not wired, while others are" in str(f) for f in unwired.findings)
    backwards = 'startElement="fin1" startConnector="fin_command" endConnector="fin1_fin_command"'
    turned = check(edited(STRUCTURE, COMMAND, backwards))
    assert any("runs from its end to its start" in str(f) for f in turned.findings)


def test_a_boolean_that_is_false(edited: Edit) -> None:
    """It is what fmpy is known not to read."""
    report = check(edited("resources/nominal_fin1.ssv", "</ssv:Parameters>", '<ssv:Parameter name="encoder.on_fin">'
                          '<ssv:Boolean value="false"/></ssv:Parameter></ssv:Parameters>'))
    assert report.errors == []
    assert any("parameter encoder.on_fin: is false, which fmpy's" in str(w) for w in report.warnings)


def test_another_fmu(ssp: Path, native: Path, fmu: Path, tmp_path: Path) -> None:
    """The two back ends have one interface, hence one GUID; another interface has another."""
    assert check(ssp, fmu=native).findings == check(ssp, fmu=fmu).findings == ()
    wanted = "{00000000-0000-0000-0000-000000000000}"
    error = check(ssp, guid=wanted).errors[0]
    assert error.place == "component fin1"
    assert f"required is {wanted}; replace it by that FMU, or write a new archive" in str(error)
    with pytest.raises(EmcasError, match="is not an FMU"):
        check(ssp, fmu=Path(__file__))
    contents = read_archive(ssp)
    with zipfile.ZipFile(tmp_path / "other.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription fmiVersion='2.0' guid='x' modelName='m'/>")
    contents["resources/EMCAS.fmu"] = (tmp_path / "other.fmu").read_bytes()
    write_archive(contents, tmp_path / "other.ssp")
    messages = [str(e) for e in check(tmp_path / "other.ssp").errors]
    assert any("fin_command -> fin1.fin_command: the FMU of fin1 has no variable 'fin_command'" in m or
               "resources/EMCAS.fmu" in m for m in messages)


OWN = f"""<ssd:SystemStructureDescription xmlns:ssd="{SSD}" xmlns:ssc="{SSC}" xmlns:ssv="{SSV}"
version="1.0" name="mine"><ssd:System name="tail">
<ssd:Connectors><ssd:Connector name="left" kind="input"><ssc:Real unit="deg"/></ssd:Connector></ssd:Connectors>
<ssd:Elements><ssd:Component name="fin" source="resources/EMCAS.fmu"><ssd:Connectors>
<ssd:Connector name="fin_command" kind="input"><ssc:Real unit="rad"/></ssd:Connector></ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding source="own.ssv"/></ssd:ParameterBindings></ssd:Component>
</ssd:Elements><ssd:Connections>
<ssd:Connection startConnector="left" endElement="fin" endConnector="fin_command"/></ssd:Connections></ssd:System>
<ssd:Units><ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.0174532925199433"/></ssc:Unit>
<ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit></ssd:Units></ssd:SystemStructureDescription>"""
OWN_SET = f"""<ssv:ParameterSet xmlns:ssv="{SSV}" version="1.0" name="own"><ssv:Parameters>
<ssv:Parameter name="motor.resistance"><ssv:Real value="0.3"/></ssv:Parameter>
<ssv:Parameter name="motor.hue"><ssv:Real value="1"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>"""


def own(native: Path, path: Path, *pairs: str) -> Path:
    """Somebody's own archive, with texts of its structure replaced."""
    text = OWN
    for old, new in zip(pairs[::2], pairs[1::2]):
        assert old in text, old
        text = text.replace(old, new)
    write_archive({STRUCTURE: text.encode(), "own.ssv": OWN_SET.encode(),
                   "resources/EMCAS.fmu": native.read_bytes()}, path)
    return path


def test_somebodys_own_archive(native: Path, tmp_path: Path) -> None:
    """Of other names and one component, without a record of the FMU."""
    report = check(own(native, tmp_path / "mine.ssp"))
    assert {f"{e.place}: {e.message}" for e in report.errors} == {
        "connection left -> fin.fin_command: left is in deg, but fin.fin_command is in rad",
        "parameter motor.hue: the FMU has no such variable"}
    warned = {w.place for w in report.warnings}
    assert "input fin.enable" in warned
    assert "input fin.fin_command" not in warned


@pytest.mark.parametrize(("old", "new", "place"), [
    ('<ssd:Component name="fin" source="resources/EMCAS.fmu">', '<ssd:System name="inner"/><ssd:Component name="fin" '
     'source="resources/EMCAS.fmu">', "system inner"),
    ('<ssd:Component name="fin" source="resources/EMCAS.fmu">', '<ssd:SignalDictionaryReference name="bus" '
     'dictionary="d"/><ssd:Component name="fin" source="resources/EMCAS.fmu">', "signal dictionary reference bus"),
    ('name="fin" source', 'type="application/x-ssp-package" name="fin" source', "component fin"),
    ('source="own.ssv"', 'source="own.ssv" prefix="x."', "parameter binding fin"),
    ('<ssd:ParameterBinding source="own.ssv"/>', f"<ssd:ParameterBinding><ssd:ParameterValues>{OWN_SET}"
     "</ssd:ParameterValues></ssd:ParameterBinding>", "parameter binding fin"),
])
def test_what_is_not_read_is_refused(native: Path, tmp_path: Path, old: str, new: str, place: str) -> None:
    """What SSP allows, and the archives of this package do not use; nothing else of the structure is checked."""
    report = check(own(native, tmp_path / "mine.ssp", old, new))
    (error,) = report.errors
    assert error.place == place
    assert error.message == "is of a form that emcas does not read"
    assert "only FMUs in one system" in error.remedy
    assert (report.unchecked, report.connections, report.parameters) == ((STRUCTURE,), 0, 0)
    with pytest.raises(SspError, match="see emcas ssp check"):
        read_variant(tmp_path / "mine.ssp", "mine")


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("</ssd:Elements>", '<ssd:Component name="fin" source="resources/EMCAS.fmu"/></ssd:Elements>', "component fin: is"),
    ('<ssd:Connector name="fin_command"', '<ssd:Connector '
     'name="fin_command" kind="input"/><ssd:Connector name="fin_command"', "connector fin.fin_command: is"),
])
def test_a_name_twice(native: Path, tmp_path: Path, old: str, new: str, expected: str) -> None:
    (error,) = check(own(native, tmp_path / "mine.ssp", old, new)).errors
    assert f"{expected} declared twice; rename one of them" in str(error)


def test_an_end_that_the_fmu_has_and_the_component_does_not_declare(native: Path, tmp_path: Path) -> None:
    path = own(native, tmp_path / "mine.ssp", '<ssd:Connector name="fin_command"', '<ssd:Connector name="fin_rate"')
    assert any("there is no connector fin.fin_command; declare it in the Connectors of its component" in str(e)
               for e in check(path).errors)


def test_the_same_connection_twice(edited: Edit) -> None:
    spoilt = edited(STRUCTURE, f"<ssd:Connection {COMMAND}/>", f"<ssd:Connection {COMMAND}/>" * 2)
    assert "fin1.fin_command is fed twice, first by fin1_fin_command ->" in str(check(spoilt).errors[0])


def test_a_declared_connector_that_nothing_is_wired_to(native: Path, tmp_path: Path) -> None:
    path = own(native, tmp_path / "mine.ssp", '<ssd:Connector name="fin_command"', '<ssd:Connector name="fin_angel" '
               'kind="output"/><ssd:Connector name="fin_command"')
    assert any("connector fin.fin_angel: the FMU has no such variable; did you mean fin_angle?" in str(e)
               for e in check(path).errors)


def test_a_set_of_a_component_at_the_system(edited: Edit) -> None:
    spoilt = edited(STRUCTURE, 'source="resources/nominal_system.ssv"', 'source="resources/nominal_fin1.ssv"')
    assert any("parameter motor.resistance: is not a connector of the system" in str(e) for e in check(spoilt).errors)


def test_json(edited: Edit, tmp_path: Path) -> None:
    spoilt = edited(STRUCTURE, COMMAND, COMMAND.replace('"fin_command"', '"fin_comand"'))
    write_json(check(spoilt).document(), tmp_path / "f.json")
    found = json.loads((tmp_path / "f.json").read_text())
    assert found["passed"] is False
    (first,) = (f for f in found["findings"] if f["place"] == "connection fin1_fin_command -> fin1.fin_comand")
    assert set(first) == {"level", "file", "place", "message", "remedy"}


def test_files_that_are_no_archive(tmp_path: Path) -> None:
    for name, content in (("empty.ssp", b""), ("text.ssp", b"hello")):
        (tmp_path / name).write_bytes(content)
        report = check(tmp_path / name)
        assert "is not a ZIP archive" in str(report.errors[0])
        assert report.unchecked == (name,)
    write_archive({"readme.txt": b""}, tmp_path / "other.ssp")
    report = check(tmp_path / "other.ssp")
    assert "has no SystemStructure.ssd at its root" in str(report.errors[0])
    assert report.unchecked == (STRUCTURE,)
    with pytest.raises(EmcasError, match="cannot be read"):
        check(tmp_path / "none.ssp")


@pytest.mark.slow
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_told_and_never_raised(ssp: Path, tmp_path: Path, data: st.DataObject) -> None:
    """Bytes of the archive, or characters of its structure, overwritten at random."""
    if data.draw(st.booleans()):
        content = bytearray(ssp.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        (tmp_path / "damaged.ssp").write_bytes(content)
    else:
        contents = read_archive(ssp)
        name = data.draw(st.sampled_from([STRUCTURE, "resources/nominal_fin1.ssv"]))
        text = contents[name]
        at = data.draw(st.integers(0, len(text) - 1))
        contents[name] = text[:at] + data.draw(st.binary(max_size=6)) + text[at + data.draw(st.integers(0, 6)):]
        write_archive(contents, tmp_path / "damaged.ssp")
    for finding in check(tmp_path / "damaged.ssp").findings:
        assert str(finding)


def test_units() -> None:
    """By their names, as the package knows them: two names of one unit are the same."""
    def real(unit: str, kind: str = "output", value: float | None = None) -> Signal:
        return Signal("x", kind, "Real", unit, value)

    assert real("N.m").mismatch(real("N*m"), "y") is None
    assert real("").mismatch(real("V"), "y") is None
    assert real("furlong").mismatch(real("furlong"), "y") is None
    assert real("furlong").mismatch(real("m"), "y") == ("is in furlong, but y is in m", "use a quantity in m")
    assert real("degC", "", -6.0).mismatch(real("K"), "y") == (
        "is in degC, but y is in K", "write 267.15 K: no host converts")

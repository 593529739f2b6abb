"""Findings of `emcas ssp check` in archives with one mistake each."""

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

from .conftest import Edit, replaced

STRUCTURE = "SystemStructure.ssd"
COMMAND = 'startConnector="fin1_fin_command" endElement="fin1" endConnector="fin_command"'
ROLL = 'startConnector="attitude_roll" endElement="fin1" endConnector="attitude.roll"'
FED = 'startElement="fin2" startConnector="fin_angle" endElement="fin1" endConnector="fin_command"'


def test_written_archives_have_no_errors(ssp: Path, wired_ssp: Path) -> None:
    report = check(ssp)
    assert report.findings == ()
    assert report.variants == ("nominal", "cold", "degraded")
    assert report.connections == 0
    report = check(wired_ssp)
    assert report.connections == 3 * 4 * 32
    assert report.errors == []
    assert [w.file for w in report.warnings] == ["SystemStructure.ssd", "cold.ssd", "degraded.ssd"]
    assert all("with which libcosim and Ecos refuse the file" in w.message for w in report.warnings)


@pytest.mark.parametrize(("old", "new", "location", "expected"), [
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
def test_error_has_its_location_and_a_remedy(edit: Edit, old: str, new: str, location: str, expected: str) -> None:
    errors = check(edit(STRUCTURE, old, new)).errors
    found = [e for e in errors if e.place == location and expected in str(e)]
    assert found, "\n".join(map(str, errors))
    assert found[0].file == STRUCTURE
    assert found[0].remedy


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('name="motor.resistance"', 'name="motor.resistence"', "parameter motor.resistence: the FMU has no such "
     "variable; did you mean motor.resistance?"),
    ('name="motor.resistance"', 'name="fin_angle"', "parameter fin_angle: is output in the FMU and cannot be set"),
    ('value="0.25" unit="Ohm"', 'value="-1" unit="Ohm"', "parameter motor.resistance: is -1 Ohm, outside 0.0001 .. "
     "10000; write a value within the limits"),
    ('value="0.25" unit="Ohm"', 'value="0.25" unit="V"', "is in V, but the FMU's variable is in Ohm; use a "
     "quantity in Ohm"),
    ('value="0.25" unit="Ohm"', 'value="a" unit="Ohm"', "'a' is not a valid value of the atomic type 'xs:double'"),
    ('<ssv:Integer value="2048"', '<ssv:Real value="2048"', "parameter encoder.pulses: is Real, but the FMU's "
     "variable is Integer; make it Integer"),
    # Within the parameter's limits, but below `command.limit`.
    ('value="0.4363323129985824" unit="rad"', 'value="0.2" unit="rad"', "component fin1: fin.stop_angle = 0.2 rad"),
])
def test_errors_in_parameters(edit: Edit, old: str, new: str, expected: str) -> None:
    errors = check(edit("resources/nominal_fin1.ssv", old, new)).errors
    assert any(expected in str(e) for e in errors), "\n".join(map(str, errors))


def test_wrong_unit_without_a_definition_is_an_error(edit: Edit) -> None:
    text = 'name="fin1_fin_command" kind="input" description="commanded fin angle; clipped to +-command.limit">'
    changed = edit(STRUCTURE, f'{text}<ssc:Real unit="rad"', f'{text}<ssc:Real unit="deg"')
    message = "fin1_fin_command is in deg, but fin1.fin_command is in rad; multiply by 0.0174532925199 and add 0"
    assert any(message in str(e) for e in check(changed).errors)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('value="39.0" unit="V"', 'value="39000" unit="mV"',
     "supply_voltage: is in mV, but the FMU's variable is in V"),
    ('value="39.0" unit="V"', 'value="-39" unit="V"', "supply_voltage: is -39 V, outside 0 .. 1000"),
    ('<ssv:Real value="39.0" unit="V"', '<ssv:String value="much"',
     "supply_voltage: is String, but the FMU's variable is Real"),
])
def test_errors_in_start_values_of_the_systems_connectors(edit: Edit, old: str, new: str, expected: str) -> None:
    """Type, unit and limits are those of the variable to which the connector is wired."""
    errors = check(edit("resources/nominal_system.ssv", old, new)).errors
    assert any(expected in str(e) for e in errors), "\n".join(map(str, errors))


def test_remedy_converts_a_value_in_another_unit(edit: Edit) -> None:
    changed = edit("resources/nominal_fin1.ssv", 'value="0.7853981633974483" unit="rad"', 'value="45" unit="deg"',
                    '<ssv:Units>', '<ssv:Units><ssc:Unit name="deg">'
                    '<ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>')
    (error,) = {str(e) for e in check(changed).errors}
    assert error.endswith("is in deg, but the FMU's variable is in rad; write 0.785398163397 rad: no host "
                          "converts")


@pytest.mark.parametrize(("new", "expected"), [
    ("", "fin1_fin_command is in deg, but fin1.fin_command is in rad; multiply by 0.0174532925199 and add 0 where it "
     "is computed: no host converts"),
    ('factor="0.017453292519943295"', "connection fin1_fin_command -> fin1.fin_command: is of a form that emcas does "
     "not read; have only FMUs in one system, connected without transformation"),
])
def test_another_unit_at_a_connection(edit: Edit, new: str, expected: str) -> None:
    wiring = f'<ssd:Connection {COMMAND}/>'
    connection = wiring if not new else wiring[:-2] + f"><ssc:LinearTransformation {new}/></ssd:Connection>"
    text = ('name="fin1_fin_command" kind="input" description="commanded fin angle; clipped to +-command.limit">'
            '<ssc:Real unit="rad"')
    changed = edit(STRUCTURE, wiring, connection, text, text.replace("rad", "deg"), '<ssd:Units>',
                    '<ssd:Units><ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>')
    found = check(changed).findings
    assert [f.level for f in found if expected in str(f)] == ["error"], "\n".join(map(str, found))


def test_graphics_and_annotations_are_no_errors(edit: Edit) -> None:
    """Editors add them; they change no result."""
    wiring, binding = f"<ssd:Connection {COMMAND}/>", '<ssd:ParameterBinding source="resources/nominal_fin1.ssv"/>'
    note = '<ssd:Annotations><ssc:Annotation type="org.example"/></ssd:Annotations>'
    geometry = '<ssd:ConnectionGeometry pointsX="0 1" pointsY="0 1"/>'
    assert check(edit(STRUCTURE, wiring, f"{wiring[:-2]}>{geometry}</ssd:Connection>")).errors == []
    assert check(edit(STRUCTURE, wiring, f"{wiring[:-2]}>{note}</ssd:Connection>",
                      binding, f"{binding[:-2]}>{note}</ssd:ParameterBinding>")).errors == []


def test_unwired_input_and_reversed_connection_are_warnings(edit: Edit) -> None:
    unwired = check(edit(STRUCTURE, f"<ssd:Connection {ROLL}/>", ""))
    assert unwired.errors == []
    assert any("input fin1.attitude.roll: is not wired, while others are" in str(f) for f in unwired.findings)
    backwards = 'startElement="fin1" startConnector="fin_command" endConnector="fin1_fin_command"'
    turned = check(edit(STRUCTURE, COMMAND, backwards))
    assert any("runs from its end to its start" in str(f) for f in turned.findings)


def test_false_boolean_is_a_warning(edit: Edit) -> None:
    """fmpy cannot read it."""
    report = check(edit("resources/nominal_fin1.ssv", "</ssv:Parameters>", '<ssv:Parameter name="encoder.on_fin">'
                          '<ssv:Boolean value="false"/></ssv:Parameter></ssv:Parameters>'))
    assert report.errors == []
    assert any("parameter encoder.on_fin: is false, which fmpy's" in str(w) for w in report.warnings)


def test_fmu_with_another_guid_is_an_error(ssp: Path, native: Path, fmu: Path, tmp_path: Path) -> None:
    """Both back ends have the same GUID."""
    assert check(ssp, fmu=native).findings == check(ssp, fmu=fmu).findings == ()
    guid = "{00000000-0000-0000-0000-000000000000}"
    error = check(ssp, guid=guid).errors[0]
    assert error.place == "component fin1"
    assert f"required is {guid}; replace it with that FMU, or write a new archive" in str(error)
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


USERS = f"""<ssd:SystemStructureDescription xmlns:ssd="{SSD}" xmlns:ssc="{SSC}" xmlns:ssv="{SSV}"
version="1.0" name="mine"><ssd:System name="tail">
<ssd:Connectors><ssd:Connector name="left" kind="input"><ssc:Real unit="deg"/></ssd:Connector></ssd:Connectors>
<ssd:Elements><ssd:Component name="fin" source="resources/EMCAS.fmu"><ssd:Connectors>
<ssd:Connector name="fin_command" kind="input"><ssc:Real unit="rad"/></ssd:Connector></ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding source="own.ssv"/></ssd:ParameterBindings></ssd:Component>
</ssd:Elements><ssd:Connections>
<ssd:Connection startConnector="left" endElement="fin" endConnector="fin_command"/></ssd:Connections></ssd:System>
<ssd:Units><ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.0174532925199433"/></ssc:Unit>
<ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit></ssd:Units></ssd:SystemStructureDescription>"""
USERS_SET = f"""<ssv:ParameterSet xmlns:ssv="{SSV}" version="1.0" name="own"><ssv:Parameters>
<ssv:Parameter name="motor.resistance"><ssv:Real value="0.3"/></ssv:Parameter>
<ssv:Parameter name="motor.hue"><ssv:Real value="1"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>"""


def users_archive(native: Path, path: Path, *pairs: str) -> Path:
    """Write a user's archive with texts of its structure replaced: users_archive(native, path, old, new, ...)."""
    write_archive({STRUCTURE: replaced(USERS, *pairs).encode(), "own.ssv": USERS_SET.encode(),
                   "resources/EMCAS.fmu": native.read_bytes()}, path)
    return path


def test_findings_in_a_users_archive(native: Path, tmp_path: Path) -> None:
    """It has one component, other names, and no GUID of the FMU."""
    report = check(users_archive(native, tmp_path / "mine.ssp"))
    assert {f"{e.place}: {e.message}" for e in report.errors} == {
        "connection left -> fin.fin_command: left is in deg, but fin.fin_command is in rad",
        "parameter motor.hue: the FMU has no such variable"}
    warnings = {w.place for w in report.warnings}
    assert "input fin.enable" in warnings
    assert "input fin.fin_command" not in warnings


@pytest.mark.parametrize(("old", "new", "location"), [
    ('<ssd:Component name="fin" source="resources/EMCAS.fmu">', '<ssd:System name="inner"/><ssd:Component name="fin" '
     'source="resources/EMCAS.fmu">', "system inner"),
    ('<ssd:Component name="fin" source="resources/EMCAS.fmu">', '<ssd:SignalDictionaryReference name="bus" '
     'dictionary="d"/><ssd:Component name="fin" source="resources/EMCAS.fmu">', "signal dictionary reference bus"),
    ('name="fin" source', 'type="application/x-ssp-package" name="fin" source', "component fin"),
    ('source="own.ssv"', 'source="own.ssv" prefix="x."', "parameter binding fin"),
    ('<ssd:ParameterBinding source="own.ssv"/>', f"<ssd:ParameterBinding><ssd:ParameterValues>{USERS_SET}"
     "</ssd:ParameterValues></ssd:ParameterBinding>", "parameter binding fin"),
])
def test_unsupported_structures_are_errors(native: Path, tmp_path: Path, old: str, new: str, location: str) -> None:
    """SSP allows them, this package does not read them. The rest of the structure is then not checked."""
    report = check(users_archive(native, tmp_path / "mine.ssp", old, new))
    (error,) = report.errors
    assert error.place == location
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
def test_name_declared_twice_is_an_error(native: Path, tmp_path: Path, old: str, new: str, expected: str) -> None:
    (error,) = check(users_archive(native, tmp_path / "mine.ssp", old, new)).errors
    assert f"{expected} declared twice; rename one of them" in str(error)


def test_connection_to_an_undeclared_connector_is_an_error(native: Path, tmp_path: Path) -> None:
    path = users_archive(native, tmp_path / "mine.ssp", '<ssd:Connector name="fin_command"',
                         '<ssd:Connector name="fin_rate"')
    assert any("there is no connector fin.fin_command; declare it in the Connectors of its component" in str(e)
               for e in check(path).errors)


def test_second_connection_to_an_input_is_an_error(edit: Edit) -> None:
    changed = edit(STRUCTURE, f"<ssd:Connection {COMMAND}/>", f"<ssd:Connection {COMMAND}/>" * 2)
    assert "fin1.fin_command is fed twice, first by fin1_fin_command ->" in str(check(changed).errors[0])


def test_unwired_connector_without_a_variable_is_an_error(native: Path, tmp_path: Path) -> None:
    path = users_archive(native, tmp_path / "mine.ssp", '<ssd:Connector name="fin_command"',
                         '<ssd:Connector name="fin_angel" kind="output"/><ssd:Connector name="fin_command"')
    assert any("connector fin.fin_angel: the FMU has no such variable; did you mean fin_angle?" in str(e)
               for e in check(path).errors)


def test_component_parameters_at_the_system_are_errors(edit: Edit) -> None:
    changed = edit(STRUCTURE, 'source="resources/nominal_system.ssv"', 'source="resources/nominal_fin1.ssv"')
    assert any("parameter motor.resistance: is not a connector of the system" in str(e) for e in check(changed).errors)


def test_json_contains_the_findings(edit: Edit, tmp_path: Path) -> None:
    changed = edit(STRUCTURE, COMMAND, COMMAND.replace('"fin_command"', '"fin_comand"'))
    write_json(check(changed).document(), tmp_path / "f.json")
    document = json.loads((tmp_path / "f.json").read_text())
    assert document["passed"] is False
    (first,) = (f for f in document["findings"] if f["place"] == "connection fin1_fin_command -> fin1.fin_comand")
    assert set(first) == {"level", "file", "place", "message", "remedy"}


def test_file_that_is_no_archive_is_an_error(tmp_path: Path) -> None:
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
def test_damaged_archive_gives_findings_instead_of_exceptions(ssp: Path, tmp_path: Path, data: st.DataObject) -> None:
    """Random bytes replace bytes of the archive, or of its structure or a parameter set."""
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


def test_different_units_of_signals_are_a_mismatch() -> None:
    """Two names of one unit are equal."""
    def real(unit: str, kind: str = "output", value: float | None = None) -> Signal:
        return Signal("x", kind, "Real", unit, value)

    assert real("N.m").mismatch(real("N*m"), "y") is None
    assert real("").mismatch(real("V"), "y") is None
    assert real("furlong").mismatch(real("furlong"), "y") is None
    assert real("furlong").mismatch(real("m"), "y") == ("is in furlong, but y is in m", "use a quantity in m")
    assert real("degC", "", -6.0).mismatch(real("K"), "y") == (
        "is in degC, but y is in K", "write 267.15 K: no host converts")

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
from emcas_fmu.ssp.archive import Archive, write_archive
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.schema import SSC, SSD, SSV, SspError
from emcas_fmu.ssp.structure import read_variant
from emcas_fmu.ssp.units import Unit, conversion

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
    assert report.errors == ()
    assert [w.file for w in report.warnings] == ["SystemStructure.ssd", "cold.ssd", "degraded.ssd"]
    assert all("with which libcosim and Ecos refuse the file" in w.message for w in report.warnings)


@pytest.mark.parametrize(("old", "new", "place", "expected"), [
    (COMMAND, COMMAND.replace('"fin_command"', '"fin_comand"'), "connection fin1_fin_command -> fin1.fin_comand",
     "the FMU of fin1 has no variable 'fin_comand'; did you mean fin_command?"),
    (COMMAND, COMMAND.replace("fin1_fin_command", "fin1_command"), "connection fin1_command -> fin1.fin_command",
     "the system has no connector 'fin1_command'; did you mean fin1_fin_command?"),
    (COMMAND, COMMAND.replace('"fin1"', '"fin"'), "connection fin1_fin_command -> fin.fin_command",
     "there is no element fin; did you mean fin"),
    (ROLL, ROLL.replace('"attitude_roll" endE', '"supply_voltage" endE'),
     "connection supply_voltage -> fin1.attitude.roll",
     "supply_voltage in V does not measure what fin1.attitude.roll in rad does"),
    (ROLL, ROLL.replace('"attitude_roll" endE', '"enable" endE'), "connection enable -> fin1.attitude.roll",
     "enable is Boolean and fin1.attitude.roll is Real"),
    (COMMAND, FED.replace('"fin_angle"', '"fin_command"'), "connection fin2.fin_command -> fin1.fin_command",
     "both fin2.fin_command and fin1.fin_command are ends that is fed"),
    (ROLL, COMMAND, "connection fin1_fin_command -> fin1.fin_command", "fin1.fin_command is fed twice"),
    ('name="attitude.roll" kind="input" description="vehicle roll angle, for gravity"><ssc:Real unit="rad"',
     'name="attitude.roll" kind="input" description=""><ssc:Real unit="V"', "connector fin1.attitude.roll",
     "is declared in V, but the FMU's variable is in rad"),
    ('name="enable" kind="input"', 'name="enable" kind="output"', "connector fin1.enable",
     'is declared output, but is input of the FMU; write kind="input"'),
    ('source="resources/EMCAS.fmu"', 'source="resources/EMCS.fmu"', "component fin1",
     "its FMU resources/EMCS.fmu is not in the archive; the archive has resources/EMCAS.fmu"),
    ('source="resources/nominal_fin1.ssv"', 'source="resources/fin1.ssv"', "",
     "parameter binding of fin1: resources/fin1.ssv: is not in edited.ssp"),
    ('kind="input"', 'kind="inlet"', "", "[facet 'enumeration'] The value 'inlet' is not an element of the set"),
    ('version="1.0" name="nominal"', 'version="one" name="nominal"', "",
     "The value 'one' is not accepted by the pattern"),
    ("</ssd:System>", "", "", "is not XML"),
    ('.fmu" guid="{', '.fmu" guid="{0', "component fin1", "was written for resources/EMCAS.fmu with GUID {0"),
])
def test_errors(edited: Edit, old: str, new: str, place: str, expected: str) -> None:
    errors = check(edited(STRUCTURE, old, new)).errors
    found = [e for e in errors if e.place == place and expected in str(e)]
    assert found, "\n".join(map(str, errors))
    assert found[0].file == STRUCTURE
    assert found[0].remedy


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('name="motor.resistance"', 'name="motor.resistence"', "parameter motor.resistence: the FMU has no variable "
     "motor.resistence; did you mean motor.resistance?"),
    ('name="motor.resistance"', 'name="fin_angle"', "parameter fin_angle: is output of the FMU and cannot be set"),
    ('value="0.25" unit="Ohm"', 'value="-1" unit="Ohm"', "parameter motor.resistance: is -1 Ohm, outside 1e-06 .. "
     "10000; write a value within the limits"),
    ('value="0.25" unit="Ohm"', 'value="0.25" unit="V"', "is in V, but the FMU's variable is in Ohm; write it in "
     "Ohm"),
    ('value="0.25" unit="Ohm"', 'value="a" unit="Ohm"', "'a' is not a valid value of the atomic type 'xs:double'"),
    ('<ssv:Integer value="2048"', '<ssv:Real value="2048"', "parameter encoder.pulses: has the type Real, but is "
     "Integer in the FMU; write ssv:Integer"),
    # Of itself within its limits; only with another it makes no sense.
    ('value="0.4363323129985824" unit="rad"', 'value="0.2" unit="rad"', "component fin1: fin.stop_angle = 0.2 rad"),
])
def test_errors_in_parameters(edited: Edit, old: str, new: str, expected: str) -> None:
    errors = check(edited("resources/nominal_fin1.ssv", old, new)).errors
    assert any(expected in str(e) for e in errors), "\n".join(map(str, errors))


def test_a_unit_without_a_definition_is_no_excuse(edited: Edit) -> None:
    text = 'name="fin1_fin_command" kind="input" description="commanded fin angle; clipped to +-command.limit">'
    spoilt = edited(STRUCTURE, f'{text}<ssc:Real unit="rad"', f'{text}<ssc:Real unit="deg"')
    said = "fin1_fin_command is in deg and fin1.fin_command in rad, of which at least one is not defined"
    assert any(said in str(e) for e in check(spoilt).errors)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('value="39.0" unit="V"', 'value="39000" unit="mV"',
     "supply_voltage: is in mV, but the FMU's variable is in V"),
    ('value="39.0" unit="V"', 'value="-39" unit="V"', "supply_voltage: is -39 V, outside 0 .. 1000"),
    ('<ssv:Real value="39.0" unit="V"', '<ssv:String value="much"',
     "supply_voltage: has the type String, but is Real in the FMU"),
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
                          "converts here")


@pytest.mark.parametrize(("new", "expected"), [
    ("", "fin1_fin_command is in deg and fin1.fin_command in rad, which hosts pass on as they are; use one unit: "
     "multiply by 0.0174532925199 and add 0 where the value is computed"),
    ('factor="0.017453292519943295"', "connection fin1_fin_command -> fin1.fin_command: has a transformation, which "
     "emcas does not read; convert where the value is computed"),
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
    assert check(drawn).errors == ()
    noted = edited(STRUCTURE, wiring, f"{wiring[:-2]}>{note}</ssd:Connection>",
                   binding, f"{binding[:-2]}>{note}</ssd:ParameterBinding>")
    assert check(noted).errors == ()


def test_warnings(edited: Edit) -> None:
    """An input without a wire where others have one, and what a host is known not to read."""
    unwired = check(edited(STRUCTURE, f"<ssd:Connection {ROLL}/>", ""))
    assert unwired.errors == ()
    assert any("input fin1.attitude.roll: is not wired: it stays at 0" in str(f) for f in unwired.findings)
    backwards = 'startElement="fin1" startConnector="fin_command" endConnector="fin1_fin_command"'
    turned = check(edited(STRUCTURE, COMMAND, backwards))
    assert any("runs from its end to its start" in str(f) for f in turned.findings)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("ssd:Connections", "emcas:Connections", "emcas:Connections: libcosim and Ecos pass over all in it, and"),
    ('"attitude_roll"', '"attitude.roll"', "connector attitude.roll: of the system has a dot, with which OMSimulator"),
    ('type="org.openmodelica"', 'type="org.example"', "system EMCAS: does not begin its Annotations with the one that"),
    ("</ssd:ParameterBindings></ssd:Component>", "</ssd:ParameterBindings><ssd:Annotations>"
     '<ssc:Annotation type="org.example"/></ssd:Annotations></ssd:Component>',
     "component fin1: has Annotations, with which OMSimulator refuses it"),
])
def test_what_a_host_is_known_not_to_read(edited: Edit, old: str, new: str, expected: str) -> None:
    spaces = ('xmlns:emcas="urn:emcas-fmu:ssp"', f'xmlns:emcas="{SSD}"') if "emcas:C" in new else ()
    report = check(edited(STRUCTURE, old, new, *spaces))
    assert report.errors == ()
    assert any(expected in str(w) for w in report.warnings), "\n".join(map(str, report.findings))


def test_another_fmu(ssp: Path, native: Path, fmu: Path, tmp_path: Path) -> None:
    """The two back ends have one interface, hence one GUID; another interface has another."""
    assert check(ssp, fmu=native).findings == check(ssp, fmu=fmu).findings == ()
    wanted = "{00000000-0000-0000-0000-000000000000}"
    error = check(ssp, guid=wanted).errors[0]
    assert error.place == "component fin1"
    assert f"wanted is {wanted}; write the archive anew" in str(error)
    with pytest.raises(EmcasError, match="is not an FMU"):
        check(ssp, fmu=Path(__file__))
    contents = Archive(ssp).contents()
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
        "connection left -> fin.fin_command: left is in deg and fin.fin_command in rad, which hosts pass on as they "
        "are", "parameter motor.hue: the FMU has no variable motor.hue"}
    warned = {w.place for w in report.warnings}
    assert "input fin.enable" in warned
    assert "input fin.fin_command" not in warned


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('<ssd:Component name="fin" source="resources/EMCAS.fmu">', '<ssd:System name="inner"/><ssd:Component name="fin" '
     'source="resources/EMCAS.fmu">', "element inner: is of the type System, and emcas reads FMUs in one system "
     "only; put FMUs into the outermost system"),
    ('name="fin" source', 'type="application/x-other" name="fin" source', "element fin: is of the type "
     "application/x-other"),
    ('source="own.ssv"', 'source="own.ssv" prefix="x."', "parameter binding of fin: emcas reads sets from files, "
     "without prefix or mapping"),
    ('<ssd:ParameterBinding source="own.ssv"/>', f"<ssd:ParameterBinding><ssd:ParameterValues>{OWN_SET}"
     "</ssd:ParameterValues></ssd:ParameterBinding>", "parameter binding of fin: emcas reads sets from files"),
])
def test_what_is_not_read_is_refused(native: Path, tmp_path: Path, old: str, new: str, expected: str) -> None:
    """What SSP allows, and the archives of this package do not use."""
    (error,) = check(own(native, tmp_path / "mine.ssp", old, new)).errors
    assert expected in str(error)
    with pytest.raises(SspError, match="see emcas ssp check"):
        read_variant(tmp_path / "mine.ssp", "mine")


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
        assert "is not a ZIP archive" in str(check(tmp_path / name).errors[0])
    write_archive({"readme.txt": b""}, tmp_path / "other.ssp")
    assert "has no SystemStructure.ssd at its root" in str(check(tmp_path / "other.ssp").errors[0])
    with pytest.raises(EmcasError, match="cannot be read"):
        check(tmp_path / "none.ssp")


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_told_and_never_raised(ssp: Path, tmp_path: Path, data: st.DataObject) -> None:
    """Bytes of the archive, or characters of its structure, overwritten at random."""
    if data.draw(st.booleans()):
        content = bytearray(ssp.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        (tmp_path / "damaged.ssp").write_bytes(content)
    else:
        contents = Archive(ssp).contents()
        name = data.draw(st.sampled_from([STRUCTURE, "resources/nominal_fin1.ssv"]))
        text = contents[name]
        at = data.draw(st.integers(0, len(text) - 1))
        contents[name] = text[:at] + data.draw(st.binary(max_size=6)) + text[at + data.draw(st.integers(0, 6)):]
        write_archive(contents, tmp_path / "damaged.ssp")
    for finding in check(tmp_path / "damaged.ssp").findings:
        assert str(finding)


def test_conversion() -> None:
    kelvin, celsius = Unit("K", (0, 0, 0, 0, 1, 0, 0, 0)), Unit("degC", (0, 0, 0, 0, 1, 0, 0, 0), 1.0, 273.15)
    found = conversion(celsius, kelvin)
    assert found is not None
    assert found(-6.0) == pytest.approx(267.15, rel=1e-15)
    assert not found.identity
    assert conversion(kelvin, Unit("rad", (0, 0, 0, 0, 0, 0, 0, 1))) is None
    assert conversion(kelvin, Unit("degC")) is None  # not defined

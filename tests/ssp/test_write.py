"""Archives that `emcas ssp` writes: valid files, connectors, connections and parameters of each variant."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any

import pytest
from fmpy.ssp.ssd import find_components, get_connections, read_ssd, read_ssv
from lxml import etree

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.fmi.units import fmi_unit
from emcas_fmu.parameters import load_parameters
from emcas_fmu.ssp.archive import NAMESPACES, SSC, SSD, read_archive
from emcas_fmu.ssp.structure import read_variant
from emcas_fmu.ssp.variants import variant_files
from emcas_fmu.ssp.write import write_ssp
from tests.default_actuator import INPUTS, OUTPUTS, PARAMETERS

from .conftest import valid_documents

VARIANTS = ("nominal", "cold", "degraded")
OF_FINS = {"fin_command", "aero_torque", *(v.name for v in OUTPUTS)}


def of_fin(values: Mapping[tuple[str, str], Any], number: int) -> dict[str, Any]:
    """Return the parameters of a fin."""
    return {name: value for (component, name), value in values.items() if component == f"fin{number}"}


def test_every_file_is_valid(ssp: Path, wired_ssp: Path) -> None:
    assert (valid_documents(ssp), valid_documents(wired_ssp)) == (3 * (1 + 4), 3 * (1 + 5))


def test_fmpy_reads_the_archive(ssp: Path, wired_ssp: Path) -> None:
    """fmpy validates against its schemas. It requires system connectors without dots in their names."""
    for path, connections in ((ssp, None), (wired_ssp, 4 * len(INPUTS + OUTPUTS))):
        read = read_ssd(str(path))
        assert [c.name for c in find_components(read.system)] == ["fin1", "fin2", "fin3", "fin4"]
        if connections is not None:
            assert len(get_connections(read.system)) == connections
    names = [c.name for c in read.system.connectors]
    assert not [name for name in names if "." in name]
    for variant in VARIANTS:
        parameters = {p.name for p in read_ssv(str(ssp), f"resources/{variant}_fin2.ssv").parameters}
        assert parameters == {"supply_voltage", *(p.name for p in PARAMETERS if p.kind != "Boolean")}


def test_structure_is_readable_by_libcosim_ecos_and_omsimulator(ssp: Path, wired_ssp: Path) -> None:
    """One of them each would refuse another annotation, a prefix of parameters, and another namespace prefix."""
    for path, wires in ((ssp, 0), (wired_ssp, 4 * len(INPUTS + OUTPUTS))):
        root = etree.fromstring(read_archive(path)["SystemStructure.ssd"])
        system = root.find(f"{{{SSD}}}System")
        assert system.find(f"{{{SSD}}}Annotations/{{{SSC}}}Annotation").get("type") == "org.openmodelica"
        assert not list(system.iterfind(f"{{{SSD}}}Elements/*/{{{SSD}}}Annotations"))
        assert not [b for b in root.iter(f"{{{SSD}}}ParameterBinding") if b.get("prefix")]
        assert {e.prefix for e in root.iter(f"{{{SSD}}}*")} == {"ssd"}
        assert len(list(system.iterfind(f"{{{SSD}}}Connections/{{{SSD}}}Connection"))) == wires


def test_connectors_have_type_and_unit_of_the_variables(ssp: Path, wired_ssp: Path) -> None:
    assert all(component for component, _ in read_variant(ssp, "nominal").connectors)
    variant = read_variant(wired_ssp, "nominal")
    assert {(fin, c.name, c.kind, c.type, c.unit) for (fin, _), c in variant.connectors.items() if fin} == {
        (fin, v.name, v.causality, v.kind, v.unit if v.kind == "Real" else "")
        for fin in variant.sources for v in INPUTS + OUTPUTS}
    shared = {v.name.replace(".", "_") for v in INPUTS if v.name not in OF_FINS}
    assert {name for fin, name in variant.connectors if not fin} == shared | {
        f"fin{i}_{name}" for i in range(1, 5) for name in OF_FINS}
    root = etree.fromstring(read_archive(wired_ssp)["SystemStructure.ssd"])
    defined = {node.getparent().get("name"): dict(node.attrib) for node in root.iterfind(".//ssc:BaseUnit", NAMESPACES)}
    assert set(defined) == {c.unit for c in variant.connectors.values() if c.type == "Real"}
    for name, base in defined.items():
        assert {b: int(exponent) for b, exponent in base.items() if b not in ("factor", "offset")} == {
            **fmi_unit(name).exponents}


def test_every_variable_is_connected(wired_ssp: Path) -> None:
    connections = set(read_variant(wired_ssp, "nominal").connections)
    for i in range(1, 5):
        outer = {v.name: (f"fin{i}_{v.name}" if v.name in OF_FINS else v.name).replace(".", "_")
                 for v in INPUTS + OUTPUTS}
        assert {(("", outer[v.name]), (f"fin{i}", v.name)) for v in INPUTS} <= connections
        assert {((f"fin{i}", v.name), ("", outer[v.name])) for v in OUTPUTS} <= connections


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_parameter_set_for_each_component(ssp: Path, wired_ssp: Path, variant: str, values: Mapping[str, Any]
                                              ) -> None:
    """If the system has connectors, a further set has their start values."""
    fins = [(f"fin{i}", variant) for i in (1, 2, 3, 4)]  # Ecos finds a set by the variant's name
    assert read_variant(ssp, variant).sets == fins
    content = read_variant(wired_ssp, variant)
    assert content.sets == [*fins, ("", variant)]
    bus = (0.9 if variant == "degraded" else 1.0) * values["drive.supply_voltage"]
    assert {name: value for (fin, name), value in content.values.items() if not fin} == {
        "supply_voltage": pytest.approx(bus, rel=1e-15), "enable": True}


@pytest.mark.parametrize(("layout", "azimuths"), [("cross", (45, 135, 225, 315)), ("plus", (0, 90, 180, 270))])
def test_layout_sets_the_azimuths(native: Path, tmp_path: Path, layout: str, azimuths: tuple[float, ...]) -> None:
    values = read_variant(write_ssp(tmp_path / "a.ssp", native, layout=layout).path, "nominal").values
    assert [values[f"fin{i}", "mounting.azimuth"] for i in range(1, 5)] == [radians(a) for a in azimuths]


def test_values_of_the_variants(ssp: Path, values: Mapping[str, Any]) -> None:
    """Only the azimuths of `nominal` differ from the default; models/*.toml have the values of the others."""
    found = {variant: read_variant(ssp, variant).values for variant in VARIANTS}
    nominal = of_fin(found["nominal"], 2)
    assert {n for n, v in nominal.items() if n in values and v != values[n]} == {"mounting.azimuth"}
    assert of_fin(found["cold"], 2) == {**nominal, "friction.temperature": -6.0}
    motor = {"motor.torque_constant": 0.93, "motor.back_emf_constant": 0.93, "motor.resistance": 1.15}
    degraded = {**nominal, **{n: pytest.approx(s * values[n], rel=1e-15) for n, s in motor.items()}}
    assert {n: v for n, v in of_fin(found["degraded"], 2).items() if n != "supply_voltage"} == {
        n: v for n, v in degraded.items() if n != "supply_voltage"}
    assert of_fin(found["degraded"], 1)["friction.fin_coulomb"] == 10.0
    assert found["degraded"]["fin3", "supply_voltage"] == pytest.approx(0.9 * values["drive.supply_voltage"], rel=1e-15)


def test_fins_file_overrides_common_file_overrides_fmu(tmp_path: Path) -> None:
    """A relative value of a variant is relative to the result."""
    (tmp_path / "unit.toml").write_text('[motor]\nresistance = "0.3 Ohm"\n[encoder]\non_fin = true\n')
    (tmp_path / "base.toml").write_text('[motor]\nresistance = "0.4 Ohm"\n')
    (tmp_path / "second.toml").write_text('[motor]\nresistance = "0.5 Ohm"\n[mounting]\nazimuth = "100 deg"\n')
    unit = build(load_parameters(tmp_path / "unit.toml"), tmp_path / "unit.fmu").path

    alone = read_variant(write_ssp(tmp_path / "a.ssp", unit).path, "nominal").values
    assert alone["fin1", "motor.resistance"] == 0.3
    assert ("fin1", "encoder.on_fin") not in alone  # the FMU's start value remains
    both = write_ssp(tmp_path / "b.ssp", unit, [tmp_path / "base.toml"], fin_files={2: tmp_path / "second.toml"},
                     variant_files=variant_files([])).path
    found = read_variant(both, "nominal").values
    assert found["fin1", "motor.resistance"] == 0.4
    assert found["fin2", "motor.resistance"] == 0.5
    assert found["fin2", "mounting.azimuth"] == radians(100)
    assert found["fin1", "encoder.on_fin"] is False  # the default of a parameter file, not the FMU's value
    weak = read_variant(both, "degraded").values
    assert [weak[f"fin{i}", "motor.resistance"] for i in (1, 2)] == pytest.approx([0.46, 0.575], rel=1e-15)


def test_second_archive_has_the_same_bytes(ssp: Path, native: Path, tmp_path: Path) -> None:
    again = write_ssp(tmp_path / "again.ssp", native, variant_files=variant_files([]))
    assert again.path.read_bytes() == ssp.read_bytes()
    assert again.report.findings == ()
    assert list(tmp_path.iterdir()) == [again.path]


@pytest.mark.parametrize(("arguments", "expected"), [
    ({"output": Path("a.zip")}, "must end in .ssp"),
    ({"output": Path("nowhere/a.ssp")}, "there is no folder nowhere"),
    ({"fins": 0}, "fins 0: an FMU has 1 to 8 fins"),
    ({"fins": 9}, "fins 9: an FMU has 1 to 8 fins"),
    ({"layout": "x"}, "layout x: choose plus or cross"),
    ({"fmu": Path("none.fmu")}, "none.fmu: cannot be read"),
    ({"fmu": Path(__file__)}, "is not an FMU"),
])
def test_wrong_arguments_are_refused(native: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                     arguments: dict[str, Any], expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EmcasError) as caught:
        write_ssp(**{"output": Path("a.ssp"), "fmu": native, **arguments})
    assert expected in str(caught.value)
    assert not list(tmp_path.rglob("*.ssp"))


@pytest.mark.parametrize(("text", "expected"), [
    ("[every_fin.motor]\nresistence = '1 Ohm'\n",
     "fin1: motor.resistence = 1 Ohm: the nonlinear actuator has no such parameter; did you mean motor.resistance?"),
    ("[every_fin.motor]\nresistance = '115 s'\n", "the unit s does not measure this quantity"),
    ("[every_fin.motor]\nresistance = '-5 %'\n", "motor.resistance = -0.0125 Ohm: is -0.0125 Ohm; it must be within"),
    ("[motor]\nresistance = '1 Ohm'\n", "hot.toml: motor: expected tables every_fin, fin1, fin2"),
    ("[fin2.drive]\nsupply_voltage = '90 %'\n", "drive.supply_voltage differs between fins, which share it"),
    ("nonsense", "hot.toml: is not valid TOML"),
])
def test_wrong_variant_file_is_refused(native: Path, tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "hot.toml"
    file.write_text(text)
    with pytest.raises(EmcasError) as caught:
        write_ssp(tmp_path / "a.ssp", native, variant_files={"hot": file})
    assert expected in str(caught.value)
    assert not list(tmp_path.rglob("*.ssp"))

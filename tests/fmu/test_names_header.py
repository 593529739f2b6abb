"""The header with GUID and value references for a host in C, of any actuator with one fin and with four."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from emcas_fmu.actuators import NAMES
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.model_description import model_description
from emcas_fmu.fmi.native import names_header
from emcas_fmu.fmi.package import interface_guid
from emcas_fmu.parameters import load_parameters
from tests.hosts.host import STRICT, tool
from tests.marks import others_slow

WITH_WORDS = "nonlinear+homing+faults"
MACRO = re.compile(r"#define \w+_VR_\w+ (\d+)u /\* (\S+): (.+) \*/")


@pytest.mark.parametrize("fmi", FORMATS)
@pytest.mark.parametrize("fins", [1, 4])
@pytest.mark.parametrize("model", others_slow([*NAMES, WITH_WORDS], lambda model: model in (
    "nonlinear", "second-order", "electrohydraulic", WITH_WORDS)))
def test_header_agrees_with_the_model_description(model: str, fins: int, fmi: str) -> None:
    unit, chosen = FmuInterface(fins, model), FORMATS[fmi]
    starts = start_values(unit, [load_parameters(model=model).values] * fins)
    guid = interface_guid(starts, unit, chosen)
    text = names_header(unit, guid, chosen)
    described = model_description(chosen, unit, starts, guid)
    macros = {name: (int(reference), properties) for reference, name, properties in MACRO.findall(text)}
    expected = {}
    for variable in described.find("ModelVariables") or ():
        typed = variable[0] if fmi == "2" else variable
        kind = {("2", "Enumeration"): "Integer", ("3", "Enumeration"): "Enumeration (Int64)"}.get(
            (fmi, typed.tag), typed.tag)
        shape = " x ".join(d.attrib["start"] for d in variable.findall("Dimension"))
        words = (variable.attrib["causality"], kind, typed.attrib.get("unit"), shape and f"{shape} values")
        expected[variable.attrib["name"]] = int(variable.attrib["valueReference"]), ", ".join(filter(None, words))
    assert macros == expected
    prefix = unit.model.upper()
    assert f'#define {prefix}_{"TOKEN" if chosen.is_3 else "GUID"} "{guid}"' in text
    assert f'#define {prefix}_MODEL "{unit.model}"' in text
    names = re.findall(r"#define (\w+)", text)
    assert len(names) == len(set(names)) == len(expected) + 3  # guard, model and GUID


def test_macros_of_one_fin_and_of_four() -> None:
    one, four = (names_header(FmuInterface(fins), "{}", FORMATS["2"]) for fins in (1, 4))
    assert "#define EMCAS_VR_FIN_COMMAND 0u /* fin_command: input, Real, rad */" in one
    assert re.search(r"#define EMCAS4_VR_FIN_2_FIN_ANGLE \d+u /\* fin\[2\]\.fin_angle: output, Real, rad \*/", four)


def test_c_and_cpp_programs_can_include_both_headers(tmp_path: Path) -> None:
    for fins, name in ((1, "EMCAS"), (4, "EMCAS4")):
        (tmp_path / f"{name}.h").write_text(names_header(FmuInterface(fins), "{x}", FORMATS["2"]), encoding="utf-8")
    (tmp_path / "both.c").write_text(
        '#include "EMCAS.h"\n#include "EMCAS4.h"\n#include "EMCAS.h"\n'
        "const unsigned both[] = {EMCAS_VR_FIN_ANGLE, EMCAS4_VR_FIN_4_FIN_ANGLE};\n"
        "const char *const guid = EMCAS_GUID;\n", encoding="utf-8")
    for language in (STRICT, ("-x", "c++", *STRICT[1:])):
        done = subprocess.run([tool("gcc", "gcc"), *language, "-c", "both.c", "-o", "both.o"], cwd=tmp_path,
                              capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

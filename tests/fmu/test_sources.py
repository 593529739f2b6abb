"""The C sources in an FMU, for use in a user's program: names, standard of C, and required library functions."""

from __future__ import annotations

import re
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from fmpy.validation import validate_fmu

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from tests.hosts.host import STRICT, standard_headers, tool
from tests.marks import slow

from .built import lean

C99 = ("-std=c99", *STRICT[1:], "-include", "plain.h")
# Unlike other C libraries, Debian's defines _Static_assert in C99.
PLAIN = "#include <sys/cdefs.h>\n#undef _Static_assert\n"
MATHEMATICS = {"floor", "sqrt", "fabs"}  # exact in every library; sqrt and fabs are usually instructions
MEMORY = {"memcpy", "memmove", "memset", "memcmp"}  # required by every C compiler, also without a C library
TEXT = {"strcmp", "strlen", "strncat", "vsnprintf"}  # for log messages and names
CORE = """
#define FINS 1
#include "multi_fin.h"
static multi_fin fins;
core_result run(multi_fin_state *s, const double *p, double end, const double *in, const double *motion, double *out);
core_result run(multi_fin_state *s, const double *p, double end, const double *in, const double *motion, double *out)
{
    double loads[CORE_MOTION_LOADS];
    core_inputs acting;
    if (end == 0.0) multi_fin_bind(&fins, p, p), multi_fin_start(&fins, s);
    core_motion_loads(fins.p[0], fins.c[0], motion, loads);
    multi_fin_acting(&fins, 0, in, in, loads, &acting);
    multi_fin_outputs(&fins, s, &acting, out);
    return multi_fin_run(&fins, s, 0.0, end, &acting, NULL, out);
}
"""


@pytest.fixture(scope="module", params=["2", pytest.param("3", marks=pytest.mark.slow)])
def fmi(request: pytest.FixtureRequest) -> str:
    """A version of FMI."""
    return str(request.param)


@pytest.fixture(scope="module")
def sources(fmi: str, shipped_unit: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sources of an FMU; its subfolder `headers` has the headers of FMI."""
    folder = tmp_path_factory.mktemp("sources")
    with zipfile.ZipFile(shipped_unit(fmi=fmi)) as archive:
        for name in filter(lambda name: name.startswith("sources/"), archive.namelist()):
            (folder / Path(name).name).write_bytes(archive.read(name))
    standard_headers(folder / "headers")
    (folder / "plain.h").write_text(PLAIN, encoding="utf-8")
    (folder / "core.c").write_text(CORE, encoding="utf-8")
    return folder


def symbols(folder: Path, compiler: str, source: str, *flags: str) -> dict[str, set[str]]:
    """Compile a source, and return names by the type that `nm` prints: U is undefined, T is an exported function."""
    command = [tool(compiler, compiler), *C99, "-Iheaders", *flags, "-c", source, "-o", "source.o"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    lines = subprocess.run([tool("nm", "binutils"), "source.o"], cwd=folder, capture_output=True, text=True, check=True)
    names: dict[str, set[str]] = {}
    for line in lines.stdout.splitlines():
        kind, name = line.split()[-2:]
        names.setdefault(kind, set()).add(name)
    return names


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("flags", [("-O0",), pytest.param(("-O2", "-ffreestanding"), marks=pytest.mark.slow)])
def test_c99_code_needs_few_library_functions(sources: Path, fmi: str, compiler: str, flags: tuple[str, ...]) -> None:
    """Exported functions have the identifier as prefix; there are constants but no variables."""
    found = symbols(sources, compiler, f"fmi{fmi}.c", "-fno-pic", *flags)
    assert {"calloc", "free", "memcpy", "vsnprintf"} <= found["U"] <= {"calloc", "free"} | MATHEMATICS | MEMORY | TEXT
    assert f"EMCAS_fmi{fmi}DoStep" in found["T"]
    assert {name for name in found["T"] if not name.startswith(f"EMCAS_fmi{fmi}")} == set()
    assert set(found) <= set("UTtrR")


@pytest.mark.parametrize("compiler", ["gcc", *slow("clang")])
def test_the_core_needs_only_three_mathematical_functions(sources: Path, compiler: str) -> None:
    found = symbols(sources, compiler, "core.c", "-O1", "-ffreestanding", "-Wno-unused-function")
    assert "memcpy" in found["U"]
    assert found["U"] - {"_GLOBAL_OFFSET_TABLE_"} <= MATHEMATICS | MEMORY


@pytest.mark.parametrize("flag", ["-D{}_OVERRIDE_FUNCTION_PREFIX", "-D{}_FUNCTION_PREFIX=",
                                  "-D{}_FUNCTION_PREFIX=Own_"])
def test_compiler_option_sets_the_prefix_of_functions(sources: Path, fmi: str, flag: str) -> None:
    """The options are those of the standard's headers; the first is for a shared library, without prefix."""
    found = symbols(sources, "gcc", f"fmi{fmi}.c", "-O0", flag.format(f"FMI{fmi}"))
    assert f"{'Own_' if 'Own' in flag else ''}fmi{fmi}DoStep" in found["T"]


@pytest.mark.parametrize(("backend", "fmi"), [("python", "2"), ("native", "2"), ("native", "3")])
def test_the_identifier_names_library_and_header(tmp_path: Path, backend: str, fmi: str) -> None:
    """The model's name, which tools show, remains."""
    path = tmp_path / "unit.fmu"
    lean(load_parameters(), path, backend, fmi=fmi, identifier="Rudder_2")
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path))
    assert (description.coSimulation.modelIdentifier, description.modelName) == ("Rudder_2", "EMCAS")
    assert len(fmpy.simulate_fmu(str(path), stop_time=0.01)) > 1
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        assert {Path(name).stem for name in names if name.startswith("binaries/")} == {"Rudder_2"}
        if backend == "native":
            assert "#define RUDDER_2_VR_FIN_COMMAND" in archive.read("sources/Rudder_2.h").decode()
            assert f"#define FMI{fmi}_FUNCTION_PREFIX Rudder_2_\n" in archive.read("sources/interface.h").decode()
            assert archive.read("sources/buildDescription.xml").decode().count('modelIdentifier="Rudder_2"') == 3


@pytest.mark.parametrize(("identifier", "message"), [
    ("", "not a C identifier"), ("2nd", "not a C identifier"), ("a-b", "not a C identifier"), ("Größe", "not a C"),
    ("a" * 65, "1 to 64"), ("core", r"core\.h is one of"), ("Math", r"Math\.h is one of"),
    ("fmi2Functions", "is one of")])
def test_bad_identifier_is_refused(tmp_path: Path, identifier: str, message: str) -> None:
    """It is not in C, or its header would be included instead of another, perhaps only where case is ignored."""
    with pytest.raises(EmcasError, match=message) as raised:
        build(load_parameters(), tmp_path / "unit.fmu", "native", identifier=identifier, references=False)
    assert "\n" not in str(raised.value)
    assert list(tmp_path.iterdir()) == []


def test_build_description_lists_the_definition_for_a_shared_library_as_optional(sources: Path, fmi: str) -> None:
    text = (sources / "buildDescription.xml").read_text(encoding="utf-8")
    assert set(re.findall(r'PreprocessorDefinition name="(\w+)" optional="(\w+)"', text)) == {
        (f"FMI{fmi}_OVERRIDE_FUNCTION_PREFIX", "true")}

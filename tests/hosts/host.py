"""Compile the host in C for an FMU, and run it."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryFile

import fmpy
import pytest

HERE = Path(__file__).parent
FMI_HEADERS = Path(fmpy.__file__).parent / "c-code"
STRICT = ("-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror")
Trajectory = dict[str, list[float]]
_NO_PREFIX = "#define fmi2FullName(name) name\n"
_PREFIX = """#if !defined(FMI2_OVERRIDE_FUNCTION_PREFIX) && defined(FMI2_FUNCTION_PREFIX)
#define fmi2Paste(a, b) a ## b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
#else
#define fmi2FullName(name) name
#endif
"""


def missing(reason: str) -> None:
    """Skip a test because a tool is missing, or fail it if EMCAS_REQUIRE_HOSTS=1."""
    if os.environ.get("EMCAS_REQUIRE_HOSTS") == "1":
        pytest.fail(f"EMCAS_REQUIRE_HOSTS=1, but {reason}")
    pytest.skip(reason)


def tool(name: str, package: str, folder: str = "") -> str:
    """Return the path of a program in the search path or `folder`; skip the test if it is missing."""
    path = shutil.which(name) or shutil.which(name, path=folder or None)
    if path is None:
        missing(f"there is no {name} (Debian: apt-get install {package})")
    return str(path)


def standard_headers(folder: Path) -> Path:
    """Write the headers of FMI 2.0.5 and 3.0; fmpy's header of FMI 2.0 lacks the function prefix."""
    shutil.copytree(FMI_HEADERS, folder)
    functions = folder / "fmi2Functions.h"
    text = functions.read_text(encoding="utf-8")
    assert text.count(_NO_PREFIX) == 1
    functions.write_text(text.replace(_NO_PREFIX, _PREFIX), encoding="utf-8")
    return folder


def header(description: Path) -> str:
    """Return C code with the GUID, value references and outputs of an FMU, of FMI 3.0 only for scalars."""
    root = ET.parse(description).getroot()
    version = root.attrib["fmiVersion"]
    if version == "2.0":
        scalars = [(s.attrib, s[0].tag) for s in root.findall("ModelVariables/ScalarVariable")]
    else:
        scalars = [(s.attrib, {"Float64": "Real"}.get(s.tag, s.tag)) for s in root.find("ModelVariables") or ()
                   if s.find("Dimension") is None]
    lines = [f'#define UNIT_GUID "{root.attrib["guid" if version == "2.0" else "instantiationToken"]}"']
    for attributes, _ in scalars:
        name = "".join(c if c.isalnum() else "_" for c in attributes["name"])
        lines.append(f"#define VR_{name} {attributes['valueReference']}u")
    for kind in ("Real", "Boolean"):
        outputs = [a for a, tag in scalars if a.get("causality") == "output" and tag == kind]
        names = [a["name"] for a in outputs]
        references = ", ".join(a["valueReference"] + "u" for a in outputs)
        quoted = ", ".join(f'"{n}"' for n in names)
        indices = ", ".join(f"OUTPUT_{n} = {k}" for k, n in enumerate(names))
        lines += [f"static const fmi2ValueReference {kind.upper()}_OUTPUTS[] = {{{references}}};",
                  f"static const char *const {kind.upper()}_OUTPUT_NAMES[] = {{{quoted}}};",
                  f"enum {{{indices}}};"]
    return "\n".join(lines) + "\n"


def compile_host(compiler: Sequence[str], unpacked: Path, target: Path, flags: Sequence[str] = (),
                 static: bool = False) -> Path:
    """Compile the host for an unpacked FMU, with `static` together with the FMU's sources.

    Without optimisation: sanitizers then check all of the source code, and compiling takes a third of the time.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    (target.parent / "variables.h").write_text(header(unpacked / "modelDescription.xml"), encoding="utf-8")
    if ET.parse(unpacked / "modelDescription.xml").getroot().attrib["fmiVersion"] == "3.0":
        flags = [*flags, "-DFMI3"]
    sources = [str(HERE / "host.c")]
    includes = [f"-I{target.parent}", f"-I{FMI_HEADERS}"]
    if static:
        folder = unpacked / "sources"
        names = {f.attrib["name"] for f in ET.parse(folder / "buildDescription.xml").iter("SourceFile")}
        assert names, "the FMU names no source files"
        sources += [str(folder / name) for name in names]
        includes.append(f"-I{folder}")
        flags = [*flags, "-DSTATIC_FMU", "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX"]
    libraries = () if target.suffix == ".exe" else ("-ldl", "-lm", "-pthread")
    done = subprocess.run([*compiler, *STRICT, "-O0", "-g", *flags, *includes, *sources, "-o", str(target), *libraries],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def run(command: Sequence[str | Path], *, environment: Mapping[str, str] | None = None, timeout: float = 120.0,
        code: int = 0) -> str:
    """Run a program and return its output; its exit code must be `code`."""
    # Files instead of pipes: Wine's services would keep a pipe open for seconds.
    with TemporaryFile("w+", encoding="utf-8") as out, TemporaryFile("w+", encoding="utf-8") as error:
        done = subprocess.run([str(c) for c in command], stdout=out, stderr=error, timeout=timeout,
                              env={**os.environ, **(environment or {})})
        out.seek(0)
        error.seek(0)
        output, messages = out.read(), error.read()
    assert done.returncode == code, f"code {done.returncode}\n{output[-2000:]}\n{messages[-4000:]}"
    return output


def table(output: str) -> dict[str, str]:
    """Return lines `name=value` as a dictionary."""
    return dict(line.split("=", 1) for line in output.splitlines())


def trajectory(output: str) -> Trajectory:
    """Return a CSV table by column."""
    rows = list(csv.reader(output.splitlines()))
    return {name: [float(row[k]) for row in rows[1:]] for k, name in enumerate(rows[0])}


def difference(a: Trajectory, b: Trajectory) -> float:
    """Return the largest difference of any column, relative to the column's largest value if that is above 1."""
    assert a.keys() == b.keys()
    largest = 0.0
    for name, values in a.items():
        assert len(values) == len(b[name]) > 0
        scale = max(1.0, *(abs(v) for v in values))
        largest = max(largest, *(abs(x - y) / scale for x, y in zip(values, b[name])))
    return largest

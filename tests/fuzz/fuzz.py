"""Fuzz the native FMU's C functions with libFuzzer (Debian: clang, libclang-rt-14-dev).

    python -m tests.fuzz.fuzz --seconds 600

Exit code 0 if no error was found, otherwise the fuzzer's, which writes the input that causes the error.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from emcas_fmu.fmi import native
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.parameters import load_parameters

HERE = Path(__file__).parent
# Any GUID: the FMU itself writes the serialized states.
GUID = "{00000000-1111-5222-8333-444444444444}"
SANITIZERS = "address,undefined,float-cast-overflow"


def compile_fuzzer(command: Sequence[str], sanitizers: str, folder: Path, fins: int = 1, fmi: str = "2") -> Path:
    """Compile harness and FMU into one program; raise CalledProcessError if the compiler fails."""
    unit = FmuInterface(fins)
    chosen = replace(FORMATS[fmi], clock=fmi == "3")
    starts = start_values(unit, [load_parameters().values] * fins)
    for name, text in {**native.sources(unit, starts, GUID, chosen), **chosen.standard_headers()}.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "unit.c").write_text(f'#include "{chosen.main}"\n', encoding="utf-8")
    shutil.copy(HERE / "fuzz.c", folder)
    shutil.copy(HERE / f"calls{fmi}.h", folder / "calls.h")
    subprocess.run([*command, "-std=c11", "-Wall", "-Wextra", "-g", "-O1", f"-fsanitize={sanitizers}",
                    "-fno-sanitize-recover=all", "fuzz.c", "-o", "fuzz", "-lm"], cwd=folder, check=True)
    return folder / "fuzz"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--fins", type=int, default=1, help="of the unit")
    parser.add_argument("--fmi", choices=list(FORMATS), default="2", help="version of FMI")
    parser.add_argument("--corpus", type=Path, default=None, help="folder of inputs to begin with and to add to")
    arguments = parser.parse_args()
    if shutil.which("clang") is None:
        print("clang is not installed: apt-get install clang libclang-rt-14-dev", file=sys.stderr)
        return 2
    with TemporaryDirectory() as name:
        folder = Path(name)
        program = compile_fuzzer(["clang"], f"fuzzer,{SANITIZERS}", folder, arguments.fins, arguments.fmi)
        corpus = arguments.corpus or folder / "corpus"
        corpus.mkdir(exist_ok=True)
        command = [program, f"-max_total_time={arguments.seconds}", "-max_len=4000", "-timeout=20",
                   "-print_final_stats=1", f"-artifact_prefix={Path.cwd()}/", corpus]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())

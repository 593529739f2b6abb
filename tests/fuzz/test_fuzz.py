"""Fuzz for a few seconds with the system's compiler; `python -m tests.fuzz.fuzz` does so for ten minutes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .fuzz import SANITIZERS, compile_fuzzer

pytestmark = [pytest.mark.fmu, pytest.mark.skipif(sys.platform != "linux", reason="sanitizers of a Linux compiler")]


@pytest.mark.slow
@pytest.mark.parametrize("fins", [1, 4])
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_random_calls_values_and_states_cause_no_error(tmp_path: Path, fins: int, fmi: str) -> None:
    program = compile_fuzzer(["cc", "-DSTANDALONE"], SANITIZERS, tmp_path, fins, fmi)
    done = subprocess.run([program, "5", "20160101"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    runs, *_ = done.stdout.split()
    assert int(runs) > 1000 / fins


@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_fuzzer_detects_a_missing_check_of_states(tmp_path: Path, fmi: str) -> None:
    program = compile_fuzzer(["cc", "-DSTANDALONE"], SANITIZERS, tmp_path, fmi=fmi)
    source = tmp_path / "states.h"
    text = source.read_text(encoding="utf-8")
    check = "const char *reason = unsound(m, &s);"
    assert check in text
    source.write_text(text.replace(check, "const char *reason = s.fresh ? unsound(m, &s) : NULL;"), encoding="utf-8")
    subprocess.run(["cc", "-DSTANDALONE", "-std=c11", "-g", "-O1", f"-fsanitize={SANITIZERS}",
                    "-fno-sanitize-recover=all", "fuzz.c", "-o", "fuzz", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([program, "20", "20160101"], capture_output=True, check=False).returncode != 0

"""Without the optional packages, commands that need an extra name it, and all others work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.support import extras
from emcas_fmu.support.files import models_directory
from tests.marks import others_slow

EXTRAS = {"analysis": ("control", "casadi"), "campaign": ("filelock", "pyarrow", "distributed"), "native": ("ziglang",)}
EVERY = [module for modules in EXTRAS.values() for module in modules]
MODELS = models_directory()
RECORDS = Path(__file__).resolve().parents[2] / "examples/identification_bench/records"
NEEDED = {"analyse": "analysis", "tune": "analysis", f"campaign {MODELS}/campaign.toml": "campaign",
          "build --backend native": "native", "explore": "native", "ssp": "native"}
BASE = ("parameters", "build", "envelope --plot e.svg --json e.json -o e.csv", "simulate --step 5 --plot s.html",
        "fit", f"identify backlash {RECORDS}/backlash.csv --report b.html",
        "reference --case step_plus1 --directory refs", f"campaign {MODELS}/campaign.toml --only 3")


def without(modules: list[str], command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process that cannot import some modules."""
    program = (f"import sys; sys.modules.update(dict.fromkeys({modules!r})); from emcas_fmu.cli import app; "
               "app(prog_name='emcas')")
    return subprocess.run([sys.executable, "-c", program, *command.split()], cwd=folder, capture_output=True, text=True)


@pytest.mark.parametrize(("command", "extra", "module"), others_slow(
    [(command, extra, module) for command, extra in NEEDED.items() for module in EXTRAS[extra]],
    lambda case: case[::2] in (("analyse", "control"),)))
def test_missing_extra_is_named(command: str, extra: str, module: str, tmp_path: Path) -> None:
    done = without([module], command, tmp_path)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error:")
    assert f"pip install 'emcas-fmu[{extra}]'" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("error", "message"), [
    ('ImportError("libarrow.so: failed to map segment:\\nCannot allocate memory")', "segment: Cannot allocate memory"),
    ("MemoryError()", "there is not enough memory"), ('OSError(12, "Cannot allocate memory")', "allocate memory")])
def test_broken_package_is_not_called_missing(error: str, message: str, tmp_path: Path,
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "heavy_package.py").write_text(f"raise {error}\n")
    monkeypatch.syspath_prepend(tmp_path)
    said = rf"heavy_package, which is installed but cannot be loaded: .*{message}"
    with pytest.raises(EmcasError, match=said) as raised:
        extras.require("campaign", "campaigns need", "heavy_package")
    assert "pip install" not in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_other_commands_need_no_extra(tmp_path: Path) -> None:
    """All run in one process, whose start takes longer than most commands."""
    program = (f"import sys; sys.modules.update(dict.fromkeys({EVERY!r})); from typer.testing import CliRunner; "
               f"from emcas_fmu.cli import app; runs = {{c: CliRunner().invoke(app, c.split()) for c in {BASE!r}}}; "
               "sys.exit('\\n'.join(f'{c}: {run.output}' for c, run in runs.items() if run.exit_code) or 0)")
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

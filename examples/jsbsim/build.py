"""Building of FMUs for a run without --fmu."""

from __future__ import annotations

import shlex
from pathlib import Path

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.fmi.interface import model_name
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.compiler import CompilerError, local_compilers, local_platform, zig


def build_unit(folder: Path, fins: int, model: str = NONLINEAR) -> Path:
    """Build a native FMU of 1 or 4 fins in `folder` for this platform, with a model's default parameters.

    Returns its path. The compiler is zig, or without zig a system compiler. Raises EmcasError for an unknown model, and
    CompilerError, with the remedy, without a compiler.
    """
    parameters = load_parameters(model=model)
    local, cc = local_platform(), None
    if local is not None and zig() is None:
        compiler = next(local_compilers(), None)
        cc = shlex.join(compiler.command) if compiler else None
    if local is None or (zig() is None and cc is None):
        raise CompilerError("without --fmu an FMU is built, which needs a C compiler: pip install 'emcas-fmu[native]'; "
                            "or build a slower FMU without a compiler, `python build_fmu.py --fins 4`, and pass "
                            "--fmu EMCAS4.fmu")
    path = folder / f"{model_name(parameters.model, fins)}.fmu"
    return build(parameters, path, "native", [local.name], cc, fins=fins, layout="cross").path

"""FMUs built for a run without --fmu."""

from __future__ import annotations

import shlex
from pathlib import Path

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.fmi.interface import model_name
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.compiler import CompilerError, local_compilers, local_platform, zig


def build_unit(folder: Path, fins: int, model: str = NONLINEAR) -> Path:
    """A native unit of 1 or 4 fins of a model with default parameters, for this platform, in `folder`.

    By zig, or a system compiler where there is no zig. Raises EmcasError where there is no such model, and
    CompilerError with the remedy where there is neither compiler.
    """
    parameters = load_parameters(model=model)
    local, cc = local_platform(), None
    if local is not None and zig() is None:
        compiler = next(local_compilers(), None)
        cc = shlex.join(compiler.command) if compiler else None
    if local is None or (zig() is None and cc is None):
        raise CompilerError("without --fmu one is built, which needs a C compiler: pip install "
                            "'emcas-fmu[native]', or build a slower one without compiler, "
                            "`python build_fmu.py --fins 4`, and give --fmu EMCAS4.fmu")
    path = folder / f"{model_name(parameters.model, fins)}.fmu"
    return build(parameters, path, "native", [local.name], cc, fins=fins, layout="cross").path

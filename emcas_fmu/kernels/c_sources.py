"""The C of the actuator: what is written by hand beside this file, and the headers generated for it."""

from __future__ import annotations

import re
from importlib.resources import files

from ..consistency import LONGEST_DELAY
from ..variables import INPUTS, OUTPUTS, PARAMETERS
from . import core, program

_NOTE = "/* {}; generated, do not edit. */\n"


def written(name: str, package: str = "emcas_fmu.kernels") -> str:
    """A source written by hand."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def kernel_header() -> str:
    """kernel.h: the equations."""
    return (_NOTE.format("The actuator's equations as straight-line code")
            + f"#ifndef EMCAS_KERNEL_H\n#define EMCAS_KERNEL_H\n\n#include <math.h>\n\n{program.c_kernel()}\n#endif\n")


def enumerator(name: str) -> str:
    """A variable's name as part of a C identifier: ``acceleration.x`` gives ACCELERATION_X."""
    return re.sub(r"\W+", "_", name).upper()


def model_header() -> str:
    """model.h: sizes, limits and the places of the inputs."""
    inputs = "".join(f"    INPUT_{enumerator(v.name)} = {i},\n" for i, v in enumerate(INPUTS))
    return (_NOTE.format("Sizes, limits and the order of the inputs")
            + "#ifndef EMCAS_MODEL_H\n#define EMCAS_MODEL_H\n\nenum {\n"
            f"    CORE_LINE = {LONGEST_DELAY + 2},\n    CORE_MOST_EVENTS = {core.MOST_EVENTS},\n"
            f"    CORE_MOST_TICKS = {core.MOST_TICKS},\n    MODEL_INPUTS = {len(INPUTS)},\n"
            f"    MODEL_OUTPUTS = {len(OUTPUTS)},\n    MODEL_PARAMETERS = {len(PARAMETERS)}\n}};\n\n"
            f"enum {{\n{inputs.rstrip().rstrip(',')}\n}};\n\n#endif\n")


def core_sources() -> dict[str, str]:
    """Headers that hold the actuator: file name to text."""
    return {"kernel.h": kernel_header(), "model.h": model_header(), "core.h": written("core.h")}

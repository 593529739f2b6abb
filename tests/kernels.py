"""Write the generated equations of every model, to compare before and after a change with `diff -r`.

    python -m tests.kernels FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

from emcas_fmu.actuators import EXTENSIONS, NAMES, get, get_extension
from emcas_fmu.runtime.c_sources import kernel_header


def models() -> list[str]:
    """Return every actuator, and every one with each extension it can have."""
    return [*NAMES, *(f"{name}+{extension}" for name in NAMES for extension in EXTENSIONS
                      if get(name).provides.issuperset(get_extension(extension).needs))]


def write(folder: Path) -> None:
    """Write NAME.h for one fin and NAME_fins.h for several, of every model."""
    folder.mkdir(parents=True, exist_ok=True)
    for model in models():
        for several, ending in ((False, ""), (True, "_fins")):
            (folder / f"{model}{ending}.h").write_text(kernel_header(several, model), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]))

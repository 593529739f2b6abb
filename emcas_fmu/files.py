"""Where the project's data files are."""

from __future__ import annotations

from pathlib import Path


def models_directory() -> Path:
    """The folder of parameter sets: inside the package when installed, beside it in a checkout.

    Raises FileNotFoundError naming the file looked for and both places.
    """
    package = Path(__file__).resolve().parent
    folders = (package / "models", package.parent / "models")
    for folder in folders:
        if (folder / "emcas.toml").is_file():
            return folder
    raise FileNotFoundError("the default parameter file emcas.toml is missing: "
                            f"looked in {folders[0]} and {folders[1]}")

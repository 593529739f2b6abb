"""Tables and pictures of docs/model/measured.md, which compare simulated with measured actuators.

    EMCAS_RECORDS=FOLDER python docs/figures/make_measured.py           # writes tables and pictures
    EMCAS_RECORDS=FOLDER python docs/figures/make_measured.py --check   # exit code 1 if a table is stale

FOLDER contains the records of EMPS in emps and of the XL330 in xl330, which are not part of this project.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from make_tables import main, markdown

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from examples.emps import compare as emps_compare
from examples.xl330 import compare as xl330_compare

FIGURES = Path(__file__).resolve().parent
FOLDER = "EMCAS_RECORDS"
ERRORS = {"force_percent": ".2f", "position_percent": ".5f", "window_rms_mm": ".2f", "window_rms_mm_level": ".2f"}


def figures(program: Callable[[Path], Any]) -> dict[str, Any]:
    """Return the JSON document that `program(path)` writes."""
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        path = Path(folder) / "figures.json"
        program(path)
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def emps(document: Mapping[str, Any]) -> str:
    """Return the table of the EMPS drive's errors, with the authors' parameters and with the calibrated ones."""
    sets = [*((f"authors, {name}", each) for name, each in document["authors"].items()), ("this model", document)]
    return markdown(("parameters", "record", "force %", "position %", "windows mm", "with level mm"), (
        (words, record, *(format(each[record][name], form) if name in each[record] else "" for name, form in
                          ERRORS.items())) for words, each in sets for record in ("fitted", "unseen")))


def xl330(document: Mapping[str, Any]) -> str:
    """Return the table of the XL330's position errors for each record."""
    rows = [(each["trajectory"].replace("_", " "), f"{each['kp']:.0f}", f"{each['mean_abs_error_mrad']:.1f}")
            for each in sorted(document["records"], key=lambda each: (each["trajectory"], each["kp"]))]
    return markdown(("trajectory", "firmware gain", "mean absolute error, mrad"),
                    [*rows, ("mean", "", f"{document['mean_abs_error_mrad']:.1f}")])


def documents(folder: Path, pictures: bool) -> dict[str, dict[str, Callable[[], str]]]:
    """Run the comparisons, and return the functions that make the page's tables; with `pictures` also plot these."""
    plots = [FIGURES / f"measured_{name}.png" if pictures else None for name in ("emps", "xl330")]
    drive = figures(lambda path: emps_compare.compare(folder, path, plots[0]))
    servo = figures(lambda path: xl330_compare.main([
        "--records", str(folder / "xl330"), "--json", str(path), *(["--plot", str(plots[1])] if plots[1] else [])]))
    return {"model/measured.md": {"emps": partial(emps, drive), "xl330": partial(xl330, servo)}}


if __name__ == "__main__":
    if not os.environ.get(FOLDER):
        sys.exit(f"no records: set {FOLDER} to their folder; docs/model/measured.md says where they are published")
    checked = "--check" in sys.argv[1:]
    sys.exit(main(checked, documents(Path(os.environ[FOLDER]), not checked), "make_measured.py"))

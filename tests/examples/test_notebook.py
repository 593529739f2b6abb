"""The notebook runs and gives the stored outputs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples/notebook/first_steps.ipynb"
pytestmark = [pytest.mark.fmu, pytest.mark.slow]  # starts a Jupyter kernel and draws every picture


def shown(cells: list[Any]) -> list[str]:
    """Return the cells' text outputs without sizes in KiB, which depend on the version in the FMU."""
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    data = [{"text/plain": output.get("text"), **output.get("data", {})} for output in outputs]
    texts = ["".join(each.get("text/html") or each["text/plain"]) for each in data]
    return [text for text in texts if "KiB" not in text]


@pytest.mark.filterwarnings("ignore")  # of Jupyter
def test_notebook_gives_the_stored_outputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    again = nbformat.reads(json.dumps(stored), 4)
    monkeypatch.setenv("PYTHONPATH", str(NOTEBOOK.parents[2]))
    nbclient.NotebookClient(again, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert shown(again.cells) == shown(stored["cells"])
    assert len(shown(stored["cells"])) >= 6

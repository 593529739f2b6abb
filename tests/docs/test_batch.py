"""The code blocks of docs/use/batch.md run one after another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from emcas_fmu.runtime import batch, library
from tests.hosts.host import missing

from .recipes import ROOT, recipes


def test_code_blocks_run(capsys: pytest.CaptureFixture[str]) -> None:
    if not library.available():
        missing("there is no C compiler")
    page = (ROOT / "docs/use/batch.md").read_text(encoding="utf-8")
    assert f"for {library.WORTH_VECTORS // batch.STEPS} actuators or more" in page
    names: dict[str, Any] = {}
    for language, text in recipes("use/batch.md").values():
        assert language == "python"
        exec(text, names)
    assert 0.01 < np.median(names["rise"]) < np.max(names["rise"]) < 0.2
    assert np.degrees(np.abs(names["attitude"]).max()) < 0.5  # from up to 10 deg at the start
    assert len(set(names["three"].outputs["fin_angle"])) == 1  # all three have reached the command
    *_, first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("actuator 1: friction.temperature")
    assert second.startswith("actuators 1: ")

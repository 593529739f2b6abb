"""The campaign with requirements in docs/tools/campaigns.md gives the table of the page."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app

from .recipes import ROOT, recipes

PAGE = "tools/campaigns.md"


@pytest.mark.slow
def test_campaign_gives_the_table_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = recipes(PAGE)
    assert sorted(blocks) == ["campaign", "judged", "specification"]
    for name in ("campaign", "specification"):
        text = blocks[name][1]
        Path(text.splitlines()[0].removeprefix("# ")).write_text(text, encoding="utf-8")
    result = CliRunner().invoke(app, shlex.split(blocks["judged"][1])[1:])
    assert result.exit_code == 0, result.output + result.stderr
    found = json.loads(Path("judged/summary.json").read_text(encoding="utf-8"))["requirements"]
    table = (ROOT / "docs" / PAGE).read_text(encoding="utf-8").partition("<!-- judged -->")[2].partition("<!-- /")[0]
    rows = [line.split("|") for line in table.split("\n") if " of 100 " in line]
    met = {row[1].strip(" `"): int(row[-3].split()[0]) for row in rows}
    assert met == {**{r["name"]: r["met"] for r in found["each"]}, "all": found["all"]["met"]}
    assert 0 < found["all"]["met"] < 100

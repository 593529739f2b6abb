"""Stored results: complete parts with their provenance, no sample twice, no mixture of two campaigns."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from emcas_fmu import __version__
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.run import in_process
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study

from .conftest import SMALL, Write


def test_parts_contain_their_provenance(small: Campaign, store: Store, tmp_path: Path) -> None:
    in_process(small, store.missing()[:5], store.write, 5)
    part = next((tmp_path / "out" / "samples").glob("*.parquet"))
    metadata = {k.decode(): v.decode() for k, v in pq.read_schema(part).metadata.items()}
    assert metadata["emcas.guid"] == build(load_parameters(), tmp_path / "E.fmu").guid
    assert metadata["emcas.version"] == __version__
    assert metadata["emcas.campaign"] == SMALL
    assert json.loads(metadata["emcas.parameters"]) == dict(load_parameters().values)
    assert store.missing().tolist() == list(range(5, 24))
    table = store.table()
    assert table["index"].to_pylist() == list(range(5))
    assert set(table["seed"].to_pylist()) == {5}


def test_partial_file_is_ignored_and_removed(small: Campaign, store: Store, tmp_path: Path) -> None:
    in_process(small, store.missing()[:4], store.write, 4)
    partial = tmp_path / "out" / "samples" / ".part-000000004.parquet.1.partial"
    partial.write_bytes(b"PAR1")
    store.close()
    with Store(tmp_path / "out", small) as again:
        assert again.missing().tolist() == list(range(4, 24))
    assert not partial.exists()


def test_folder_of_a_run_killed_before_its_first_sample_is_usable(small: Campaign, tmp_path: Path) -> None:
    (tmp_path / "out" / "samples").mkdir(parents=True)
    (tmp_path / "out" / ".campaign.json.1.partial").write_bytes(b"{")
    assert len(Store(tmp_path / "out", small).missing()) == 24


def test_sample_stored_twice_is_read_once(small: Campaign, store: Store) -> None:
    in_process(small, store.missing()[:4], store.write, 4)
    in_process(small, store.missing()[:2], store.write, 2)
    rows = store.table().slice(3, 2).to_pydict()
    store.write({**rows, "index": [3, 4]})  # the part is named after sample 3, which another part contains
    assert store.table()["index"].to_pylist() == [0, 1, 2, 3, 4, 5]


def test_interrupted_write_leaves_no_part(small: Campaign, store: Store, tmp_path: Path,
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        in_process(small, store.missing()[:4], store.write, 4)
    assert list((tmp_path / "out" / "samples").glob("part-*")) == []
    assert len(store.missing()) == 24


@pytest.mark.parametrize(("before", "after", "message"), [
    ("seed = 5", "seed = 7", "campaign.seed: 5 then, 7 now"),
    ('sd = "3 %"', 'sd = "4 %"', "vary.motor.torque_constant.sd: '3 %' then, '4 %' now"),
    ("[campaign]", '[base]\nparameters = "p.toml"\n[campaign]', "parameters.motor.resistance: 0.25 then, 0.3 now"),
])
def test_other_campaigns_folder_is_refused(write: Write, tmp_path: Path, before: str, after: str, message: str) -> None:
    (tmp_path / "p.toml").write_text('[motor]\nresistance = "0.3 Ohm"\n', encoding="utf-8")
    Store(tmp_path / "out", load_study(write(SMALL))).close()
    changed = load_study(write(SMALL.replace(before, after, 1)))
    with pytest.raises(CampaignError) as refused:
        Store(tmp_path / "out", changed)
    assert message in str(refused.value)
    assert "--output" in str(refused.value)


def test_changed_comment_is_the_same_campaign(write: Write, tmp_path: Path) -> None:
    Store(tmp_path / "out", load_study(write(SMALL))).close()
    assert len(Store(tmp_path / "out", load_study(write(f"# comment\n{SMALL}"))).missing()) == 24


def test_folder_of_something_else_is_refused(small: Campaign, tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="is not the folder of a campaign"):
        Store(tmp_path, small)  # contains the campaign's file
    (tmp_path / "out").mkdir()
    for text in ("[]", "[" * 100_000):
        (tmp_path / "out" / "campaign.json").write_text(text, encoding="utf-8")
        with pytest.raises(CampaignError, match="is not the record of a campaign"):
            Store(tmp_path / "out", small)
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(CampaignError, match="is a file"):
        Store(tmp_path / "file", small)


def test_error_names_an_unreadable_part(store: Store, tmp_path: Path) -> None:
    (tmp_path / "out" / "samples" / "part-000000000.parquet").write_bytes(b"broken")
    with pytest.raises(CampaignError, match=r"part-000000000\.parquet: cannot be read .* remove it"):
        store.missing()

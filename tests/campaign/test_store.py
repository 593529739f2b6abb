"""Results on disk: whole parts, what they belong to, nothing twice, no mixture of two campaigns."""

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
from emcas_fmu.studies.campaign.study import Study, load_study

from .conftest import SMALL, Write


def test_what_is_kept_with_the_rows(small: Study, store: Store, tmp_path: Path) -> None:
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


def test_a_part_half_written_does_not_count(small: Study, store: Store, tmp_path: Path) -> None:
    in_process(small, store.missing()[:4], store.write, 4)
    partial = tmp_path / "out" / "samples" / ".part-000000004.parquet.1.partial"
    partial.write_bytes(b"PAR1")
    store.close()
    with Store(tmp_path / "out", small) as again:
        assert again.missing().tolist() == list(range(4, 24))
    assert not partial.exists()


def test_killed_before_the_first_sample(small: Study, tmp_path: Path) -> None:
    (tmp_path / "out" / "samples").mkdir(parents=True)
    (tmp_path / "out" / ".campaign.json.1.partial").write_bytes(b"{")
    assert len(Store(tmp_path / "out", small).missing()) == 24


def test_a_sample_kept_twice_is_read_once(small: Study, store: Store) -> None:
    in_process(small, store.missing()[:4], store.write, 4)
    in_process(small, store.missing()[:2], store.write, 2)
    rows = store.table().slice(3, 2).to_pydict()
    store.write({**rows, "index": [3, 4]})  # named after sample 3, which is in another part
    assert store.table()["index"].to_pylist() == [0, 1, 2, 3, 4, 5]


def test_a_part_is_whole_or_not_there(small: Study, store: Store, tmp_path: Path,
                                      monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that ends before its rows are on disk leaves no part of that name."""
    def ended(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", ended)
    with pytest.raises(KeyboardInterrupt):
        in_process(small, store.missing()[:4], store.write, 4)
    assert list((tmp_path / "out" / "samples").glob("part-*")) == []
    assert len(store.missing()) == 24


@pytest.mark.parametrize(("before", "after", "said"), [
    ("seed = 5", "seed = 7", "campaign.seed: 5 then, 7 now"),
    ('sd = "3 %"', 'sd = "4 %"', "vary.motor.torque_constant.sd: '3 %' then, '4 %' now"),
    ("[campaign]", '[base]\nparameters = "p.toml"\n[campaign]', "parameters.motor.resistance: 0.25 then, 0.3 now"),
])
def test_another_campaign_is_refused(write: Write, tmp_path: Path, before: str, after: str, said: str) -> None:
    (tmp_path / "p.toml").write_text('[motor]\nresistance = "0.3 Ohm"\n', encoding="utf-8")
    Store(tmp_path / "out", load_study(write(SMALL))).close()
    changed = load_study(write(SMALL.replace(before, after, 1)))
    with pytest.raises(CampaignError) as refused:
        Store(tmp_path / "out", changed)
    assert said in str(refused.value)
    assert "--output" in str(refused.value)


def test_a_comment_is_no_change(write: Write, tmp_path: Path) -> None:
    Store(tmp_path / "out", load_study(write(SMALL))).close()
    assert len(Store(tmp_path / "out", load_study(write(f"# said later\n{SMALL}"))).missing()) == 24


def test_folders_of_something_else(small: Study, tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="is not the folder of a campaign"):
        Store(tmp_path, small)  # the campaign's file is in it
    (tmp_path / "out").mkdir()
    for text in ("[]", "[" * 100_000):
        (tmp_path / "out" / "campaign.json").write_text(text, encoding="utf-8")
        with pytest.raises(CampaignError, match="is not the record of a campaign"):
            Store(tmp_path / "out", small)
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(CampaignError, match="is a file"):
        Store(tmp_path / "file", small)


def test_a_broken_part_is_named(store: Store, tmp_path: Path) -> None:
    (tmp_path / "out" / "samples" / "part-000000000.parquet").write_bytes(b"broken")
    with pytest.raises(CampaignError, match=r"part-000000000\.parquet: cannot be read .* remove it"):
        store.missing()

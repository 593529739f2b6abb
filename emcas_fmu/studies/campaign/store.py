"""Results on disk: a folder of Parquet parts, each written whole or not at all, and the record of their campaign.

One run at a time writes to a folder. The lock is the operating system's, which releases it when the process ends.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from ... import __version__
from ...actuators import NONLINEAR
from ...bench.requirements import Specification
from ...parameters.schema import leaves
from ...support.writing import PARTIAL, write
from .distributions import CampaignError
from .sample import Rows, columns, observed
from .study import Study

SCHEMA = "emcas-campaign/1"
MANIFEST, PARTS, LOCK, OWNER = "campaign.json", "samples", ".lock", ".owner"
_TYPES = {"Real": pa.float64(), "Integer": pa.int64(), "Boolean": pa.bool_(), "Enumeration": pa.string()}
_WORDS = {"title", "source", "reason"}  # fields of a requirement that do not change rows
_MOST_NAMED = 6  # changes named in a refusal


def identity(study: Study) -> dict[str, Any]:
    """Return all on which the rows depend, for JSON: the campaign, parameters, model or FMU, the program's version."""
    plan = study.plan
    model = {} if plan.model == NONLINEAR else {"model": plan.actuator.name}
    if plan.model_sha256:
        model["model_sha256"] = plan.model_sha256
    return {"schema": SCHEMA, "version": __version__, "guid": study.guid, "fmu_sha256": plan.fmu_sha256, **model,
            "fin": plan.fin, **_judged(plan.specification), "campaign": json.loads(json.dumps(study.document)),
            "parameters": dict(plan.base)}


def _judged(specification: Specification) -> dict[str, Any]:
    """Return the requirements and cases by which samples are judged, for JSON."""
    if not specification.requirements:
        return {}
    requirements = {r.name: {**r.model_dump(exclude={"test", *_WORDS}), "test": r.test and asdict(r.test)}
                    for r in specification.requirements}
    cases = {case.name: [dict(case.values), dict(case.shares)] for case in specification.cases}
    document: dict[str, Any] = json.loads(json.dumps({"requirements": requirements, "cases": cases}))
    return document


class Store:
    """The results of a campaign in a folder, which is made if it does not exist and locked until `close`.

    Raises CampaignError if the folder contains another campaign, naming the differences, cannot be read, or another
    run writes to it.
    """

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder, self._parts_folder, self._study = folder, folder / PARTS, study
        self._identity = identity(study)
        self._schema = _schema(study)
        manifest = folder / MANIFEST
        if folder.exists() and not folder.is_dir():
            raise CampaignError(f"{folder}: is a file; name a folder")
        if folder.is_dir() and not manifest.is_file() and not _unused(folder):
            raise CampaignError(f"{folder}: is no folder of a campaign; name one that is empty or not there yet")
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(folder)
        try:
            self._begin(manifest)
        except BaseException:
            self.close()
            raise

    def _begin(self, manifest: Path) -> None:
        for folder in (self.folder, self._parts_folder):
            for partial in folder.glob(f".*{PARTIAL}"):  # left by a run that was killed
                partial.unlink()
        if manifest.is_file():
            _check_same(manifest, self._identity)
            return
        self._parts_folder.mkdir(exist_ok=True)
        text = json.dumps({**self._identity, "text": self._study.text}, indent=1)
        write(manifest, text + "\n")

    def close(self) -> None:
        """Let another run write here."""
        if self._lock.is_locked:
            (self.folder / OWNER).unlink(missing_ok=True)
            self._lock.release()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def missing(self) -> NDArray[np.int64]:
        """Return the indices of the samples without a row, ascending."""
        missing = np.ones(self._study.samples, dtype=bool)
        for part in self._parts():
            missing[_read(part, ["index"])["index"].to_numpy()] = False
        return np.flatnonzero(missing)

    def write(self, rows: Rows) -> Path:
        """Write rows as a new part of one row group; they are on disk when this returns."""
        # The name is unused: a part of this name would contain the first of these rows.
        name = f"part-{min(rows['index']):09d}.parquet"
        sink = pa.BufferOutputStream()
        # Figures hardly repeat and are not searched by range: dictionaries and statistics would only take space.
        pq.write_table(pa.Table.from_pydict(rows, self._schema), sink, compression="zstd",
                       use_dictionary=["status", "error"], write_statistics=["index"])
        part = self._parts_folder / name
        write(part, sink.getvalue().to_pybytes())
        return part

    def table(self) -> pa.Table:
        """Return all rows, sorted by index and without duplicates."""
        parts = [_read(part) for part in self._parts()]
        if not parts:
            return self._schema.empty_table()
        rows = pa.concat_tables(parts)
        # Parts that were copied from another folder may contain a sample again; its row is the same.
        _, first = np.unique(rows["index"].to_numpy(), return_index=True)
        return rows.take(pa.array(first))

    def _parts(self) -> list[Path]:
        return sorted(self._parts_folder.glob("part-*.parquet"))


def _locked(folder: Path) -> FileLock:
    """Lock a folder and return the lock. Raises CampaignError, naming the process, if another run has locked it."""
    lock, owner = FileLock(folder / LOCK), folder / OWNER
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        holder = ""
        with suppress(OSError):
            holder = owner.read_text(encoding="utf-8")
        raise CampaignError(f"another run ({holder or 'pid unknown'}) writes to {folder}; wait for it, or name another "
                            "folder with --output") from error
    # In a file of its own: some systems do not let others read a locked file.
    try:
        write(owner, f"pid {os.getpid()} on {platform.node()}")
    except BaseException:
        lock.release()
        raise
    return lock


def _unused(folder: Path) -> bool:
    """Return whether a folder is empty, or contains only what a run leaves that was killed before its first sample."""
    return all(path.name in (PARTS, LOCK, OWNER) or path.suffix == PARTIAL for path in folder.iterdir()) and not any(
        (folder / PARTS).glob("*"))


def _schema(study: Study) -> pa.Schema:
    plan = study.plan
    fields = [("index", pa.int64()), ("seed", pa.int64()), *((f.name, _TYPES[f.type]) for f in plan.factors),
              *((name, pa.float64()) for name in plan.followers),
              *((name, pa.float64()) for name in columns(plan)),
              *((name, _TYPES[output.kind]) for name, output in observed(plan).items()),
              ("status", pa.string()), ("error", pa.string())]
    metadata = {"emcas.schema": SCHEMA, "emcas.version": __version__, "emcas.guid": study.guid,
                "emcas.fmu_sha256": plan.fmu_sha256, "emcas.campaign": study.text,
                "emcas.campaign_sha256": hashlib.sha256(study.text.encode()).hexdigest(),
                "emcas.parameters": json.dumps(plan.base), **{
                    f"emcas.{name}": json.dumps(entry) for name, entry in _judged(plan.specification).items()}}
    return pa.schema(fields, metadata=metadata)


def _read(part: Path, names: Sequence[str] | None = None) -> pa.Table:
    try:
        return pq.ParquetFile(part).read(names)
    except (OSError, pa.ArrowException) as error:
        raise CampaignError(f"{part}: cannot be read ({error}); remove it, and its samples will be run "
                            "again") from error


def _check_same(manifest: Path, campaign: Mapping[str, Any]) -> None:
    """Raise CampaignError, naming the differences, if the folder contains another campaign."""
    try:
        document = json.loads(manifest.read_text(encoding="utf-8"))
        document.pop("text")
        before = dict(leaves(document, _is_filled))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise CampaignError(f"{manifest}: is no record of a campaign; name another folder") from error
    now = dict(leaves(campaign, _is_filled))
    changed = [f"{name.removeprefix('campaign.')}: {_shown(before, name)} then, {_shown(now, name)} now"
               for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
    if changed:
        more = f"; and {len(changed) - _MOST_NAMED} more" if len(changed) > _MOST_NAMED else ""
        raise CampaignError(f"{manifest.parent}: holds another campaign; {'; '.join(changed[:_MOST_NAMED])}{more}. "
                            "Restore what changed, or name another folder with --output")


def _is_filled(name: str, table: Mapping[str, Any]) -> bool:
    return bool(table)


def _shown(values: Mapping[str, Any], name: str) -> str:
    return repr(values[name]) if name in values else "not given"

"""Results on disk: a folder of Parquet files (parts), each written whole or not at all, and a record of the campaign.

Only one process at a time writes to a folder. The operating system releases the folder's lock when that process ends.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
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
from .extension_outputs import observed
from .sample import SampleColumns, columns
from .study import Campaign

SCHEMA = "emcas-campaign/2"
MANIFEST, PARTS, LOCK, OWNER = "campaign.json", "samples", ".lock", ".owner"
_TYPES = {"Real": pa.float64(), "Integer": pa.int64(), "Boolean": pa.bool_(), "Enumeration": pa.string()}
_WITHOUT_EFFECT = {"title", "source", "reason"}  # fields of a requirement that do not affect rows
_MOST_NAMED = 6  # most changes that a message names


def identity(study: Campaign) -> dict[str, Any]:
    """Return everything that determines the rows, for JSON: campaign, parameters, model or FMU, and package version."""
    model = {} if study.model == NONLINEAR else {"model": study.actuator.name}
    if study.model_sha256:
        model["model_sha256"] = study.model_sha256
    return {"schema": SCHEMA, "version": __version__, "guid": study.guid, "fmu_sha256": study.fmu_sha256, **model,
            "fin": study.fin, **_judged(study.specification), "campaign": json.loads(json.dumps(study.document)),
            "parameters": dict(study.base)}


def _judged(specification: Specification) -> dict[str, Any]:
    """Return the requirements and cases by which samples are judged, for JSON."""
    if not specification.requirements:
        return {}
    requirements = {r.name: {**r.model_dump(exclude={"test", *_WITHOUT_EFFECT}), "test": r.test and asdict(r.test)}
                    for r in specification.requirements}
    cases = {case.name: [dict(case.values), dict(case.shares)] for case in specification.cases}
    document: dict[str, Any] = json.loads(json.dumps({"requirements": requirements, "cases": cases}))
    return document


class Store(AbstractContextManager["Store"]):
    """The results of a campaign in a folder, which is created if it does not exist, and locked until `close`.

    Raises CampaignError if the folder contains something else or another campaign (the message names the differences),
    or if another process writes to it.
    """

    def __init__(self, folder: Path, study: Campaign) -> None:
        self.folder, self._parts, self._study, self._schema = folder, folder / PARTS, study, _schema(study)
        manifest = folder / MANIFEST
        if folder.exists() and not folder.is_dir():
            raise CampaignError(f"{folder}: is a file; name a folder")
        if folder.is_dir() and not manifest.is_file() and not _unused(folder):
            raise CampaignError(f"{folder}: is not the folder of a campaign; name an empty or a new folder")
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(folder)
        try:
            for partial in (*folder.glob(f".*{PARTIAL}"), *self._parts.glob(f".*{PARTIAL}")):
                partial.unlink()  # left by a process that was killed
            if manifest.is_file():
                _check_same(manifest, identity(study))
            else:
                self._parts.mkdir(exist_ok=True)
                write(manifest, json.dumps({**identity(study), "text": study.text}, indent=1) + "\n")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the folder for other processes."""
        if self._lock.is_locked:
            (self.folder / OWNER).unlink(missing_ok=True)
            self._lock.release()

    def __exit__(self, *_: object) -> None:
        self.close()

    def missing(self) -> NDArray[np.int64]:
        """Return the indices of the samples without a row, in ascending order."""
        missing = np.ones(self._study.samples, dtype=bool)
        for table in self._tables(["index"]):
            missing[table["index"].to_numpy()] = False
        return np.flatnonzero(missing)

    def write(self, rows: SampleColumns) -> Path:
        """Write rows as a new part with one row group, and return its path; the part is then on disk."""
        sink = pa.BufferOutputStream()
        # Figures rarely repeat and are not searched by range: dictionaries and statistics would only waste space.
        pq.write_table(pa.Table.from_pydict(rows, self._schema), sink, compression="zstd",
                       use_dictionary=["status", "error"], write_statistics=["index"])
        # No part has this name: it would already contain the first of these rows.
        part = self._parts / f"part-{min(rows['index']):09d}.parquet"
        write(part, sink.getvalue().to_pybytes())
        return part

    def table(self) -> pa.Table:
        """Return all rows, sorted by index and without duplicates. Raises CampaignError for an unreadable part."""
        rows = pa.concat_tables([self._schema.empty_table(), *self._tables()])
        # Parts copied from another folder may repeat a sample; the rows are equal.
        _, first = np.unique(rows["index"].to_numpy(), return_index=True)
        return rows.take(pa.array(first))

    def _tables(self, names: Sequence[str] | None = None) -> Iterator[pa.Table]:
        for part in sorted(self._parts.glob("part-*.parquet")):
            try:
                yield pq.ParquetFile(part).read(names)
            except (OSError, pa.ArrowException) as error:
                raise CampaignError(f"{part}: cannot be read ({error}); remove it, and repeat the command: it runs "
                                    "these samples again") from error


def _locked(folder: Path) -> FileLock:
    """Lock a folder and return the lock. Raises CampaignError, naming the process, if another process has locked it."""
    lock, owner = FileLock(folder / LOCK), folder / OWNER
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        holder = ""
        with suppress(OSError):
            holder = owner.read_text(encoding="utf-8")
        raise CampaignError(f"another process ({holder or 'pid unknown'}) writes to {folder}; wait until it ends, or "
                            "name another folder with --output") from error
    # The process is named in a separate file: on some systems other processes cannot read a locked file.
    try:
        write(owner, f"pid {os.getpid()} on {platform.node()}")
    except BaseException:
        lock.release()
        raise
    return lock


def _unused(folder: Path) -> bool:
    """Return whether a folder is empty, or a process was killed in it before the first sample."""
    return all(path.name in (PARTS, LOCK, OWNER) or path.suffix == PARTIAL for path in folder.iterdir()) and not any(
        (folder / PARTS).glob("*"))


def _schema(study: Campaign) -> pa.Schema:
    fields = [("index", pa.int64()), ("seed", pa.int64()), *((f.name, _TYPES[f.type]) for f in study.factors),
              *((name, pa.float64()) for name in (*study.followers, *columns(study))),
              *((name, _TYPES[output.kind]) for name, output in observed(study).items()),
              ("status", pa.string()), ("error", pa.string())]
    texts = {"schema": SCHEMA, "version": __version__, "guid": study.guid, "fmu_sha256": study.fmu_sha256,
             "campaign": study.text, "campaign_sha256": hashlib.sha256(study.text.encode()).hexdigest()}
    entries = {"parameters": study.base, **_judged(study.specification)}
    texts |= {name: json.dumps(entry) for name, entry in entries.items()}
    return pa.schema(fields, metadata={f"emcas.{name}": text for name, text in texts.items()})


def _check_same(manifest: Path, campaign: Mapping[str, Any]) -> None:
    """Raise CampaignError with the differences if the manifest describes another campaign."""
    def entries(document: Mapping[str, Any]) -> dict[str, Any]:
        return dict(leaves(document, lambda _, table: bool(table)))

    def shown(values: Mapping[str, Any], name: str) -> str:
        return repr(values[name]) if name in values else "nothing"

    try:
        document = json.loads(manifest.read_text(encoding="utf-8"))
        document.pop("text")
        stored = entries(document)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise CampaignError(f"{manifest}: is not the record of a campaign; name another folder") from error
    now = entries(campaign)
    changed = [f"{name.removeprefix('campaign.')}: {shown(stored, name)} then, {shown(now, name)} now"
               for name in sorted({*stored, *now}) if stored.get(name) != now.get(name)]
    if stored.get("schema") != now["schema"]:
        raise CampaignError(f"{manifest.parent}: was written by emcas {stored.get('version')}, in another layout; name "
                            "another folder with --output")
    if changed:
        more = f"; and {len(changed) - _MOST_NAMED} more" if len(changed) > _MOST_NAMED else ""
        raise CampaignError(f"{manifest.parent}: contains another campaign; {'; '.join(changed[:_MOST_NAMED])}{more}. "
                            "Undo these changes, or name another folder with --output")

"""Tables of docs/use/clients.md: FMUs in clients nobody here wrote, run as the tests run them, and what they say.

    python docs/figures/make_clients.py           # writes them, fmusim's where that is on the path; some minutes
    python docs/figures/make_clients.py --check   # exit code 1 where one is stale
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from make_tables import DOCS, main, markdown

ROOT = DOCS.parent
if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))

from tests.interop import matrix  # noqa: E402
from tests.interop.clients import CHECKS, CLIENTS  # noqa: E402
from tests.interop.units import UNITS  # noqa: E402

PAGE = "use/clients.md"


def _version(client: str) -> str:
    """What CI installs, of the newer Python's; of fmusim what it says itself."""
    package = CLIENTS[client].package
    if not package:
        done = subprocess.run(["fmusim", "--version"], capture_output=True, text=True, check=True)
        return done.stdout.split()[1]
    name = re.compile(package.replace("-", "[-_]") + r"==([^;\s]+)(?!.*<)", re.IGNORECASE)
    (version,) = [found[1] for line in (ROOT / ".ci" / "constraints.txt").read_text(encoding="utf-8").splitlines()
                  if (found := name.match(line))]
    return version


def _cell(unit: str, client: str, runs: matrix.Runs) -> str:
    """What came of a pair."""
    outcome = runs.outcome(unit, client)
    if outcome.code:
        return "fails"
    if client in CHECKS:
        return "passes"
    off = matrix.from_fmpy(UNITS[unit], client, outcome.found, runs.outcome(unit, "fmpy").found)
    if UNITS[unit].reference:
        return f"{matrix.from_reference(UNITS[unit], outcome.found):.2g}°" + (f", {off:.0e}" if off else "")
    return f"{off:.0e}" if off else "runs" if client == "fmpy" else "same"


def _matrix(clients: Iterable[str], runs: matrix.Runs) -> str:
    """Clients by FMUs."""
    pairs = set(matrix.pairs())
    return markdown(("client", "version", *(u.title for u in UNITS.values())), (
        (CLIENTS[c].title, _version(c), *(_cell(u, c, runs) if (u, c) in pairs else "–" for u in UNITS))
        for c in clients))


def messages() -> str:
    """What clients say, as the tests' list has it."""
    rows = []
    for complaint in matrix.known():
        text = re.sub(r"\\(.)", r"\1", complaint.text.replace(".+", "…").replace(".*", "…")).replace("|", r"\|")
        spared = [unit for unit in UNITS if unit not in complaint.units]
        units = (", ".join(UNITS[u].title for u in complaint.units) if len(spared) > 1 else
                 f"all but {UNITS[spared[0]].title}" if spared else "all")
        rows.append((", ".join(CLIENTS[c].title for c in complaint.clients), units, f"`{text}`", complaint.meaning,
                     complaint.whose))
    return markdown(("client", "FMU", "says", "which means", "to mend"), rows)


def tables(runs: matrix.Runs) -> Mapping[str, Callable[[], str]]:
    """What this machine can make of them."""
    here = {client for _, client in matrix.pairs()}
    made: dict[str, Callable[[], str]] = {
        "clients": lambda: _matrix((c for c in CLIENTS if c not in matrix.FMUSIM), runs), "messages": messages}
    if here.issuperset(matrix.FMUSIM):
        made["fmusim"] = lambda: _matrix(matrix.FMUSIM, runs)
    return made


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        sys.exit(main("--check" in sys.argv[1:], {PAGE: tables(matrix.Runs(Path(folder)))}, "make_clients.py"))

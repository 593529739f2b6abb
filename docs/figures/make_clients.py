"""Tables of docs/use/clients.md: results of FMUs in other clients, run as in the tests, and the clients' messages.

    python docs/figures/make_clients.py           # writes the tables in some minutes, fmusim's if it is on the PATH
    python docs/figures/make_clients.py --check   # exit code 1 if a table is stale
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
from tests.interop.units import UNITS as FMUS  # noqa: E402

PAGE = "use/clients.md"


def _version(client: str) -> str:
    """Return a client's version for the newer Python in .ci/constraints.txt; for fmusim the version that it prints."""
    package = CLIENTS[client].package
    if not package:
        process = subprocess.run(["fmusim", "--version"], capture_output=True, text=True, check=True)
        return process.stdout.split()[1]
    name = re.compile(package.replace("-", "[-_]") + r"==([^;\s]+)(?!.*<)", re.IGNORECASE)
    (version,) = [match[1] for line in (ROOT / ".ci" / "constraints.txt").read_text(encoding="utf-8").splitlines()
                  if (match := name.match(line))]
    return version


def _cell(fmu: str, client: str, runs: matrix.Runs) -> str:
    """Return the text of the result of an FMU in a client."""
    outcome = runs.outcome(fmu, client)
    if outcome.code:
        return "fails"
    if client in CHECKS:
        return "passes"
    difference = matrix.from_fmpy(FMUS[fmu], client, outcome.outputs, runs.outcome(fmu, "fmpy").outputs)
    if FMUS[fmu].reference:
        return (f"{matrix.from_reference(FMUS[fmu], outcome.outputs):.2g}°"
                + (f", {difference:.0e}" if difference else ""))
    return f"{difference:.0e}" if difference else "runs" if client == "fmpy" else "same"


def _matrix(clients: Iterable[str], runs: matrix.Runs) -> str:
    """Return the table of results of clients (rows) and FMUs (columns)."""
    pairs = set(matrix.pairs())
    return markdown(("client", "version", *(fmu.title for fmu in FMUS.values())), (
        (CLIENTS[c].title, _version(c), *(_cell(fmu, c, runs) if (fmu, c) in pairs else "–" for fmu in FMUS))
        for c in clients))


def messages() -> str:
    """Return the table of the messages in tests/interop/known_complaints.toml."""
    rows = []
    for complaint in matrix.known():
        text = re.sub(r"\\(.)", r"\1", complaint.text.replace(".+", "…").replace(".*", "…")).replace("|", r"\|")
        others = [fmu for fmu in FMUS if fmu not in complaint.units]
        fmus = (", ".join(FMUS[fmu].title for fmu in complaint.units) if len(others) > 1 else
                f"all but {FMUS[others[0]].title}" if others else "all")
        rows.append((", ".join(CLIENTS[c].title for c in complaint.clients), fmus, f"`{text}`", complaint.meaning,
                     complaint.whose))
    return markdown(("client", "FMU", "message", "meaning", "to be mended by"), rows)


def tables(runs: matrix.Runs) -> Mapping[str, Callable[[], str]]:
    """Return the functions that make the tables; fmusim's table is left out if fmusim is not installed."""
    installed = {client for _, client in matrix.pairs()}
    functions: dict[str, Callable[[], str]] = {
        "clients": lambda: _matrix((c for c in CLIENTS if c not in matrix.FMUSIM), runs), "messages": messages}
    if installed.issuperset(matrix.FMUSIM):
        functions["fmusim"] = lambda: _matrix(matrix.FMUSIM, runs)
    return functions


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        sys.exit(main("--check" in sys.argv[1:], {PAGE: tables(matrix.Runs(Path(folder)))}, "make_clients.py"))

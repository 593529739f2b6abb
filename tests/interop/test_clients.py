"""Every FMU in clients that nobody here wrote: the numbers, and all that they say."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import metadata

import pytest

from tests.docs.recipes import ROOT
from tests.docs.test_tables import script
from tests.hosts.host import Trajectory, difference
from tests.marks import others_slow

from . import matrix
from .clients import CLIENTS
from .units import UNITS

pytestmark = pytest.mark.fmu
QUICK = {("native", "fmpy"), ("native", "libcosimpy"), ("native", "ecospy")}
PAIRS = others_slow(matrix.pairs(), lambda pair: pair in QUICK)
LIMIT = 0.002  # deg, of `emcas validate`


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> matrix.Runs:
    return matrix.Runs(tmp_path_factory.mktemp("interop"))


@pytest.mark.parametrize(("unit", "client"), PAIRS)
def test_numbers_and_texts(unit: str, client: str, runs: matrix.Runs,
                           record_property: Callable[[str, object], None]) -> None:
    """No output differs from fmpy's by a step: clients set inputs before the step they are for, and read after it.

    They count time their own way (nanoseconds, a running sum), to within 1e-15 s of fmpy's; the fastest output changes
    by 1e6 a second, hence by 1e-9 at most. The sources give the bits of the binary, by other compilers' 1e-12.
    """
    outcome = runs.outcome(unit, client)
    if package := CLIENTS[client].package:
        record_property("version", metadata.version(package))
    for line in outcome.said:
        record_property("said", line)
    problems = matrix.problems(unit, client, outcome)
    assert not problems, "\n".join(problems)
    if not outcome.found:
        return
    if UNITS[unit].reference:
        deviation = matrix.from_reference(UNITS[unit], outcome.found)
        record_property("from_reference_deg", deviation)
        assert deviation < LIMIT
    found, wanted = matrix.compared(UNITS[unit], client, outcome.found, runs.outcome(unit, "fmpy").found)
    record_property("from_fmpy", difference(found, wanted))
    assert difference(found, wanted) < (1e-12 if client == "rebuilt" else 1e-9)
    assert difference(_from(wanted, 1), _to(found, -1)) > 1e-3  # so would a step's delay


def _from(table: Trajectory, row: int) -> Trajectory:
    return {name: values[row:] for name, values in table.items()}


def _to(table: Trajectory, row: int) -> Trajectory:
    return {name: values[:row] for name, values in table.items()}


def test_back_ends_agree(runs: matrix.Runs) -> None:
    assert runs.outcome("python", "fmpy").found == runs.outcome("native", "fmpy").found


@pytest.mark.slow
@pytest.mark.skipif(sys.version_info < (3, 11), reason="one of the clients needs Python 3.11")
def test_the_page_has_these_numbers(runs: matrix.Runs) -> None:
    tables, maker = script("make_tables"), script("make_clients")
    text = (ROOT / "docs" / maker.PAGE).read_text(encoding="utf-8")
    assert tables.renewed(text, maker.tables(runs)) == text, "run python docs/figures/make_clients.py"


@pytest.mark.slow
def test_the_loaded_ones_move(runs: matrix.Runs) -> None:
    """Where there is no reference, agreement says nothing of a fin that rests."""
    for name, unit in UNITS.items():
        if not unit.reference:
            assert max(runs.outcome(name, "fmpy").found["fin_angle"]) > 0.15  # of the commanded 10 deg


def test_the_list_names_what_there_is() -> None:
    for complaint in matrix.known():
        assert set(complaint.clients) <= set(CLIENTS)
        assert set(complaint.units) <= set(UNITS)
        assert complaint.whose in ("ours", "theirs")


def test_a_new_text_and_a_lost_one_are_seen() -> None:
    said = ["fmpy.fmi1.FMICallException: fmi2GetReal failed with status 3 (error)."]
    refused = matrix.Outcome(1, said, {})
    assert matrix.problems("native", "pathsim", refused) == []
    assert len(matrix.problems("native", "fmpy", refused)) == 3  # new text, lost text, code
    assert matrix.problems("native", "pathsim", matrix.Outcome(1, [*said, "Segmentation fault"], {})) == [
        "said, and not in known_complaints.toml: Segmentation fault"]
    well = matrix.Outcome(0, [], {"time": [0.001]})
    assert matrix.problems("native", "libcosimpy", well) == []
    assert [p.partition(":")[0] for p in matrix.problems("native", "pathsim", well)] == [
        "in known_complaints.toml, and not said", "ended with code 0"]

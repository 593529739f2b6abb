"""FMUs in other people's clients: their results and all of their messages."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import metadata

import pytest

from tests.docs.recipes import ROOT
from tests.docs.test_tables import script
from tests.hosts.host import difference
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
def test_client_gives_fmpys_results_and_known_messages(unit: str, client: str, runs: matrix.Runs,
                                                       record_property: Callable[[str, object], None]) -> None:
    """The comparison would detect an output that is a step late.

    Clients compute time differently (nanoseconds, a running sum). Their times differ from fmpy's by at most 1e-15 s;
    the fastest output changes by 1e6 per second, hence by at most 1e-9. Another compiler changes outputs by 1e-12.
    """
    outcome = runs.outcome(unit, client)
    if package := CLIENTS[client].package:
        record_property("version", metadata.version(package))
    for line in outcome.messages:
        record_property("said", line)
    problems = matrix.problems(unit, client, outcome)
    assert not problems, "\n".join(problems)
    if not outcome.outputs:
        return
    if UNITS[unit].reference:
        deviation = matrix.from_reference(UNITS[unit], outcome.outputs)
        record_property("from_reference_deg", deviation)
        assert deviation < LIMIT
    outputs, expected = matrix.compared(UNITS[unit], client, outcome.outputs, runs.outcome(unit, "fmpy").outputs)
    record_property("from_fmpy", difference(outputs, expected))
    assert difference(outputs, expected) < (1e-12 if client == "rebuilt" else 1e-9)
    assert difference({name: values[1:] for name, values in expected.items()},
                      {name: values[:-1] for name, values in outputs.items()}) > 1e-3


def test_both_back_ends_give_the_same_bits(runs: matrix.Runs) -> None:
    assert runs.outcome("python", "fmpy").outputs == runs.outcome("native", "fmpy").outputs


@pytest.mark.slow
@pytest.mark.skipif(sys.version_info < (3, 11), reason="one of the clients needs Python 3.11")
def test_page_has_the_present_numbers(runs: matrix.Runs) -> None:
    tables, maker = script("make_tables"), script("make_clients")
    text = (ROOT / "docs" / maker.PAGE).read_text(encoding="utf-8")
    assert tables.renewed(text, maker.tables(runs)) == text, "run python docs/figures/make_clients.py"


@pytest.mark.slow
def test_fmus_without_a_reference_move(runs: matrix.Runs) -> None:
    """Otherwise equal outputs would prove nothing."""
    for name, unit in UNITS.items():
        if not unit.reference:
            assert max(runs.outcome(name, "fmpy").outputs["fin_angle"]) > 0.15  # rad, of the commanded 10 deg


def test_known_complaints_name_existing_clients_and_fmus() -> None:
    for complaint in matrix.known():
        assert set(complaint.clients) <= set(CLIENTS)
        assert set(complaint.units) <= set(UNITS)
        assert complaint.whose in ("ours", "theirs")


def test_new_and_missing_messages_are_problems() -> None:
    messages = ["fmpy.fmi1.FMICallException: fmi2GetReal failed with status 3 (error)."]
    failed = matrix.Outcome(1, messages, {})
    assert matrix.problems("native", "pathsim", failed) == []
    assert len(matrix.problems("native", "fmpy", failed)) == 3  # new message, missing message, exit code
    assert matrix.problems("native", "pathsim", matrix.Outcome(1, [*messages, "Segmentation fault"], {})) == [
        "printed, and not in known_complaints.toml: Segmentation fault"]
    successful = matrix.Outcome(0, [], {"time": [0.001]})
    assert matrix.problems("native", "libcosimpy", successful) == []
    assert [p.partition(":")[0] for p in matrix.problems("native", "pathsim", successful)] == [
        "in known_complaints.toml, and not printed", "ended with code 0"]

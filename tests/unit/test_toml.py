"""Lines of TOML that the package writes."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emcas_fmu.parameters import toml

TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
NUMBERS = st.integers(-2**63, 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(TEXTS | NUMBERS | st.booleans(),
                      lambda inside: st.lists(inside, max_size=3) | st.dictionaries(TEXTS, inside, max_size=3))


@given(entries=st.dictionaries(TEXTS, VALUES, max_size=4))
def test_written_table_is_read_unchanged(entries: dict[str, Any]) -> None:
    assert toml.tomllib.loads(toml.table("a.b", entries)) == {"a": {"b": entries}}


@pytest.mark.parametrize(("name", "written", "line"), [
    ("file", "a \"b\".toml", 'file = "a \\"b\\".toml"'),
    ("friction.temperature", "-6 degC", '"friction.temperature" = "-6 degC"'),
    ("start", {"encoder.enabled": False, "n": 3}, 'start = { "encoder.enabled" = false, n = 3 }'),
    ("note", "0.2\u00b0\x7f\udc80", 'note = "0.2\u00b0\\u007f?"'), ("values", [1.0, 1e22], "values = [1.0, 1e+22]")])
def test_value_is_written_in_one_short_line(name: str, written: Any, line: str) -> None:
    assert toml.entry(name, written) == line

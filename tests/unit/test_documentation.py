"""The page inside an FMU: no markup of docstrings is left in it, of any actuator and extension."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from emcas_fmu import __version__
from emcas_fmu.actuators import EXTENSIONS, NAMES, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi import pictures
from emcas_fmu.fmi.documentation import documents
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.pages.page import prose
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import parameters_hash
from tests.own_actuator.example import MODEL as DIRECT_DRIVE

MARKUP = re.compile(r":\w+:`|`|\*\*")


def takes(actuator: str, extension: str) -> bool:
    try:
        get(f"{actuator}+{extension}")
    except EmcasError:
        return False
    return True


# Every extension over the first actuator that takes it.
EXTENDED = [next(f"{name}+{extension}" for name in NAMES if takes(name, extension)) for extension in EXTENSIONS]


def page(model: str, fins: int, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(pictures, "response_pictures", lambda parameters: ())  # pictures are of no concern here
    unit, base = FmuInterface(fins, model), load_parameters(model=model)
    sets = fin_sets(base, fins, "cross", {}) if fins > 1 else (base,)
    return documents(unit, sets, "", "native", FORMATS["2"], ("linux64",))["documentation/index.html"].decode()


@pytest.mark.parametrize("fins", [1, 2])
@pytest.mark.parametrize("model", [*NAMES, DIRECT_DRIVE, *EXTENDED], ids=lambda model: Path(model).stem)
def test_no_markup_is_left(model: str, fins: int, monkeypatch: pytest.MonkeyPatch) -> None:
    text = page(model, fins, monkeypatch)
    assert [line for line in text.splitlines() if MARKUP.search(line)] == []
    assert "emcas_fmu." not in text


def test_page_has_no_equations_of_another_drive_line(monkeypatch: pytest.MonkeyPatch) -> None:
    text = page("servo", 1, monkeypatch)
    assert "A hobby servo's motor and gear" in text.replace("&#39;", "'")
    assert "about the screw" not in text


def test_references_and_names_are_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "elastic drive line between them (<code>physics.drive_line</code>)" in page("elastic", 1, monkeypatch)
    assert "unless <code>encoder.on_fin</code> selects a second" in page("elastic", 1, monkeypatch)
    assert prose("a < b, ``c`` and `d`") == "a &lt; b, <code>c</code> and <code>d</code>"


def test_equations_keep_their_lines_and_prose_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    text = page("nonlinear", 1, monkeypatch)
    # Aligned columns, without the docstring's indentation; keys scroll what is wider than a telephone.
    assert '<pre tabindex="0">a_h = a + w&#39; x r + w x (w x r)' in text
    assert "the fin rate q = w/R and dq/dt = (dw/dt)/R - R&#39; w^2/R^3, the hinge equation</p>" in text
    assert re.search(r">Equation of motion \(2.8\)-\(2.17\), written for the motor angle</h3>", text)


def test_sources_of_several_fins_have_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    text = page("nonlinear", 2, monkeypatch)
    assert re.findall(r"<td>parameters of fin (\d)</td>", text) == ["1", "2"]
    assert text.count("<td>actuator</td>") == 1


def test_contents_and_provenance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page begins with its contents, and names the parameters, their hash and the version."""
    text = page("nonlinear", 1, monkeypatch)
    assert '<meta name="viewport"' in text
    listed = re.findall(r'<a href="#section-\d+">(.*?)</a>', text)
    assert {"How to wire it", "Equations", "Inputs", "Outputs", "Parameters"} <= set(listed)
    card = " ".join(text.partition('<h2 id="credibility">')[2].partition("<h2")[0].split())
    assert parameters_hash(load_parameters().values) in card
    assert f"emcas {__version__}" in card
    assert '<th scope="row">on</th>' not in text  # the same page whenever it is built

"""Elementary functions: errors in ulp against decimals of 45 digits, special values, and the same bits in C."""

from __future__ import annotations

import ctypes as ct
import math
from collections.abc import Callable, Mapping
from decimal import Context, Decimal, localcontext
from math import inf, nan, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emcas_fmu.ops import elementary
from emcas_fmu.ops.arrays import ArrayOps
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.runtime.c_sources import elementary_header
from emcas_fmu.runtime.compiler import local_compilers, local_platform
from emcas_fmu.trace.python_source import python_source
from emcas_fmu.trace.tracer import Tracer

Function = Callable[[float], float]
Range = tuple[float, float]
_DIGITS = Context(prec=45)
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211707")
# Ranges of each function, with the maximum error [ulp] that its docstring states.
BOUNDS: dict[str, dict[Range, float]] = {
    "exp": {(-708.0, 709.78): 1.1, (-1.0, 1.0): 1.1}, "log": {(2.0**-1022, 1.7e308): 1.0, (0.5, 2.0): 1.0},
    "sin": {(-1.6, 1.6): 1.6, (-1e3, 1e3): 1.6, (-1e6, 1e6): 2.5},
    "cos": {(-1.6, 1.6): 1.6, (-1e3, 1e3): 1.6, (-1e6, 1e6): 2.5},
    "tan": {(-pi / 4.0, pi / 4.0): 2.5, (-1.5, 1.5): 4.0, (-1e6, 1e6): 4.0},
    "atan": {(-0.42, 0.42): 1.8, (-3.0, 3.0): 1.8, (-1e200, 1e200): 1.8}}
POINTS = 700


def _sine_cosine(x: Decimal) -> tuple[Decimal, Decimal]:
    """Return sine and cosine, computed as series."""
    with localcontext(Context(prec=70)):  # a million radians cost 6 digits
        r = x.remainder_near(_PI / 2)
        quarter = int(((x - r) / (_PI / 2)).to_integral_value()) % 4
        term, sums = Decimal(1), [Decimal(0), Decimal(0)]
        for n in range(45):
            sums[n % 2] += term if n % 4 < 2 else -term
            term = term * r / (n + 1)
        cosine, sine = sums
        return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[quarter]


def _atan(x: Decimal) -> Decimal:
    """Return the arc tangent: that of floating-point numbers, and a small correction."""
    near = Decimal(math.atan(x))
    sine, cosine = _sine_cosine(near)
    rest = (x * cosine - sine) / (cosine + x * sine)
    return near + rest - rest**3 / 3


EXACT: dict[str, Callable[[Decimal], Decimal]] = {
    "exp": lambda x: x.exp(_DIGITS), "log": lambda x: x.ln(_DIGITS), "sin": lambda x: _sine_cosine(x)[0],
    "cos": lambda x: _sine_cosine(x)[1], "tan": lambda x: _sine_cosine(x)[0] / _sine_cosine(x)[1], "atan": _atan}


def _error(name: str, x: float) -> float:
    """Return the error of a function [ulp], less the permitted error of the angle's reduction, 1e-32 of the angle."""
    with localcontext(_DIGITS):
        exact = EXACT[name](Decimal(x))
        allowed = Decimal(abs(x)) * Decimal("1e-32") if name in ("sin", "cos", "tan") else Decimal(0)
        difference = abs(Decimal(getattr(FLOATS, name)(x)) - exact) - allowed
        return float(difference / Decimal(math.ulp(float(exact))))


def _points(limits: Range, seed: int = 5) -> Any:
    """Return random points of a range; with many orders of magnitude, the logarithms have equal density."""
    random, (low, high) = np.random.default_rng(seed), limits
    if high < 1e7:
        return random.uniform(low, high, POINTS)
    first = math.log10(low) if low > 0.0 else -200.0
    sizes = 10.0**random.uniform(first, math.log10(high), POINTS)
    return sizes if low > 0.0 else sizes * random.choice([-1.0, 1.0], POINTS)


CASES = [(name, limits, bound) for name, ranges in BOUNDS.items() for limits, bound in ranges.items()]


@pytest.mark.parametrize(("name", "limits", "bound"), CASES)
def test_error_is_within_its_bound(name: str, limits: Range, bound: float) -> None:
    assert max(_error(name, float(x)) for x in _points(limits)) <= bound


@pytest.mark.parametrize("name", elementary.FUNCTIONS)
@given(data=st.data())
def test_error_at_any_argument_is_within_its_bound(name: str, data: st.DataObject) -> None:
    for (low, high), bound in BOUNDS[name].items():
        assert _error(name, data.draw(st.floats(low, high))) <= bound


@pytest.mark.parametrize("k", [1, 2, 3, 5, 17, 1000, 636_619])
@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_error_near_multiples_of_a_quarter_turn(name: str, k: int) -> None:
    """The numbers at and beside k pi/2, where nearly all digits cancel."""
    angle = k * pi / 2.0
    for x in (angle, math.nextafter(angle, 0.0), math.nextafter(angle, inf), -angle):
        assert _error(name, x) <= 4.0


def test_values_at_the_ends_of_ranges() -> None:
    assert [FLOATS.exp(x) for x in (-inf, -1e300, -708.1, 0.0, 709.79, 1e300, inf)] == [0.0] * 3 + [1.0] + [inf] * 3
    assert 0.0 < FLOATS.exp(-708.0) < FLOATS.exp(709.78) < inf
    assert [FLOATS.log(x) for x in (0.0, 1.0, inf)] == [-inf, 0.0, inf]
    assert FLOATS.log(5e-324) == pytest.approx(-1074.0 * math.log(2.0), rel=1e-15)  # two roundings
    assert [FLOATS.atan(x) for x in (-inf, inf)] == [-pi / 2.0, pi / 2.0]
    assert [FLOATS.sin(0.0), FLOATS.cos(0.0), FLOATS.tan(0.0), FLOATS.atan(0.0)] == [0.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize(("name", "x"), [*((name, nan) for name in elementary.FUNCTIONS), ("log", -1.0), ("log", -inf)])
def test_undefined_arguments_give_nan(name: str, x: float) -> None:
    assert math.isnan(getattr(FLOATS, name)(x))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_sine_and_cosine_never_exceed_one(x: float) -> None:
    """Also for angles far beyond the range in which they are exact."""
    assert abs(FLOATS.sin(x)) <= 1.0 >= abs(FLOATS.cos(x))


@given(st.floats(-700.0, 700.0), st.floats(1e-300, 1e300), st.floats(-1.5, 1.5))
def test_inverse_functions_agree(x: float, y: float, angle: float) -> None:
    """A few roundings, 1e-15, are amplified by the slope of the other function."""
    assert FLOATS.log(FLOATS.exp(x)) == pytest.approx(x, rel=1e-15, abs=1e-15)
    assert FLOATS.exp(FLOATS.log(y)) == pytest.approx(y, rel=1e-15 * (1.0 + abs(FLOATS.log(y))))
    assert FLOATS.atan(FLOATS.tan(angle)) == pytest.approx(angle, rel=3e-15)


class _Lanes(ArrayOps):
    """Arrays, for which both values of every choice are computed."""

    @staticmethod
    def power_of_two(k: Any) -> Any:
        return np.ldexp(1.0, k.astype(int))

    @staticmethod
    def exponent(x: Any) -> Any:
        return np.frexp(x)[1] - 1.0


ORDINARY: Mapping[str, Any] = {
    name: np.concatenate([*map(_points, ranges), [0.0, 1.0, -1.0]]) for name, ranges in BOUNDS.items()}


@pytest.mark.parametrize("name", elementary.FUNCTIONS)
def test_values_that_are_not_chosen_raise_no_exception(name: str) -> None:
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        lanes = getattr(elementary, name)(_Lanes(), ORDINARY[name])
    assert [float(x).hex() for x in lanes] == [getattr(FLOATS, name)(float(x)).hex() for x in ORDINARY[name]]


def _printed(name: str) -> Function:
    """Return a function as generated for the Python kernel."""
    tracer = Tracer()
    tracer.function("f", ("value",), lambda value: (getattr(tracer, name)(value),))
    space: dict[str, Any] = {}
    exec(python_source(tracer, "test"), space)
    (f,) = space["make"]({})
    return lambda x: f(x)[0]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ct.CDLL:
    target, compiler = local_platform(), next(local_compilers(), None)
    if target is None or compiler is None:
        pytest.skip("no C compiler")
    functions = "".join(
        f'__attribute__((visibility("default"))) double own_{name}(double x) {{ return elementary_{name}(x); }}\n'
        for name in elementary.FUNCTIONS)
    main = ('#include <fenv.h>\n#include "elementary.h"\n' + functions
            + '__attribute__((visibility("default"))) int raised(void)\n{\n'
              "    const int flags = fetestexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);\n"
              "    feclearexcept(FE_ALL_EXCEPT);\n    return flags;\n}\n")
    content = compiler.library({"main.c": main, "elementary.h": elementary_header()}, "main.c", target, "functions")
    path: Path = tmp_path_factory.mktemp("elementary") / f"functions{target.suffix}"
    path.write_bytes(content)
    return ct.CDLL(str(path))


@pytest.mark.parametrize("name", elementary.FUNCTIONS)
def test_c_and_python_agree_to_the_bit(name: str, library: ct.CDLL) -> None:
    function, python = getattr(library, f"own_{name}"), _printed(name)
    function.restype, function.argtypes = ct.c_double, [ct.c_double]
    library.raised()
    ordinary = [function(x) for x in ORDINARY[name]]
    assert not library.raised()  # also not by log of 0 and -1
    assert [y.hex() for y in ordinary] == [python(float(x)).hex() for x in ORDINARY[name]]
    ends = [inf, -inf, nan, 1e300, -1e300, 5e-324, -0.0, 800.0]
    assert [function(x).hex() for x in ends] == [python(x).hex() for x in ends]

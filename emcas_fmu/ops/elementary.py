"""Elementary functions from the four operations: the same bits on every platform, in every language and in vectors.

The functions of C libraries differ in their last digits. The functions here are written once, over `ops`: floats
evaluate them, :mod:`emcas_fmu.trace.elementary` traces each once, and the printers print each as a function of the
language, with the same order of operations.

The coefficients of the polynomials were computed with 50 digits, by interpolation at Chebyshev nodes. The truncation
error is below 2e-17 of the function. The last operations add rounding of 1/2 ulp each, or less if they act on a smaller
part of the result. The bounds in the docstrings include truncation and rounding; tests compare with 45 digits.

Some hosts trap floating-point exceptions. An operation whose result is not chosen therefore never divides by zero and
is never invalid. The function of NaN is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan
from typing import Protocol

from .base import Ops, Value

FUNCTIONS = ("exp", "log", "sin", "cos", "tan", "atan")


class Bits(Ops, Protocol):
    """The operations of equations, and two for the binary exponent of a number."""

    def power_of_two(self, k: Value) -> Value:
        """Return 2**k for a whole number k from -1022 to 1023."""
        ...

    def exponent(self, x: Value) -> Value:
        """Return the whole number e for which x = m 2**e, 1 <= m < 2; x is at least 2**-1022."""
        ...


# Adding and subtracting this rounds a number below 2**51 to a whole number, since so large a number has no fraction.
_WHOLE = 1.5 * 2.0**52

# The high parts of ln 2 (32 bits) and of pi/2 (33 bits) have exact products with whole numbers below 2**20.
_LN2 = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
_INVERSE_LN2 = float.fromhex("0x1.71547652b82fep+0")
_HALF_PI = (float.fromhex("0x1.921fb544p+0"), float.fromhex("0x1.0b4611a6p-34"),
            float.fromhex("0x1.3198a2e037073p-69"))
_TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
_QUARTER_PI = float.fromhex("0x1.921fb54442d18p-1")
_ROOT_TWO = float.fromhex("0x1.6a09e667f3bcdp+0")

# (exp(r) - 1 - r)/r^2 in r, |r| <= ln(2)/2
_EXP = (0.5000000000000001, 0.16666666666666669, 0.041666666666623824, 0.008333333333330039, 0.0013888888917367081,
        0.00019841269863171557, 2.4801521057868204e-05, 2.7557268276905696e-06, 2.7620201591031547e-07,
        2.5100472505694996e-08)
# (log((1 + s)/(1 - s))/s - 2)/z in z = s^2, 1/sqrt(2) <= (1 + s)/(1 - s) <= sqrt(2)
_LOG = (0.666666666666667, 0.39999999999899505, 0.28571428625975487, 0.2222221113479508, 0.18182889125261723,
        0.15331721600556042, 0.14616449685043406)
# (sin(r)/r - 1)/z, (cos(r) - 1 + z/2)/z^2 and (tan(r)/r - 1)/z in z = r^2, |r| <= pi/4
_SIN = (-0.16666666666666666, 0.008333333333330948, -0.00019841269836758574, 2.755731610255244e-06,
        -2.5051131845003624e-08, 1.5918129294866608e-10)
_COS = (0.041666666666666664, -0.0013888888888887398, 2.480158729876569e-05, -2.7557317271729777e-07,
        2.087614626840078e-09, -1.138263242537927e-11)
_TAN = ((0.33333333333333326, -0.020534910849743862, 0.00020078443938274115),
        (1.0, -0.4616047325492664, 0.023339484433737852, -0.00020825506873056867))
# (atan(t)/t - 1)/z in z = t^2, |t| <= tan(pi/8)
_ATAN = (-0.3333333333333333, 0.1999999999999552, -0.14285714284666542, 0.11111111015256361, -0.09090904578123903,
         0.07692183190826087, -0.06664511447381948, 0.0585814891280221, -0.0508544973794026, 0.03923165829558719,
         -0.019176887119062257)
_TAN_PI_8, _TAN_3_PI_8 = float.fromhex("0x1.a827999fcef32p-2"), float.fromhex("0x1.3504f333f9de6p+1")
# pi/4 and pi/2, each with the remainder that its first double leaves
_PI_4, _PI_2 = ((float.fromhex(f"0x1.921fb54442d18p{e}"), float.fromhex(f"0x1.1a62633145c07p{e - 54}"))
                for e in (-1, 0))

# exp is 0 below the first: e^-708 is 1.5 times the smallest number with all digits. The largest number is e^709.78.
_LEAST_EXPONENT, _MOST_EXPONENT = -708.0, 709.8
# Arguments of log below 2**-1000 are scaled.
_SMALL, _LARGER = 2.0**-1000, 2.0**100
_LARGEST = float.fromhex("0x1.fffffffffffffp+1023")


def polynomial(x: Value, coefficients: Sequence[Value]) -> Value:
    """Return a polynomial of x; the constant coefficient is first."""
    # Estrin's scheme, pairs, then pairs of pairs: its short parallel chains are faster than Horner's long one.
    terms: list[Value] = list(coefficients)
    while len(terms) > 1:
        pairs = [low + high * x for low, high in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[2 * len(pairs):]
        x = x * x
    return terms[0]


def exp(ops: Bits, x: Value) -> Value:
    """Return e^x within 1.1 ulp; 0 below x = -708, infinity where e^x exceeds the largest number.

    x = k ln 2 + r, e^x = 2^k e^r. The last addition, of 1 and e^r - 1, rounds by 1/2 ulp. The rounding of e^r - 1 and
    that of r are at most 1/4 ulp of e^r each.
    """
    inside = ops.clip(x, _LEAST_EXPONENT, _MOST_EXPONENT)
    k = inside * _INVERSE_LN2 + _WHOLE - _WHOLE
    r = inside - k * _LN2[0] - k * _LN2[1]
    # Twice e^r and half the power of two, so that the power exists up to the largest results.
    twice = 2.0 + (2.0 * r + r * r * polynomial(r, [2.0 * c for c in _EXP]))
    return ops.where(x < _LEAST_EXPONENT, 0.0, twice * ops.power_of_two(k - 1.0))


def log(ops: Bits, x: Value) -> Value:
    """Return the natural logarithm within 1 ulp; -infinity for 0, NaN for negative numbers.

    x = 2^e (1 + f) with 1 + f from 1/sqrt(2) to sqrt(2), log(1 + f) = 2 atanh(s) with s = f/(2 + f). As in Sun's
    fdlibm the largest part of log(1 + f), which is f, is added last: log(1 + f) = f - (f^2/2 - s (f^2/2 + R(s^2))).
    """
    ordinary = ops.where(ops.both(x > 0.0, x <= _LARGEST), x, 1.0)
    small = ordinary < _SMALL
    scaled = ordinary * ops.where(small, _LARGER, 1.0)
    exponent = ops.exponent(scaled)
    mantissa = 0.5 * scaled * ops.power_of_two(1.0 - exponent)
    upper = mantissa > _ROOT_TWO
    f = ops.where(upper, 0.5 * mantissa, mantissa) - 1.0
    e = exponent + ops.where(upper, 1.0, 0.0) - ops.where(small, 100.0, 0.0)
    s = f / (2.0 + f)
    z = s * s
    half = 0.5 * f * f
    result = e * _LN2[0] - (half - (s * (half + z * polynomial(z, _LOG)) + e * _LN2[1]) - f)
    beyond = ops.where(ops.equal(x, 0.0), -inf, ops.where(x > 0.0, inf, nan))
    return ops.where(ops.both(x > 0.0, x <= _LARGEST), result, beyond)


def _reduced(ops: Bits, x: Value) -> tuple[Value, Value]:
    """Return k and r of x = k pi/2 + r.

    The first difference is exact; the other two round by 1/2 ulp of r each. While k is below 2^20, the truncation of
    pi/2 and the rounding of the product of k and the last part of pi/2 are at most 1e-32 |x|. For a larger k the error
    of r grows until r is arbitrary; r is limited, so that sine and cosine stay within -1 and 1.
    """
    k = x * _TWO_OVER_PI + _WHOLE - _WHOLE
    r = x - k * _HALF_PI[0] - k * _HALF_PI[1] - k * _HALF_PI[2]
    return k, ops.clip(r, -0.8, 0.8)


def _sine(ops: Bits, x: Value, turned: float) -> Value:
    """Return the sine of x [rad] plus `turned` quarter turns; x within +-pi/4 is not reduced."""
    def reduced() -> tuple[Value, ...]:
        k, r = _reduced(ops, x)
        quarters = k + turned if turned else k
        quarters = quarters - 4.0 * (quarters * 0.25 + _WHOLE - _WHOLE)  # -2 to 2
        return (r, ops.equal(ops.fabs(quarters), 1.0), ops.either(quarters < -0.5, quarters > 1.5))

    r, odd, below = ops.branch(ops.fabs(x) > _QUARTER_PI, reduced, lambda: (x, bool(turned), False))
    z = r * r
    sine = r + r * (z * polynomial(z, _SIN))
    cosine = 1.0 - (0.5 * z - z * z * polynomial(z, _COS))
    size = ops.where(odd, cosine, sine)
    return ops.where(below, -size, size)


def sin(ops: Bits, x: Value) -> Value:
    """Return the sine of x [rad] within 1.6 ulp up to 1000 rad, 2.5 ulp up to a million, plus 1e-32 |x|."""
    return _sine(ops, x, 0.0)


def cos(ops: Bits, x: Value) -> Value:
    """Return the cosine of x [rad] within 1.6 ulp up to 1000 rad, 2.5 ulp up to a million, plus 1e-32 |x|."""
    return _sine(ops, x, 1.0)


def tan(ops: Bits, x: Value) -> Value:
    """Return the tangent of x [rad] within 2.5 ulp up to pi/4, 4 ulp up to a million, plus 1e-32 |x|.

    tan(r) = r + a/b with a = r z P(z), b = Q(z), z = r^2; a quarter turn later it is -b/(r b + a). Both need one
    division.
    """
    def reduced() -> tuple[Value, ...]:
        k, r = _reduced(ops, x)
        return r, ops.fabs(k - 2.0 * (k * 0.5 + _WHOLE - _WHOLE)) > 0.5

    r, odd = ops.branch(ops.fabs(x) > _QUARTER_PI, reduced, lambda: (x, False))
    z = r * r
    above, below = (polynomial(z, coefficients) for coefficients in _TAN)
    a = r * (z * above)
    quotient = ops.where(odd, -below, a) / ops.where(odd, r * below + a, below)
    return ops.where(odd, quotient, r + quotient)


def atan(ops: Bits, x: Value) -> Value:
    """Return the arctangent [rad] of x within 1.8 ulp.

    Above tan(pi/8) it is pi/4 + atan((x - 1)/(x + 1)), above tan(3 pi/8) pi/2 + atan(-1/x); atan(-x) = -atan(x).
    """
    def reduced() -> tuple[Value, ...]:
        size, side = ops.fabs(x), ops.where(x < 0.0, -1.0, 1.0)
        steep = size > _TAN_3_PI_8
        t = ops.where(steep, -1.0, size - 1.0) / ops.where(steep, size, size + 1.0)
        high, low = (ops.where(steep, half, quarter) for half, quarter in zip(_PI_2, _PI_4, strict=True))
        return side * t, side * high, side * low

    reduces = ops.fabs(x) > _TAN_PI_8
    t, high, low = ops.branch(reduces, reduced, lambda: (x, 0.0, 0.0))
    z = t * t
    bent = t * z * polynomial(z, _ATAN)
    return ops.branch(reduces, lambda: (high + (t + (low + bent)),), lambda: (t + bent,))[0]

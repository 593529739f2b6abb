"""Every physics function gives the same numbers over floats, arrays, symbols and traced values."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest

from emcas_fmu.control import controllers, sensors
from emcas_fmu.namespace import Record
from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.ops.symbols import SYMBOLS
from emcas_fmu.physics import bus, drive, friction, kinematics, loads, mechanics
from emcas_fmu.runtime import codegen
from emcas_fmu.steppers import electrical, rigid
from emcas_fmu.trace.python_source import python_source
from emcas_fmu.trace.tracer import Tracer
from tests.default_actuator import ACTUATOR, namespace

Function = Callable[..., Any]
LANES = 40
# NumPy's and CasADi's elementary functions may differ in the last bits from the package's. A step amplifies this by
# cancellation (angle differences of 1e-3 between values of 1e1).
RELATIVE, ABSOLUTE = 1e-10, 1e-11

# Plausible ranges of arguments by name. A function with another argument fails, so that none remains untested.
RANGES: dict[str, tuple[float, float]] = {name: limits for names, limits in (
    ("counts motor_counts", (-1e4, 1e4)),
    ("alpha_x angular_acceleration_x angular_acceleration_y angular_acceleration_z", (-500.0, 500.0)),
    ("wx2_wz2", (-500.0, 4000.0)), ("speed motor_speed", (-300.0, 300.0)), ("wx_wz", (-200.0, 200.0)),
    ("aero_torque", (-100.0, 100.0)), ("angular_rate_x angular_rate_y angular_rate_z i_ref", (-60.0, 60.0)),
    ("f_x f_z alpha_y acceleration_x acceleration_y acceleration_z", (-50.0, 50.0)),
    ("motor_current current", (-40.0, 40.0)), ("motor_angle motor target", (-25.0, 25.0)),
    ("reference active", (-10.0, 10.0)), ("sag", (-5.0, 50.0)), ("speed_reference velocity_integral", (-3.0, 3.0)),
    ("attitude_roll attitude_pitch attitude_yaw", (-1.5, 1.5)),
    ("drive_integral direction integral limited", (-1.0, 1.0)), ("link", (-1.0, 50.0)),
    ("command command_taken", (-0.5, 0.5)), ("fin fin_measured measured fin_angle", (-0.4, 0.4)),
    ("tangent", (-0.4, 0.6)), ("dry", (-0.2, 0.2)), ("momentum", (-0.1, 0.1)), ("_", (0.0, 1.0)), ("time", (0.0, 2.0)),
    ("command_wait", (0.0, 3.0)), ("supply source", (0.0, 45.0)), ("h", (1e-5, 3e-4)), ("stribeck_speed", (0.5, 300.0)),
    ("static_ratio", (1.0, 2.0))) for name in names.split()}
FLAGS = {"enable"}


def _public(module: ModuleType) -> list[Function]:
    return [f for name, f in vars(module).items()
            if inspect.isfunction(f) and f.__module__ == module.__name__ and not name.startswith("_")]


# Functions with arguments other than plain values; the functions of the program call them.
STRUCTURED = {kinematics.deviates, loads.motion_loads, loads.level, mechanics.breakaway, mechanics.damping,
              rigid.advance, controllers.sample, controllers.feed_forward, *_public(electrical),
              rigid.acceleration, rigid.current_course, rigid.integral_end, rigid.friction_speed,
              rigid.stop_time, rigid.time_to, rigid.voltage_events, rigid.voltage_time,
              mechanics.bristles, friction.falls, sensors.measure, mechanics.hinge_damping, mechanics.hinge_dry,
              mechanics.hinge_friction, mechanics.with_hinge_friction,
              controllers.at_rest, friction.coulomb_reference, friction.coulomb_polynomial,
              bus.fall, bus.start, bus.following}  # of the bus's parameters: tests/bus
MODULES = (bus, kinematics, friction, loads, mechanics, drive, sensors, controllers, electrical, rigid)


def _arguments(function: Function) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name not in ("ops", "p")]


def _plain(function: Function) -> tuple[list[str], Function]:
    """Return the argument names and a function of plain values; loads in one argument become the last arguments."""
    names = _arguments(function)
    if "u" not in names:
        return names, function
    *names, last = names
    assert last == "u"

    def of_values(ops: Any, p: Any, *values: Any) -> Any:
        u = Record(**dict(zip(loads.LOADS, values[len(names):], strict=True)))
        return tuple(_call(function, ops, p, [*values[:len(names)], u]))

    return [*names, *loads.LOADS], of_values


# The argument names and functions to call: single functions, and the functions of the program.
PLAIN = {
    **{f"{f.__module__.rsplit('.', 1)[1]}.{f.__name__}": _plain(f)
       for module in MODULES for f in _public(module) if f not in STRUCTURED},
    **{f"codegen.{name}": (list(names), function) for name, names, function in codegen.functions(ACTUATOR)}}
# Parameters that functions read and the default actuator does not have.
FURTHER = {"pwm.gain": 1.5}


def _flat(result: Any) -> list[Any]:
    return [x for r in result for x in _flat(r)] if isinstance(result, tuple) else [result]


def _call(function: Function, ops: Any, p: Any, arguments: list[Any]) -> list[Any]:
    names = list(inspect.signature(function).parameters)
    head = {"ops": ops, "p": p}
    return _flat(function(*(head[n] for n in names if n in head), *arguments))


def _columns(names: Iterable[str], seed: int) -> list[Any]:
    random = np.random.default_rng(seed)
    columns: list[Any] = []
    for name in names:
        if name in FLAGS:
            columns.append(random.random(LANES) < 0.8)
        else:
            column = random.uniform(*RANGES[name], LANES)
            if name in ("speed", "motor_speed"):
                column[:10] = 0.0  # stuck lanes
            columns.append(column)
    return columns


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("kind", ["arrays", "symbols", "traced"])
def test_every_function_gives_the_same_numbers(name: str, kind: str, values: Mapping[str, Any]) -> None:
    arguments, function = PLAIN[name]
    columns, values = _columns(arguments, seed=1), {**values, **FURTHER}
    p = namespace(values)
    expected = np.array([_call(function, FLOATS, p, [c[i].item() for c in columns]) for i in range(LANES)], float)
    with np.errstate(over="ignore"):
        actual = {"arrays": _arrays, "symbols": _symbols, "traced": _traced}[kind](function, columns, values)
    if kind == "traced":
        np.testing.assert_array_equal(actual, expected)  # the same operations in the same order: the same bits
    else:
        scale = np.abs(expected).max(axis=0, keepdims=True)
        assert np.all(np.abs(actual - expected) <= ABSOLUTE + RELATIVE * scale)


def _arrays(function: Function, columns: list[np.ndarray], values: Mapping[str, Any]) -> np.ndarray:
    results = _call(function, ARRAYS, namespace(values), columns)
    return np.stack([np.broadcast_to(r, LANES) for r in results], axis=1).astype(float)


def _symbols(function: Function, columns: list[np.ndarray], values: Mapping[str, Any]) -> np.ndarray:
    symbols = [ca.SX.sym(f"x{i}") for i in range(len(columns))]
    parameters = {name: ca.SX.sym(name) for name in values}
    results = _call(function, SYMBOLS, namespace(parameters), list(symbols))
    evaluate = ca.Function("f", [ca.vertcat(*symbols), ca.vertcat(*parameters.values())], [ca.vertcat(*results)])
    numbers = ca.DM([float(v) for v in values.values()])
    return np.array([np.array(evaluate(ca.DM([float(c[i]) for c in columns]), numbers)).ravel() for i in range(LANES)])


def _traced(function: Function, columns: list[np.ndarray], values: Mapping[str, Any]) -> np.ndarray:
    tracer = Tracer()
    p = namespace({name: tracer.parameter(name) for name in values})
    names = [f"x{i}" for i in range(len(columns))]
    tracer.function("f", names, lambda *arguments: _call(function, tracer, p, list(arguments)))
    space: dict[str, Any] = {}
    exec(python_source(tracer, "test"), space)
    (run,) = space["make"](values)
    return np.array([run(*(c[i].item() for c in columns)) for i in range(LANES)], float)


def test_kernel_computes_the_functions_of_the_actuator(values: Mapping[str, Any]) -> None:
    kernel = codegen.make()(values)
    p = namespace(values)
    for (_, names, function), compiled in zip(codegen.functions(ACTUATOR), kernel, strict=True):
        columns = _columns(names, seed=2)
        for i in range(LANES if columns else 1):
            arguments = [c[i].item() for c in columns]
            assert tuple(compiled(*arguments)) == tuple(_flat(function(FLOATS, p, *arguments)))


def test_floats_refuse_symbols() -> None:
    with pytest.raises(TypeError, match="SX"):
        FLOATS.sin(ca.SX.sym("x"))
    with pytest.raises(TypeError, match="SX"):
        FLOATS.where(ca.SX.sym("x") > 0, 1.0, 2.0)


def test_traced_values_cannot_be_compared_by_python() -> None:
    """Without the error, x == 0.0 would be False while tracing."""
    traced = Tracer().parameter("a")
    with pytest.raises(TypeError, match=r"ops\.equal"):
        _ = traced == 0.0
    with pytest.raises(TypeError, match=r"ops\.equal"):
        _ = traced != 0.0


def test_traced_value_cannot_be_a_condition() -> None:
    tracer = Tracer()
    with pytest.raises(TypeError, match=r"ops\.where"):
        bool(tracer.parameter("a") > 1.0)


def test_tracing_hoists_parameters_and_drops_unused_values() -> None:
    tracer = Tracer()
    a = tracer.parameter("a")

    def body(x: Any) -> tuple[Any, ...]:
        tracer.exp(x)  # unused
        return (tracer.sin(a) * x + tracer.sin(a) * x,)

    tracer.function("f", ["x"], body)
    prologue, function = python_source(tracer, "test").split("def f")
    assert "sin(p0)" in prologue
    assert "sin" not in function
    assert "exp(" not in function
    assert function.count("*") == 1  # the common product once


def test_only_the_chosen_branch_is_evaluated() -> None:
    tracer = Tracer()
    tracer.function("f", ["x"], lambda x: tracer.branch(x > 0.0, lambda: (tracer.log(x),), lambda: (0.0,)))
    space: dict[str, Any] = {}
    exec(python_source(tracer, "test"), space)
    (f,) = space["make"]({})
    assert f(-1.0) == (0.0,)  # log(-1) would raise
    assert f(1.0) == (0.0,)


@pytest.mark.parametrize(("name", "arguments", "expected"), [
    ("tanh", [(x,) for x in (-30.0, -1.0, -0.1, -0.0999, -1e-9, 0.0, 1e-3, 0.099, 0.5, 700.0)], math.tanh),
    ("sign", [(-2.0,), (0.0,), (1e-300,)], lambda x: (x > 0.0) - (x < 0.0)),
    ("atan2", [(y, x) for y in (-3.0, -1e-9, 0.0, 1.0, 5.0) for x in (-4.0, -1e-12, 1e-12, 0.5, 5.0)], math.atan2),
    ("atan2", [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0)], math.atan2),
    ("pow", [(x, y) for x in (0.0, 0.3, 1.0, 7.0) for y in (0.5, 1.5, 2.0, 3.25)], math.pow),
    ("pow", [(-1.5, 3), (-1.5, 2.0), (2.0, -2), (5.0, 0), (1.1, 63)], math.pow),
])
def test_derived_functions_agree_with_the_c_library(name: str, arguments: list[tuple[float, ...]],
                                                    expected: Callable[..., float]) -> None:
    for row in arguments:
        numbers = [float(getattr(ops, name)(*row)) for ops in (FLOATS, ARRAYS)]
        symbols = [ca.SX.sym(f"x{i}") for i in range(len(row))]
        # A whole exponent remains a number.
        inputs = [value if name == "pow" and row[1] == int(row[1]) and i else symbols[i] for i, value in enumerate(row)]
        traced = ca.Function("f", symbols, [getattr(SYMBOLS, name)(*inputs)])
        for number in (*numbers, float(traced(*row))):
            assert number == pytest.approx(expected(*row), rel=1e-14, abs=1e-300), (name, row)


def test_tables_are_interpolated_linearly() -> None:
    points, values = (-1.0, 0.0, 2.0), (3.0, 1.0, 5.0)
    xs = np.array([-9.0, -1.0, -0.5, 0.0, 0.25, 2.0, 7.0])
    expected = np.interp(xs, points, values)
    np.testing.assert_allclose(ARRAYS.interp(xs, points, values), expected, rtol=1e-15)
    assert [FLOATS.interp(float(x), points, values) for x in xs] == pytest.approx(list(expected), rel=1e-15)
    for bad in ((0.0,), (0.0, 0.0), (1.0, 0.0)):
        with pytest.raises(ValueError, match="table"):
            FLOATS.interp(0.5, bad, bad)

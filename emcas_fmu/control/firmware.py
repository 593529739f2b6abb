"""Firmware of a digital servo: a PID controller on counts of the output's encoder, whose result is a PWM duty cycle.

    e = n(clip(command)) - n(angle)        n(x) = floor(x/q + 1/2)        q = 2 pi/counts a turn
    P = K_p e' + I - K_d dn/dt + P_f       e' = 0 for |e| < dead band, else e
    duty = clip(P, +-P_max)/P_full         I+ = I + T_s K_i e', held while |P| > P_max and e' increases |P|

n is the encoder's counts. P is in counts of PWM, P_full of which are a duty cycle of 1; P_f is that of the feed-forward
of a motion, 0 without a motion. T_s is the frame time. If `encoder.enabled` is false, n(x) is not rounded.
"""

from __future__ import annotations

from math import pi
from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from .controllers import clipped_command
from .trajectory import Ahead, added


class SampleResult(NamedTuple):
    """Result of a frame: duty cycle [-]; `limited`, 1 if a limit of PWM or command is active, else 0; the integral
    [counts of PWM] after the frame; the encoder's counts."""

    duty: Value
    limited: Value
    integral: Value
    counts: Value


def count(p: Any) -> Value:
    """Return the angle of one count [rad]."""
    return 2.0 * pi / p.encoder.counts


def counts(ops: Ops, p: Any, angle: Value) -> Value:
    """Return the counts of the encoder at an angle [rad] of the output."""
    exact = angle / count(p)
    return ops.where(p.encoder.enabled, ops.floor(exact + 0.5), exact)


def sample(ops: Ops, p: Any, integral: Value, before: Value, angle: Value, command: Value,
           ahead: Ahead | None = None) -> SampleResult:
    """Return the result of a frame at an output `angle` [rad] for an unlimited fin `command` [rad].

    `before` is the number of counts at the last frame; `ahead` contains P_f as its `reference`.
    """
    c, period = p.controller, p.controller.sample_time
    now = counts(ops, p, angle)
    error = counts(ops, p, clipped_command(ops, p, command)) - now
    acting = ops.where(ops.fabs(error) < c.dead_band, 0.0, error)
    pwm = c.kp * acting + integral - c.kd * (now - before) / period
    pwm = added(ops, pwm, ahead, "reference")
    beyond = ops.fabs(pwm) > p.pwm.limit
    winds_up = ops.both(beyond, pwm * acting > 0.0)
    limited = ops.either(beyond, ops.fabs(command) > p.command.limit)
    return SampleResult(ops.clip(pwm, -p.pwm.limit, p.pwm.limit) / p.pwm.full, ops.where(limited, 1.0, 0.0),
                        integral + ops.where(winds_up, 0.0, period * c.ki * acting), now)

"""The directions in which two bodies with four dry frictions start from rest."""

from __future__ import annotations

import random
from math import cos, pi, sin

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics.coupled import Bodies, Dry, directions


def test_directions_are_mirrored_and_complete() -> None:
    """Reversed torques reverse the directions; torques above all friction always move a body.

    All eight combinations of the two speeds' signs and order occur.
    """
    draw, patterns = random.Random(3), set()
    for _ in range(600):
        angle, size = draw.uniform(-pi, pi), draw.choice((0.5, 3.0, 60.0))
        inertias = (draw.uniform(0.5, 2.0), draw.uniform(0.5, 2.0))
        torques = (size * cos(angle), size * sin(angle))
        dry = [Dry(draw.uniform(0.1, 1.0), draw.uniform(0.1, 1.0)) for _ in range(4)]
        mirrored = Bodies(inertias, (-torques[0], -torques[1]), [Dry(each.low, each.high) for each in dry])
        starts = directions(FLOATS, Bodies(inertias, torques, dry), 0.0, 0.0)
        assert directions(FLOATS, mirrored, 0.0, 0.0) == tuple(-x for x in starts)
        if size == 60.0:
            assert any(starts)
            if all(starts):
                patterns.add(starts)
    assert len(patterns) == 8

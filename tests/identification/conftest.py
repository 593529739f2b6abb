"""Bench records for the identification: shipped records, and new records of random actuators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import degrees, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.identification import backlash, drive, friction, inertia
from emcas_fmu.studies.identification.result import Identification
from examples.identification_bench import bench

from .truths import draw_truth

BENCH = Path(__file__).resolve().parents[2] / "examples" / "identification_bench" / "records"
IDENTIFY: Mapping[str, Callable[..., Identification]] = {
    "friction": friction.identify, "drive": drive.identify, "inertia": inertia.identify, "backlash": backlash.identify}
# Parameters that the experiments assume to be known from other measurements of assembly and winding.
KNOWN = ("kinematics.initial_angle", "motor.resistance", "motor.inductance")


class Recovery(NamedTuple):
    """Errors in sigmas `z`, and sigmas relative to the true values: one row per actuator, one column per name."""

    names: list[str]
    z: Any
    relative: Any


def shipped(kind: str) -> list[Path]:
    """Return the shipped records of an experiment."""
    return sorted(BENCH.glob(f"{kind}*.csv"))


def recover(kind: str, seeds: range, folder: Path, **choice: Any) -> Recovery:
    """Identify random actuators from new records; of their parameters the base set contains only the known ones."""
    rows, sizes = [], []
    names: list[str] = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        truth = draw_truth(load_parameters(), rng)
        gap = radians(rng.uniform(0.02, 0.15))
        paths = []
        for name, columns in bench.data_sets(truth.values, seed, kinds=(kind,), backlash=gap, **choice):
            paths.append(folder / f"{seed}_{name}.csv")
            bench.write_record(paths[-1], columns)
        base = load_parameters().with_values({name: truth.values[name] for name in KNOWN})
        result = IDENTIFY[kind](paths, base)
        estimates = [e for e in result.estimates if e.parameter or kind == "backlash"]
        names = [e.name for e in estimates]
        true = np.array([degrees(gap) if kind == "backlash" else float(truth.values[n]) for n in names])
        sigma = np.array([e.sigma for e in estimates])
        rows.append((np.array([e.value for e in estimates]) - true) / sigma)
        sizes.append(sigma / np.abs(true))
    return Recovery(names, np.array(rows), np.array(sizes))


@pytest.fixture(scope="session")
def identified() -> Mapping[str, Identification]:
    """The results of all shipped records with the default set as base."""
    return {kind: identify(shipped(kind), load_parameters()) for kind, identify in IDENTIFY.items()}

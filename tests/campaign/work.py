"""Functions for Dask workers: one kills its worker, one is slow."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence

from emcas_fmu.simulation import Array
from emcas_fmu.studies.campaign.sample import SampleColumns, rows
from emcas_fmu.studies.campaign.study import Campaign

DEADLY = 13


def deadly(study: Campaign, indices: Sequence[int], drawn: Array) -> SampleColumns:
    """Return the rows, but kill the process if one of the samples is DEADLY."""
    if DEADLY in indices:
        os.kill(os.getpid(), signal.SIGKILL)
    return rows(study, indices, drawn)


def slow(study: Campaign, indices: Sequence[int], drawn: Array) -> SampleColumns:
    """Return the rows after 0.2 s, during which a test can kill a worker."""
    time.sleep(0.2)
    return rows(study, indices, drawn)

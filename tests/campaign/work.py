"""Work for workers that come to harm."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence

from emcas_fmu.simulation import Array
from emcas_fmu.studies.campaign.sample import Rows, rows
from emcas_fmu.studies.campaign.study import Study

DEADLY = 13


def deadly(study: Study, indices: Sequence[int], drawn: Array) -> Rows:
    """One sample ends the process it runs in."""
    if DEADLY in indices:
        os.kill(os.getpid(), signal.SIGKILL)
    return rows(study, indices, drawn)


def slow(study: Study, indices: Sequence[int], drawn: Array) -> Rows:
    """Long enough for a worker to be killed meanwhile."""
    time.sleep(0.2)
    return rows(study, indices, drawn)

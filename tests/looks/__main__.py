"""Approve the pictures of pages as they are now: of those that are named, otherwise of all."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from .looks import APPROVED, LOOKS, approve, camera, opened, taken
from .pages import NAMES, made

with TemporaryDirectory() as folder, camera(Path(folder)) as browser:
    for name in sys.argv[1:] or NAMES:
        page = made(name, Path(folder))
        for look in LOOKS:
            opened(browser, page, look)
            approve(*taken(browser), APPROVED / f"{name}_{look}.png")
        print(name, flush=True)

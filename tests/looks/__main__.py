"""Approve the pictures of pages as they are now: of those that are named, otherwise of all."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.docs.recipes import build_site

from .looks import APPROVED, LOOKS, approve, camera, opened, taken
from .pages import NAMES, made

with TemporaryDirectory() as folder, camera(Path(folder)) as browser:
    site = cache(lambda: build_site(Path(folder, "site")))
    for name in sys.argv[1:] or NAMES:
        page = made(name, Path(folder), site)
        for look in LOOKS:
            opened(browser, page, look)
            approve(*taken(browser), APPROVED / f"{name}_{look}.png")
        print(name, flush=True)

"""Approve the present pictures of the named pages, or of all pages."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.docs.recipes import build_site

from .looks import APPROVED, LOOKS, approve, camera, open_page, take_picture
from .pages import NAMES, page_path

with TemporaryDirectory() as folder, camera(Path(folder)) as browser:
    site = cache(lambda: build_site(Path(folder, "site")))
    for name in sys.argv[1:] or NAMES:
        page = page_path(name, Path(folder), site)
        for look in LOOKS:
            open_page(browser, page, look)
            approve(*take_picture(browser), APPROVED / f"{name}_{look}.png")
        print(name, flush=True)

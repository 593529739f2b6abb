"""Pictures of pages, and their differences from approved pictures.

A page is divided into parts: sections, headings, groups of controls, tables and figures. A part has the full width, and
ends where the next one begins. An approved picture has one pixel for each cell of 16 px. This shows a missing row,
column, figure, curve or colour, but not the shapes of letters. The browser uses only the fonts of Matplotlib, without
hinting, so that a page gives the same picture on every machine, to the bit.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image, ImageDraw
from PIL.PngImagePlugin import PngInfo

from tests.explore.browser import Browser, chromium

APPROVED = Path(__file__).with_name("approved")
CELL = 16  # px
# INK and CHANGE are levels of 255 in red, green or blue: a cell has ink if it differs from paper by 6, and has changed
# if it differs by 8. SHARE is the allowed share of changed cells among cells with ink. Two runs differ in no cell. A
# hidden column of a table changes 7 % if it is sparse and 74 % if it is full, text in #999 on light paper 32 %, missing
# curves 36 %, an empty chart 74 %, inverted colours all.
INK, CHANGE, SHARE = 6.0, 8.0, 0.04
WINDOW, MOST = 12, 2  # cells; a missing short row of a table changes 3 cells of a window, an empty chart 16 or more
FEW = 25  # cells with ink are assumed at least, so that one cell of a short line is no defect
TALLER = 8  # px, less than half a line
# Width [px], medium, colour scheme. Style sheets choose the layout by width and colours by scheme, and nothing by both:
# one scheme for each width is enough. The print is an A4 sheet without its margins, white with every scheme.
LOOKS: Mapping[str, tuple[int, str, str]] = {
    "400_light": (400, "screen", "light"), "1400_dark": (1400, "screen", "dark"), "print": (687, "print", "dark")}
_PARTS = """[...document.querySelectorAll(`main > *, article > *, section.entry > *, body > footer,
    :is(main, article) :is(h2, fieldset, figure, table:not(figure table))`)].map(each => {
    const box = each.getBoundingClientRect(), words = each.querySelector("caption, figcaption") ?? each;
    const text = words.textContent.trim().replace(/\\s+/g, " ").slice(0, 40);
    return [box.top + scrollY, box.height, `${each.localName} ${text}`]; })"""
_PASS = """const done = arguments[0]; (async () => {
    if (typeof loaded !== "undefined") await loaded;
    for (let y = 0; y < document.documentElement.scrollHeight; y += innerHeight) {
        scrollTo(0, y); await new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn))); }
    scrollTo(0, 0);
    const {classList, dataset} = document.body;
    for (let before, now = ""; now !== before || classList.contains("waiting");
         now = `${dataset.ready} ${document.documentElement.scrollHeight}`) {
        before = now; await new Promise(rested => setTimeout(rested, 300)); }
    done(); })()"""
_FONTS = """<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig><dir>{fonts}</dir><cachedir>{folder}</cachedir>
<selectfont><rejectfont><glob>*</glob></rejectfont><acceptfont><glob>*/DejaVuSans*</glob></acceptfont></selectfont>
<match target="font"><edit name="hinting" mode="assign"><bool>false</bool></edit>
<edit name="antialias" mode="assign"><bool>true</bool></edit><edit name="rgba" mode="assign"><const>none</const></edit>
</match></fontconfig>"""


class Part(NamedTuple):
    """A part of a page: its first words, top and height [px]."""

    name: str
    top: int
    height: int


@contextmanager
def camera(folder: Path) -> Iterator[Browser]:
    """Start a browser that uses only the fonts of Matplotlib."""
    file = folder / "fonts.conf"
    file.write_text(_FONTS.format(fonts=Path(mpl.get_data_path(), "fonts", "ttf"), folder=folder), "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FONTCONFIG_FILE", str(file))
        with chromium() as browser:
            yield browser


def open_page(browser: Browser, path: Path, look: str) -> None:
    """Open a page in a look without stored settings, and wait until all of its charts are plotted."""
    width, medium, scheme = LOOKS[look]
    emulate(browser, medium, scheme)
    for command, arguments in (
            ("Emulation.setScrollbarsHidden", {"hidden": True}),
            ("Storage.clearDataForOrigin", {"origin": "file://", "storageTypes": "all"})):  # e.g. the colour scheme
        browser.driver.execute_cdp_cmd(command, arguments)
    browser.size(width)
    browser.load(path)
    browser.driver.execute_async_script(_PASS)


def emulate(browser: Browser, medium: str, scheme: str) -> None:
    """Set the emulated medium and colour scheme, with reduced motion."""
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": medium, "features": [
        {"name": "prefers-color-scheme", "value": scheme}, {"name": "prefers-reduced-motion", "value": "reduce"}]})


def take_picture(browser: Browser) -> tuple[Image.Image, list[Part]]:
    """Return the picture of the whole open page, and its parts from the top."""
    width, height = browser.run("[document.documentElement.clientWidth, document.documentElement.scrollHeight]")
    whole = Image.new("RGB", (width, height))
    for top in range(0, height, 4000):  # Chromium's limit is 16384 px
        clip = {"x": 0, "y": top, "width": width, "height": min(4000, height - top), "scale": 1}
        data = browser.driver.execute_cdp_cmd("Page.captureScreenshot", {
            "captureBeyondViewport": True, "clip": clip, "optimizeForSpeed": True})  # the same pixels in a larger file
        whole.paste(Image.open(io.BytesIO(base64.b64decode(data["data"]))), (0, top))
    tops = {0: "top"}
    for top, tall, name in sorted(browser.run(_PARTS)):
        if tall and max(tops) + CELL <= top <= height - CELL:
            tops[round(top)] = name
    ends = [*list(tops)[1:], height]
    return whole, [Part(name, top, end - top) for (top, name), end in zip(tops.items(), ends, strict=True)]


def contrast(one: Sequence[int], other: Sequence[int]) -> float:
    """Return the contrast of two colours (red, green, blue, 0 to 255): 1 to 21 (WCAG 2.1)."""
    def luminance(color: Sequence[int]) -> float:
        red, green, blue = (float(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4)
                            for s in (byte / 255.0 for byte in color[:3]))
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def rows(height: int) -> int:
    """Return the number of rows of cells in a part with this height [px]."""
    return max(1, round(height / CELL))


def cells(picture: Image.Image, part: Part, count: int) -> np.ndarray[Any, Any]:
    """Return the mean red, green and blue, 0 to 255, of each cell of a part in `count` rows: count x columns x 3."""
    strip = picture.crop((0, part.top, picture.width, part.top + part.height))
    return np.asarray(strip.resize((round(strip.width / CELL), count), Image.Resampling.BOX), dtype=float)


def most_changed(changed: np.ndarray[Any, Any]) -> int:
    """Return the largest number of changed cells in any window of WINDOW x WINDOW cells of a part."""
    padded = np.pad(changed, [(0, max(0, WINDOW - length)) for length in changed.shape])
    return int(np.lib.stride_tricks.sliding_window_view(padded, (WINDOW, WINDOW)).sum(axis=(2, 3)).max())


def approve(picture: Image.Image, parts: list[Part], path: Path) -> None:
    """Write an approved picture: the cells of the parts one below another, with the parts' names and heights."""
    about = PngInfo()
    about.add_text("parts", json.dumps([[part.name, part.height] for part in parts]))
    colors = np.vstack([cells(picture, part, rows(part.height)) for part in parts])
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(colors.round().astype(np.uint8)).save(path, pnginfo=about, optimize=True)


def differences(picture: Image.Image, parts: list[Part], approved: Path) -> list[str]:
    """Describe the differences from an approved picture, and frame the changed cells in the new picture."""
    with Image.open(approved) as stored:
        names: list[tuple[str, int]] = json.loads(stored.info["parts"])
        colors = np.asarray(stored, dtype=float)
    if len(names) != len(parts):
        first = [f"; the first other one: “{new.name}”, approved “{old}”" for (old, _), new in zip(names, parts)
                 if old != new.name][:1]
        return [f"{len(parts)} parts, approved {len(names)}{''.join(first)}"]
    texts, pen, paper = [], ImageDraw.Draw(picture), np.median(colors, axis=(0, 1))
    for (name, height), part, old in zip(names, parts, np.split(colors, np.cumsum([rows(h) for _, h in names])[:-1]),
                                         strict=True):
        new = cells(picture, part, len(old))
        changed = np.abs(new - old).max(axis=2) >= CHANGE
        ink = np.maximum(np.abs(new - paper), np.abs(old - paper)).max(axis=2) >= INK
        share = changed.sum() / max(ink.sum(), FEW)
        if abs(part.height - height) > TALLER:
            texts.append(f"“{name}” is {part.height} px high, approved {height}")
        elif share > SHARE:
            texts.append(f"“{name}” differs in {share:.0%} of its cells, allowed {SHARE:.0%}")
        elif (most := most_changed(changed)) > MOST:
            texts.append(f"“{name}” differs in {most} cells of {WINDOW} x {WINDOW}, allowed {MOST}")
        else:
            continue
        for y, x in np.argwhere(changed):
            pen.rectangle((x * CELL, part.top + y * CELL, (x + 1) * CELL, part.top + (y + 1) * CELL), outline="red")
    return texts

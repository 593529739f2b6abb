"""Fixtures: one browser for all tests of a process, and the default actuator's page in it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .browser import Browser, chromium


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def tab(browser: Browser) -> Iterator[Browser]:
    """A tab with the default actuator's page as it opens; the test fails if the page prints to the console."""
    browser.size(1400)
    browser.renew()
    yield browser
    assert browser.complaints == []

"""One browser for all tests of a process."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .browser import Browser, chromium


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def opened(browser: Browser) -> Iterator[Browser]:
    """The default actuator's page as it opens; its console stays empty."""
    browser.size(1400)
    browser.renew()
    yield browser
    assert browser.complaints == []

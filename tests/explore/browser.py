"""A headless Chromium, and the pages that it opens."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.explore import page
from tests.docs.recipes import ROOT
from tests.hosts.host import missing, tool

DEFAULT_PAGE = ROOT / "docs" / "explore" / "nonlinear.html"  # of the default actuator
TIMEOUT = 60.0  # s, on a loaded machine


class Browser:
    """An open page; scripts can call the page's functions by their names."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open_default(self) -> None:
        """Open the default actuator's page if it is not open."""
        if not self.driver.current_url.startswith(DEFAULT_PAGE.as_uri()) or not self.run("window.page !== undefined"):
            self.open(DEFAULT_PAGE)

    def renew(self) -> None:
        """Reset the default actuator's page."""
        self.open_default()
        self.run("(page => { page.hash = null; history.replaceState(null, '', '#'); page.restore(); })(window.page)")
        self.settle()

    def open(self, path: Path, link: str = "") -> None:
        """Open a page and wait for its first response."""
        self.load(path, link)
        self.driver.execute_async_script("const done = arguments[0]; loaded.then(page => {"
                                         "window.page = page; done(); });")
        self.settle()

    def load(self, path: Path, link: str = "") -> None:
        """Load any page."""
        self.driver.get("about:blank")
        self.driver.get(path.as_uri() + link)

    def run(self, script: str, *arguments: Any) -> Any:
        """Return the value of an expression of JavaScript."""
        return self.driver.execute_script(f"return ({script});", *arguments)

    def wait(self, condition: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + TIMEOUT
        while not self.run(condition):
            assert time.monotonic() < end, condition
            time.sleep(0.02)

    def set(self, name: str, value: Any) -> None:
        """Set a value [SI] as a control does, and wait for the response."""
        self.run("window.page.change(...arguments)", name, value)
        self.settle()

    def settle(self) -> None:
        """Wait for the frame in which the response is computed."""
        self.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")

    def run_and_finish(self, action: str) -> None:
        """Run a script, and wait for the long computations, which the page otherwise begins after a pause."""
        self.driver.execute_async_script(f"""const done = arguments[0]; {action};
            requestAnimationFrame(() => requestAnimationFrame(() => {{
                clearTimeout(window.page.timer);
                window.page.finish().then(done);
            }}));""")

    def size(self, width: int, height: int = 900) -> None:
        """Set the size of the window [px]."""
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": False})

    @property
    def complaints(self) -> list[str]:
        """Messages on the console since the last call."""
        return [line["message"] for line in self.driver.get_log("browser")]


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser without network traffic; skip the test if there is no browser."""
    try:
        from selenium import webdriver
    except ImportError:
        missing("there is no selenium (pip install selenium)")
    program, server = tool("chromium", "chromium"), tool("chromedriver", "chromium-driver")
    with TemporaryDirectory(prefix="emcas_browser_", ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = program
        for argument in ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
                         "--disable-background-networking", "--disable-component-update", "--disable-sync",
                         "--disable-dev-shm-usage", f"--user-data-dir={profile}"):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        driver = webdriver.Chrome(options, webdriver.ChromeService(server))
        driver.set_script_timeout(TIMEOUT)
        try:
            yield Browser(driver)
        finally:
            driver.quit()


def write_page(folder: Path, model: str, requirements: Path | None = None) -> Path:
    """Write the page of an actuator with its default parameters, and return its path."""
    path = folder / "explore.html"
    subject = ParameterSubject(load_parameters(model=model))
    path.write_text(page.render(subject, {}, "emcas explore", requirements=requirements), encoding="utf-8")
    return path

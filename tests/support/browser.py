"""Debian's Chromium without a head, driven by its own driver; nothing is downloaded and nothing of
a user's is touched."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

# set by .ci/run: no browser is a failure there, not something to leave out
NEEDED = "MODELSEL_NEED_BROWSER"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--window-size=1280,1000",
)


def programs() -> tuple[str, str]:
    """(browser, driver); without them the test is left out and says so, or fails where the browser
    is needed."""
    browser = next(
        (
            path
            for name in ("chromium", "chromium-browser", "google-chrome")
            if (path := shutil.which(name))
        ),
        None,
    )
    driver = shutil.which("chromedriver")
    if browser is None or driver is None:
        why = "no Chromium with its driver (apt-get install -y chromium chromium-driver): report.html is not tested in a browser"
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(why)
    return browser, driver


@contextmanager
def chromium(**media: str) -> Iterator[Any]:
    """A driver; `media` are emulated media features: prefers_color_scheme="dark"."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    browser, driver = programs()
    with TemporaryDirectory(ignore_cleanup_errors=True) as empty:
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for flag in (*FLAGS, f"--user-data-dir={empty}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        page = webdriver.Chrome(options=options, service=Service(driver))
        try:
            features = [
                {"name": name.replace("_", "-"), "value": value} for name, value in media.items()
            ]
            page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
            yield page
        finally:
            page.quit()


def resize(page: Any, width: int, height: int, scale: float = 1.0) -> None:
    """The window's inner size in CSS pixels."""
    page.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False},
    )


def opened(page: Any, file: Path) -> Any:
    """The page after it has put itself together."""
    from selenium.webdriver.support.ui import WebDriverWait

    page.get(file.as_uri())
    WebDriverWait(page, 20).until(
        lambda d: d.execute_script("return document.documentElement.dataset.ready") == "yes"
    )
    return page


def requests(page: Any) -> list[str]:
    """Addresses asked for since the last call; those within the browser itself are of its own window."""
    events = [json.loads(entry["message"])["message"] for entry in page.get_log("performance")]
    sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    urls = [params["request"]["url"] for params in sent]
    return [url for url in urls if not url.startswith("chrome://")]

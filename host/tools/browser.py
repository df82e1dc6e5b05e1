"""Runs a headless Chromium without a GPU through Playwright, for tests and timings of the viewer page."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from lippmann.errors import MissingLibraryError

if TYPE_CHECKING:
    from playwright.sync_api import Page

#: Names of the Chromium program, in the order in which they are tried.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: Options that make Chromium render in software, including WebGL (SwiftShader), so that machines can be compared.
SOFTWARE = ("--disable-gpu", "--enable-unsafe-swiftshader")


@contextmanager
def browser_page(width_px: int = 800, height_px: int = 600) -> Iterator[Page]:
    """Start Chromium and yield a page of it; raise MissingLibraryError if Chromium or Playwright is missing."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        raise MissingLibraryError("Chromium is not installed; run make setup as root, or apt-get install chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise MissingLibraryError("Playwright is missing; run make setup") from None
    with sync_playwright() as playwright:
        # Chromium's sandbox does not work for root.
        browser = playwright.chromium.launch(executable_path=program, chromium_sandbox=os.geteuid() != 0, args=SOFTWARE)
        try:
            yield browser.new_page(viewport={"width": width_px, "height": height_px})
        finally:
            browser.close()

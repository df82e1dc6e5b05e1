"""Measures the speed of the viewer page in Chromium without a GPU (`tools.bench view`)."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lippmann.display.description import load_display
from lippmann.eye.viewer_page import page_html
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.scene import load_scene

from tools.browser import browser_page

if TYPE_CHECKING:
    from playwright.sync_api import Page

#: Size of the browser's window, and time, s, over which frames are counted.
WIDTH_PX, HEIGHT_PX = 800, 600
COUNT_S = 5.0

#: Script that returns the seconds from navigation to the first view, for which it waits by reading a pixel.
OPENED = """
lippmann.viewer.then((viewer) => new Promise((done) => requestAnimationFrame(() => {
  const gl = viewer.renderer.gl;
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  done(performance.now() / 1000);
})))
"""
#: Script that moves the eye, and returns the number of frames, the seconds and the canvas' size.
COUNTED = """
(seconds) => lippmann.viewer.then((viewer) => new Promise((done) => {
  const sway = document.getElementById("sway");
  sway.click();
  let first, frames = -1;
  const count = (now) => {
    first ??= now;
    frames += 1;
    if (now - first < 1000 * seconds) return requestAnimationFrame(count);
    sway.click();
    done([frames, (now - first) / 1000, viewer.canvas.width, viewer.canvas.height]);
  };
  requestAnimationFrame(count);
}))
"""


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield rows of pages that show the fish, or incompressible noise, on the founding paper's displays."""
    scene = load_scene(scenes / "fish/fish.xml")
    for name in ("paper-square", "paper-hex"):
        display = load_display(scenes / f"displays/{name}.toml")
        shape = (display.panel.height_px, display.panel.width_px, 3)
        pictures = {
            "fish": render_integral(scene, display, "exact", Settings(samples=1, seed=seed)).radiance,
            "noise": np.random.default_rng(seed).random(shape, np.float32),
        }
        for what, radiance in pictures.items():
            page = page_html(display, radiance, f"{what} on {name}").encode("utf-8")
            yield {"picture": what, "display": name, **_measured(page)}


def _measured(html: bytes) -> dict[str, Any]:
    """Return a page's size, the seconds until its first view, and frame rates in normal layout and full window."""
    with tempfile.TemporaryDirectory() as folder, browser_page(WIDTH_PX, HEIGHT_PX) as page:
        file = Path(folder) / "page.html"
        file.write_bytes(html)
        page.goto(file.as_uri())
        opened = page.evaluate(OPENED)
        frames, seconds, *page_px = page.evaluate(COUNTED, COUNT_S)
        page.evaluate("document.getElementById('fill').click()")
        # Wait until the frame rate is steady.
        page.evaluate(COUNTED, 1.0)
        before = _processor_seconds(page)
        full_frames, full_seconds, *full_px = page.evaluate(COUNTED, COUNT_S)
        used = _processor_seconds(page) - before
    row = {"page_mb": len(html) / 1e6, "open_seconds": opened}
    row |= {"page_px": tuple(page_px), "page_rate": frames / seconds}
    row |= {"full_px": tuple(full_px), "full_rate": full_frames / full_seconds}
    return {**row, "full_cpu_seconds": used / full_frames}


def _processor_seconds(page: Page) -> float:
    browser = page.context.browser
    assert browser is not None
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    return sum(float(process["cpuTime"]) for process in processes)

"""Speed of the viewer page in Chromium without a GPU (`lippmann bench view`)."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.cli.bench import Bench, measurement
from lippmann.dev.browser import Browser
from lippmann.display import load_display
from lippmann.rendering.renderer import Settings, render_integral
from lippmann.rendering.scene import load_scene
from lippmann.viewer.page import page_html

#: The browser's window, and the seconds over which frames are counted.
WIDTH_PX, HEIGHT_PX = 800, 600
COUNT_S = 5.0

#: Seconds from the start of the navigation until the first view is on the canvas: reading a pixel waits for it.
OPENED = """
lippmann.viewer.then((viewer) => new Promise((done) => requestAnimationFrame(() => {
  const gl = viewer.renderer.gl;
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  done(performance.now() / 1000);
})))
"""
#: Frames and seconds while the eye sways from side to side.
COUNTED = """
lippmann.viewer.then((viewer) => new Promise((done) => {
  const sway = document.getElementById("sway");
  sway.click();
  let first, frames = -1;
  const count = (now) => {
    first ??= now;
    frames += 1;
    if (now - first < 1000 * %(seconds)s) return requestAnimationFrame(count);
    sway.click();
    done([frames, (now - first) / 1000, viewer.canvas.width, viewer.canvas.height]);
  };
  requestAnimationFrame(count);
}))
"""


@dataclass(frozen=True)
class ViewRow:
    """A page's size, seconds until its first view, and frames a second as laid out and when it fills the window.

    `full_cpu_seconds` is the processor time, of all the browser's processes, for a frame that fills the window.
    """

    picture: str
    display: str
    page_mb: float
    open_seconds: float
    page_px: tuple[int, int]
    page_rate: float
    full_px: tuple[int, int]
    full_rate: float
    full_cpu_seconds: float


@measurement()
def view(bench: Bench) -> tuple[Mapping[str, Any], None]:
    """Measure viewer pages in Chromium without a GPU: time until the first view, frames a second.

    Example: lippmann bench view
    """
    return {"rows": bench.collect(measure(bench.scenes, bench.seed))}, None


def measure(scenes: Path, seed: int) -> Iterator[ViewRow]:
    """Measure pages of the fish, and of noise, which no coding makes smaller, on both of the paper's displays."""
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
            yield _measured(what, name, page)


def _measured(picture: str, display: str, page: bytes) -> ViewRow:
    with tempfile.TemporaryDirectory() as folder, Browser(WIDTH_PX, HEIGHT_PX) as browser:
        file = Path(folder) / "page.html"
        file.write_bytes(page)
        browser.open(file.as_uri())
        opened = float(browser.evaluate(OPENED))
        frames, seconds, *page_px = _counted(browser)
        browser.evaluate("document.getElementById('fill').click()")
        _counted(browser, 1.0)  # until the frame rate is steady
        before = browser.processor_seconds()
        full_frames, full_seconds, *full_px = _counted(browser)
        used = browser.processor_seconds() - before
    return ViewRow(
        picture=picture,
        display=display,
        page_mb=len(page) / 1e6,
        open_seconds=opened,
        page_px=(int(page_px[0]), int(page_px[1])),
        page_rate=frames / seconds,
        full_px=(int(full_px[0]), int(full_px[1])),
        full_rate=full_frames / full_seconds,
        full_cpu_seconds=used / full_frames,
    )


def _counted(browser: Browser, seconds: float = COUNT_S) -> list[float]:
    counted: list[float] = browser.evaluate(COUNTED % {"seconds": json.dumps(seconds)})
    return counted

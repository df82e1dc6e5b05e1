"""Measures the PSNR of eyes' views through lenslets against perspective renders (`tools.bench observe`)."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.base.images import Radiance
from lippmann.base.tones import psnr_db
from lippmann.display.description import Display, load_display
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral, render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, load_scene

#: Eye positions, mm, at reading distance: within the paper's displays' viewing angle, and in desktop-hex's zone.
EYES = ((0.0, 0.0, 600.0), (-30.0, 0.0, 600.0), (30.0, 0.0, 600.0), (0.0, 25.0, 600.0), (20.0, -20.0, 600.0))
ZONE_EYES = ((0.0, 0.0, 600.0), (-40.0, 0.0, 600.0), (40.0, 0.0, 600.0))
VIEW_SAMPLES = 64

Mask = npt.NDArray[np.bool_]


def smooth_part(scene_path: Path, eye: tuple[float, float, float], window: Window) -> Mask:
    """Return which pixels show only the placement file's object "smooth", two or more pixels from its edge."""
    objects = tomllib.loads(scene_path.with_suffix(".toml").read_text()).get("object", [])
    mask = np.zeros((window.height_px, window.width_px), np.bool_)
    for smooth in (entry for entry in objects if entry["name"] == "smooth"):
        mask = _covered(smooth, eye, window, grow_px=-2.0)
        for entry in objects:
            # Exclude objects in front, which may hide the smooth object.
            if entry["centre_mm"][2] > smooth["centre_mm"][2]:
                mask &= ~_covered(entry, eye, window, grow_px=2.0)
    return mask


def _covered(entry: dict[str, Any], eye: tuple[float, float, float], window: Window, grow_px: float) -> Mask:
    """Return which pixels are in the bounding box of an object's projection on z = 0, extended by `grow_px`."""
    x, y, z = entry["centre_mm"]
    width, height = entry["size_mm"] if "size_mm" in entry else (2.0 * entry["radius_mm"],) * 2
    scale = eye[2] / (eye[2] - z)
    cx, cy = eye[0] + (x - eye[0]) * scale, eye[1] + (y - eye[1]) * scale
    pixel = window.width_mm / window.width_px
    half_x, half_y = 0.5 * width * scale + grow_px * pixel, 0.5 * height * scale + grow_px * pixel
    px = ((np.arange(window.width_px) + 0.5) / window.width_px - 0.5) * window.width_mm
    py = (0.5 - (np.arange(window.height_px) + 0.5) / window.height_px) * window.height_mm
    return np.asarray((np.abs(px - cx) <= half_x)[None, :] & (np.abs(py - cy) <= half_y)[:, None])


def measure(scenes: Path, seed: int, samples: int = 16) -> Iterator[dict[str, Any]]:
    """Yield rows with the PSNR of eyes' views, for the founding paper's displays and for a large display."""
    settings = Settings(samples=samples, seed=seed)
    for name in ("chart", "fish"):
        scene = load_scene(scenes / f"{name}/{name}.xml")
        for display_name in ("paper-square", "paper-hex"):
            display = load_display(scenes / f"displays/{display_name}.toml")
            for row, view, direct in _compared(scene, display, EYES, settings):
                mask = smooth_part(scene.path, row["eye_mm"], whole_window(display))
                yield {**row, "smooth_db": psnr_db(view, direct, mask) if mask.any() else None}
    large = load_display(scenes / "displays/desktop-hex.toml")
    chart = load_scene(scenes / "chart/chart.xml")
    wider = Placement(scale=large.panel.height_mm / load_display(scenes / "displays/paper-square.toml").panel.height_mm)
    filling = chart.placed(chart.placement.then(wider))
    parallel = replace(large, name=f"{large.name} without viewing_distance_mm", viewing_distance_mm=None)
    for display in (large, parallel):
        for row, *_ in _compared(filling, display, ZONE_EYES, replace(settings, samples=max(1, samples // 4))):
            yield {**row, "smooth_db": None}


def _compared(
    scene: Scene, display: Display, eyes: tuple[tuple[float, float, float], ...], settings: Settings
) -> Iterator[tuple[dict[str, Any], Radiance, Radiance]]:
    """Yield each eye's row, the eye's view through the lenslets, and the perspective render."""
    image = render_integral(scene, display, "exact", settings).radiance
    window = whole_window(display)
    for eye in eyes:
        view = observe(image, display, Eye(eye), window, VIEW_SAMPLES)
        direct = render_view(scene, eye, window, replace(settings, samples=VIEW_SAMPLES)).radiance
        row: dict[str, Any] = {"scene": scene.path.stem, "display": display.name, "eye_mm": eye}
        row |= {"crosstalk_percent": 100.0 * view.status_share["crosstalk"], "whole_db": psnr_db(view.radiance, direct)}
        yield row, view.radiance, direct

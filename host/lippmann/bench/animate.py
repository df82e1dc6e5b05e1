"""`lippmann bench animate`: a film by two workers on this machine against one process, and whether pixels are equal."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lippmann.display import load_display
from lippmann.film.cluster import render_on_cluster
from lippmann.film.film import load_film
from lippmann.film.shot import Options, Shot, render_shot, shots_of
from lippmann.images import Image
from lippmann.render.renderer import Settings
from lippmann.render.variant import device_of

WORKERS = 2
#: Display, scale of the film, and how many of its frames.
CASES = (("vga-square", 0.25, 24), ("paper-square", 1.0, 8))


@dataclass(frozen=True)
class Row:
    """One display's film: seconds of one process and of the workers, both warm, their ratio, and pixels that differ."""

    display: str
    frames: int
    width_px: int
    height_px: int
    one_seconds: float
    workers: int
    workers_seconds: float
    pixels_differ: int

    @property
    def ratio(self) -> float:
        """Time of the workers over that of one process."""
        return self.workers_seconds / self.one_seconds


def bench_animate(mi: Any, scenes: Path) -> list[Row]:
    """Measure the shipped film on each display."""
    from distributed import Client, LocalCluster

    film = load_film(scenes / "films/swim.toml")
    device = device_of(mi)
    rows = []
    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster, Client(cluster) as client:  # fmt: skip
        for name, scale, frames in CASES:
            display = load_display(scenes / f"displays/{name}.toml")
            shots = shots_of(mi, film, display, Options(settings=Settings(samples=4), scale=scale))[:frames]
            # Scene and programs are then there, here and on every worker.
            alone(mi, shots[:1])
            client.run(_warm, device, shots[0])
            started = time.perf_counter()
            ours = alone(mi, shots)
            one = time.perf_counter() - started
            started = time.perf_counter()
            theirs = {
                s.frame: radiance for s, radiance, _ in render_on_cluster(cluster.scheduler_address, device, shots)
            }
            many = time.perf_counter() - started
            differ = sum(int((ours[k] != theirs[k]).any(axis=2).sum()) for k in range(frames))
            size = (display.panel.width_px, display.panel.height_px)
            rows.append(Row(name, frames, *size, one, WORKERS, many, differ))
    return rows


def alone(mi: Any, shots: Sequence[Shot]) -> list[Image]:
    """Return the radiance of shots, one after the other, as `lippmann animate` renders them."""
    return [render_shot(mi, shot)[0] for shot in shots]


def _warm(device: str, shot: Shot) -> None:
    """Render a shot for nothing; runs on a worker."""
    from lippmann.render.variant import start_mitsuba

    render_shot(start_mitsuba(device), shot)

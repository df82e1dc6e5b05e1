"""`lippmann bench`: measured speed, beside the error."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import click

from lippmann.cli.common import device_option, emit, json_option, log
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.machine import provenance
from lippmann.render.variant import start_mitsuba

WHAT = ("trace", "render", "observe")


@click.command("bench")
@click.argument("what", type=click.Choice(WHAT))
@click.option("--scenes", default="scenes", show_default=True, help="The project's folder of scenes.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    type=click.IntRange(0, 2**32 - 1),
    help="Seed of the rays that `trace` compares.",
)
@device_option
@json_option
def command(what: str, scenes: str, seed: int, device: str, as_json: bool) -> None:
    """Measure tracing, rendering or the observer's views; the report names machine and date.

    Example: lippmann bench trace
    """
    folder = Path(scenes)
    if not (folder / "displays/paper-square.toml").is_file():
        raise InputError(f"{folder}: the project's scenes are not there; run in the project's top folder")
    mi = start_mitsuba(device)
    origin = provenance(f"lippmann bench {what} --scenes {scenes} --seed {seed} --device {device}")
    if not as_json:
        for key, value in origin.items():
            click.echo(f"{key}: {value}")
    measured = {"trace": _trace, "render": _render, "observe": _observe}[what]
    rows = measured(mi, folder, seed, as_json)
    emit({**origin, "rows": rows}, as_json, lambda: None)


def _trace(mi: Any, folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.bench.trace import bench_trace

    names = ("paper-square", "paper-hex", "uhd-8k")
    rows = bench_trace(mi, [load_display(folder / f"displays/{name}.toml") for name in names], seed)
    if not as_json:
        click.echo(
            f"{'display':<14}{'model':<10}{'rays':<7}{'golden':>9}{'fast':>9}  M rays/s   fast against golden: max "
            "urad, rms urad, max nm, status differs"
        )
        for row in rows:
            click.echo(
                f"{row.display:<14}{row.model:<10}{row.aperture:<7}{row.golden_rays_per_second / 1e6:>9.2f}"
                f"{row.fast_rays_per_second / 1e6:>9.0f}{'':<33}{row.max_direction_urad:>6.2f}"
                f"{row.rms_direction_urad:>10.3f}{row.max_origin_nm:>8.2f}{row.status_differs:>8} of {row.compared}"
            )
    return [dataclasses.asdict(row) for row in rows]


def _render(mi: Any, folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.bench.render import bench_render

    rows: list[dict[str, Any]] = []

    def report(name: str, figures: dict[str, Any]) -> None:
        rows.append({"what": name, **figures})
        text = ", ".join(f"{key} {value:.4g}" for key, value in figures.items())
        (log if as_json else click.echo)(f"{name}: {text}")

    bench_render(mi, folder, report)
    return rows


def _observe(mi: Any, folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.bench.observe import bench_observe
    from lippmann.render.scene import load_scene

    rows = []
    for name in ("chart", "fish"):
        scene = load_scene(mi, folder / f"{name}/{name}.xml")
        for display in ("paper-square", "paper-hex"):
            for row in bench_observe(mi, scene, load_display(folder / f"displays/{display}.toml")):
                rows.append(dataclasses.asdict(row))
                if not as_json:
                    smooth = "" if row.smooth_db is None else f", smooth part {row.smooth_db:.1f} dB"
                    click.echo(f"{name} on {display}, eye {row.eye_mm}: {row.whole_db:.1f} dB{smooth}")
    return rows

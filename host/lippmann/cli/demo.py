"""`lippmann demo`: the main job in one go, from the fish to what eyes see of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from lippmann.cli.common import device_option, emit, json_option, progress_bar
from lippmann.cli.render import image_metadata
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.images import write_picture
from lippmann.observe import Eye, observe, whole_window
from lippmann.render.renderer import Settings, render_integral
from lippmann.render.scene import load_scene
from lippmann.render.variant import start_mitsuba
from lippmann.sheet import write_animation, write_contact_sheet

SCENE = "fish/fish.xml"
#: Display and how far the eye goes to each side before it leaves the viewing zone of the display's edges, mm.
DISPLAYS = (("displays/paper-square.toml", 30.0), ("displays/paper-hex.toml", 100.0))
EYE_DISTANCE_MM = 600.0
FRAMES = 15
VIEW_WIDTH_PX = 500


@click.command("demo")
@click.option("--scenes", default="scenes", show_default=True, help="The project's folder of scenes.")
@click.option("-o", "output", default="out/demo", show_default=True, help="Folder for the results.")
@device_option
@json_option
def command(scenes: str, output: str, device: str, as_json: bool) -> None:
    """Render the fish for a square and a hexagonal display and look at it from several places.

    Example: lippmann demo
    """
    folder, out = Path(scenes), Path(output)
    if not (folder / SCENE).is_file():
        raise InputError(f"{folder / SCENE}: no such scene; run in the project's top folder, or give --scenes")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be made ({error.strerror}); choose another folder with -o") from None
    mi = start_mitsuba(device)
    scene = load_scene(mi, folder / SCENE)
    results: list[dict[str, Any]] = []
    for path, reach in DISPLAYS:
        display = load_display(folder / path)
        settings = Settings(samples=4)
        with progress_bar(f"render {display.name}", quiet=as_json) as progress:
            rendered = render_integral(mi, scene, display, "exact", settings, progress)
        metadata = image_metadata(display, "exact", settings, SCENE)
        stem = out / f"fish-{display.name}"
        panel_image = stem.with_suffix(".png")
        write_picture(stem.with_suffix(".exr"), rendered.radiance, metadata)
        write_picture(panel_image, rendered.radiance, metadata, display.panel.transfer, display.panel.bits)
        window = whole_window(display, VIEW_WIDTH_PX)
        xs = np.linspace(-reach, reach, FRAMES)
        views = []
        with progress_bar(f"observe {display.name}", quiet=as_json) as progress:
            for k, x in enumerate(xs):
                eye = Eye((float(x), 0.0, EYE_DISTANCE_MM))
                views.append(observe(mi, rendered.radiance, display, eye, window).radiance)
                if progress is not None:
                    progress(k + 1, FRAMES)
        animation = out / f"views-{display.name}.gif"
        sheet = out / f"views-{display.name}.png"
        write_animation(animation, views)
        shown = range(0, FRAMES, (FRAMES - 1) // 2)
        write_contact_sheet(
            sheet, [views[k] for k in shown], [f"{display.name}, eye at x = {xs[k]:+.0f} mm" for k in shown]
        )
        results.append(
            {
                "display": display.name,
                "integral_image": str(panel_image),
                "views": str(sheet),
                "animation": str(animation),
                "render_seconds": rendered.seconds,
                "samples_per_second": rendered.samples_per_second,
            }
        )

    def text() -> None:
        for result in results:
            click.echo(f"{result['display']}: rendered in {result['render_seconds']:.1f} s")
            click.echo(f"  the integral image that the panel shows   {result['integral_image']}")
            click.echo(f"  what eyes see through the lenslets        {result['views']}")
            click.echo(f"  the same, the eye moving                  {result['animation']}")

    emit({"results": results}, as_json, text)

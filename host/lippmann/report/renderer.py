"""The renderer: time against noise and against PSNR, by integrator and samples a pixel."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lippmann.display import load_display
from lippmann.images import encode, psnr_db
from lippmann.rendering.renderer import Settings, render_integral
from lippmann.rendering.scene import load_scene
from lippmann.report.figures import Figures, Measured, in_turn
from lippmann.report.plan import Plan
from lippmann.report.plots import COLOURS, MARKS, drawn, finish
from lippmann.report.section import Plot, Section, Shown, column
from lippmann.report.views import Image, middle

INTEGRATORS = ("lights", "direct", "path")
#: What pictures are held to.
REFERENCE = "path"


def noise_levels(one: Image, other: Image) -> float:
    """Return the standard deviation of a value's noise from two pictures of other seeds, in levels of 8-bit sRGB.

    The difference of two values that are noisy alike and independently has twice their variance.
    """
    apart = 255.0 * (encode(one, "srgb").astype(np.float64) - encode(other, "srgb"))
    return float(np.sqrt((apart**2).mean() / 2.0))


def measure(scenes: Path, plan: Plan, seed: int, log: Callable[[str], None]) -> Figures:
    """Render the fish with each integrator and number of samples, another seed in each round."""
    log("renderer: noise ...")
    scene = load_scene(scenes / "fish/fish.xml")
    display = middle(load_display(scenes / "displays/paper-square.toml"), plan.noise_px)
    pictures: dict[tuple[str, int], list[Image]] = defaultdict(list)

    def rendered(integrator: str, samples: int, seed: int) -> tuple[Image, float]:
        settings = Settings(samples=samples, integrator=integrator, seed=seed)
        done = render_integral(scene, display, "exact", settings)
        return done.radiance, done.seconds

    def work(integrator: str, samples: int) -> Callable[[], float]:
        def render() -> float:
            found = pictures[integrator, samples]
            picture, seconds = rendered(integrator, samples, seed + 1 + len(found))
            found.append(picture)
            return seconds

        return render

    works = {(name, samples): work(name, samples) for name in INTEGRATORS for samples in plan.noise_samples}
    times = in_turn(works, plan.rounds)
    reference, _ = rendered(REFERENCE, plan.reference_samples, seed)
    return Figures(
        "report-renderer",
        ("integrator", "samples"),
        [
            {
                "integrator": name,
                "samples": samples,
                "seconds": Measured.of(times[name, samples]),
                "noise": Measured.of(noise_levels(a, b) for a, b in itertools.pairwise(pictures[name, samples])),
                "psnr_db": Measured.of(psnr_db(picture, reference) for picture in pictures[name, samples]),
            }
            for name, samples in works
        ],
    )


def section(data: Figures, plan: Plan) -> Section:
    """Return the section."""
    rows = data.rows
    table = Shown(
        "Time, noise and PSNR of the renderer",
        {
            "integrator": column(rows, "integrator"),
            "samples a pixel": column(rows, "samples"),
            "seconds": column(rows, "seconds"),
            "noise, levels of 255": column(rows, "noise"),
            f"PSNR against {REFERENCE}, dB": column(rows, "psnr_db"),
        },
    )
    return Section(
        "Renderer",
        (
            f"The fish on the middle of paper-square, {plan.noise_px} x {plan.noise_px} px, exact model. Noise is the "
            "standard deviation of a value, in sRGB of 8 bits, from pairs of pictures with other seeds; the PSNR is "
            f"against {plan.reference_samples} samples a pixel of `{REFERENCE}`. `lights` and `direct` leave out the "
            "light that surfaces throw on each other, `direct` mirrors and glass too: their PSNR stops rising where "
            "that is what is left. `lights` with one sample, through the pixel's centre, draws nothing at random: it "
            "has no noise but the most aliasing. Seconds are those of the render itself, without compilation.",
        ),
        (table,),
        (_plot(data),),
        (data,),
    )


def _plot(data: Figures) -> Plot:
    picture, axes = drawn(1, 2)
    for number, name in enumerate(INTEGRATORS):
        rows = [row for row in data.rows if row["integrator"] == name]
        for axis, key in zip(axes[0], ("noise", "psnr_db"), strict=True):
            # What draws nothing at random has no noise, and no place on the logarithmic axis.
            points = [(row["seconds"].median, row[key].median) for row in rows if row[key].median > 0.0]
            if points:
                axis.plot(*zip(*points, strict=True), f"{MARKS[number]}-", color=COLOURS[number], label=name)
    axes[0][0].set(xscale="log", yscale="log", xlabel="seconds", ylabel="noise, levels of 255")
    axes[0][1].set(xscale="log", xlabel="seconds", ylabel=f"PSNR against {REFERENCE}, dB")
    axes[0][1].legend()
    return Plot(
        "report-renderer",
        finish(picture),
        "Time against noise, and against PSNR; each mark doubles the samples a pixel, or more.",
        "Two line plots over the time of a render, a line for each of the integrators lights, direct and path: noise, "
        "and PSNR. The table below has the values.",
    )

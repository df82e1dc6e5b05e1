"""Draw most pictures of the documentation, and write the table in docs/models.md.

This script takes a minute or two on two cores. With `--table` it writes only the table, in a few seconds.
"""

import sys
from pathlib import Path

import lippmann as lp
import numpy as np
from lippmann import load_display, parse_display, trace
from lippmann.base.tones import encoded_values
from lippmann.base.variant import own_variant
from lippmann.display.description import Display
from lippmann.eye.observer import whole_window
from lippmann.optics.model_choice import TOLERANCE, choose_model, model_error_px, probe
from lippmann.optics.rays import MODELS
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_view
from PIL import Image, ImageDraw, ImageFont

HERE = Path(__file__).resolve().parent
TOP = HERE.parents[1]
SCENES = TOP / "scenes"
MODELS_PAGE = TOP / "docs/models.md"
TABLE_MARKS = ("<!-- table: made by docs/pictures/make_pictures.py -->\n", "<!-- end of table -->\n")

EYE_MM = 600.0
BACKGROUND, INK, MARK = (255, 255, 255), (40, 40, 40), (255, 255, 0)
FONT = ImageFont.load_default(13)

#: (name, description, TOML) of further displays in the table and the plot of lens models, after the shipped displays.
PANEL = "[panel]\nwidth_px = 2400\nheight_px = 2400\ndpi = 600\n"
VARIATIONS = (
    (
        "slow lenslets",
        "square 1 mm, f/8",
        'gap_mm = 8\n{panel}[array]\ngrid = "square"\npitch_mm = 1\nfocal_length_mm = 8\nindex = 1.5\n',
    ),
    (
        "slow, thick, turned round",
        "square 1 mm, f/12, 6 mm thick, plano side to the viewer",
        'gap_mm = 12\n{panel}[array]\ngrid = "square"\npitch_mm = 1\nfocal_length_mm = 12\nindex = 1.5\n'
        'thickness_mm = 6\nplano_side = "viewer"\n',
    ),
    (
        "fast, thick, turned round",
        "hex 2.3 mm, f/1.4, 3 mm thick, plano side to the viewer",
        'gap_mm = 3.3\n{panel}[array]\ngrid = "hex"\npitch_mm = 2.3\nfocal_length_mm = 3.3\nindex = 1.5\n'
        'thickness_mm = 3\nplano_side = "viewer"\n',
    ),
)
SHIPPED = (
    ("paper-square", "square 1 mm, f/3.3"),
    ("paper-hex", "hex 2.3 mm, f/1.4"),
    ("uhd-4k", "hex 1.25 mm, f/2.4, in contact"),
    ("uhd-8k", "square 1 mm, f/3"),
)
TABLE_DEPTH_MM = 50.0


# ---- pictures ------------------------------------------------------------------------------------------------------


def picture(linear, width_px):
    """Convert linear radiance into an 8-bit sRGB picture of a given width, averaging radiance, not sRGB values."""
    height, width = linear.shape[:2]
    height_px = round(width_px * height / width)
    planes = [Image.fromarray(np.ascontiguousarray(linear[:, :, k])) for k in range(3)]
    small = [np.asarray(p.resize((width_px, height_px), Image.Resampling.BOX)) for p in planes]
    return srgb(np.stack(small, axis=2))


def crop(linear, centre, side, width_px):
    """Cut a square out of the panel's image, and enlarge its pixels without smoothing."""
    x, y = centre[0] - side // 2, centre[1] - side // 2
    return srgb(linear[y : y + side, x : x + side]).resize((width_px, width_px), Image.Resampling.NEAREST)


def row(pictures, captions, name):
    """Save pictures side by side, with a caption below each, as a PNG with a palette of 256 colours."""
    margin, line = 6, 20
    height = max(p.height for p in pictures)
    sheet = Image.new("RGB", (sum(p.width + margin for p in pictures) + margin, height + line + 2 * margin), BACKGROUND)
    draw, x = ImageDraw.Draw(sheet), margin
    for one, caption in zip(pictures, captions, strict=True):
        sheet.paste(one, (x, margin))
        draw.text((x, margin + height + 3), caption, fill=INK, font=FONT)
        x += one.width + margin
    save(sheet.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=4, dither=Image.Dither.FLOYDSTEINBERG), name)


def save(image, name, **options):
    path = HERE / name
    image.save(path, optimize=True, **options)
    print(f"{path.relative_to(TOP)}  {path.stat().st_size // 1000} kB")


def srgb(radiance):
    """Convert linear radiance into an 8-bit sRGB picture."""
    return Image.fromarray(encoded_values(radiance, "srgb", 8))


def look(image, x_mm, width_px=300, **options):
    """Return a picture of what an eye at the height y = 0 sees."""
    return srgb(lp.observe(image, (x_mm, 0.0, EYE_MM), width_px=width_px, **options).radiance)


def make_pictures():
    square, hexagonal = (load_display(SCENES / f"displays/paper-{name}.toml") for name in ("square", "hex"))
    fish, chart = (lp.load_scene(SCENES / f"{name}/{name}.xml") for name in ("fish", "chart"))
    on_square, on_hex = (lp.render(fish, display, model="exact") for display in (square, hexagonal))

    # integral.png: the whole integral image and an enlarged part.
    centre, side, width_px = (1000, 1080), 144, 288
    whole = picture(on_square.radiance, width_px)
    scale = width_px / square.panel.width_px
    ImageDraw.Draw(whole).rectangle(
        [(c + s * side / 2) * scale for s in (-1, 1) for c in centre], outline=MARK, width=2
    )
    row(
        [whole, *(crop(image.radiance, centre, side, width_px) for image in (on_square, on_hex))],
        ["the whole panel", "the marked part, 1 mm square lenslets", "the same part, 2.3 mm hexagonal lenslets"],
        "integral.png",
    )

    # views-*.png: views of several eyes.
    for name, image, reach in (("square", on_square, 30), ("hex", on_hex, 100)):
        xs = (-reach, 0, reach)
        captions = [f"eye at x = {x:+d} mm" if x else "eye on the axis" for x in xs]
        row([look(image, x) for x in xs], captions, f"views-{name}.png")

    # sweep.gif: views of a moving eye.
    reach, frames = 30.0, 13
    stills = [look(on_square, x, 240) for x in np.linspace(-reach, reach, frames).tolist()]
    palette = stills[frames // 2].quantize(112, Image.Quantize.MAXCOVERAGE, kmeans=4)
    stills = [s.quantize(palette=palette, dither=Image.Dither.NONE) for s in stills]
    stills += stills[-2:0:-1]
    save(stills[0], "sweep.gif", save_all=True, append_images=stills[1:], duration=90, loop=0)

    # faults.png: views through misaligned arrays, and of an eye outside the viewing zone.
    wrong = (
        ("as designed", square, 0.0),
        ("array turned by 1 degree", square.misaligned(rotation_deg=1.0), 0.0),
        ("array 1 % too coarse", square.misaligned(pitch_scale=1.01), 0.0),
        ("eye at x = 80 mm: the flip", square, 80.0),
    )
    views = [look(on_square, x, 220, display=built) for _, built, x in wrong]
    row(views, [name for name, _, _ in wrong], "faults.png")

    # chart.png: the test chart, seen directly and through the arrays.
    with own_variant():
        direct = render_view(chart, (20.0, 0.0, EYE_MM), whole_window(square, 300), Settings(samples=16)).radiance
    charts = [lp.render(chart, display, model="exact") for display in (square, hexagonal)]
    row(
        [srgb(direct), *(look(image, 20.0) for image in charts)],
        ["the scene itself, eye at x = 20 mm", "through 1 mm square lenslets", "through 2.3 mm hexagonal lenslets"],
        "chart.png",
    )

    # focus.png: views of an eye with a pupil, focused on several depths.
    row(
        [look(charts[0], 0.0, pupil_mm=20.0, focus_z_mm=z) for z in (0.0, 60.0, -60.0)],
        ["pupil 20 mm, focus on the display", "focus at z = +60 mm", "focus at z = -60 mm"],
        "focus.png",
    )


# ---- models --------------------------------------------------------------------------------------------------------


def table_displays():
    """Return (name, description, display) for each display in the table of lens models."""
    shipped = [(name, what, load_display(SCENES / f"displays/{name}.toml")) for name, what in SHIPPED]
    return shipped + [(name, what, parse_display(text.format(panel=PANEL), name)) for name, what, text in VARIATIONS]


def errors_px(display: Display, aperture: str, depths_mm: tuple[float, float]) -> list[float]:
    """Return the largest error of each lens model except `exact`, over the test rays, in pixels of the view."""
    pixels, points = probe(display, aperture)
    truth = trace(display, pixels, points, "exact")
    return [model_error_px(display, truth, trace(display, pixels, points, m), depths_mm) for m in MODELS[:-1]]


def models_table() -> str:
    """Return the table of docs/models.md: errors in pixels of the reconstructed view, and the model of `auto`."""
    lines = [
        "| display | rays | pinhole | thin | paraxial | `auto` takes |",
        "|---|---|---|---|---|---|",
    ]
    depths = (-TABLE_DEPTH_MM, TABLE_DEPTH_MM)
    for name, what, display in table_displays():
        for aperture in ("chief", "full"):
            cells = [f"{e:.2g}" if np.isfinite(e) else "differs" for e in errors_px(display, aperture, depths)]
            chosen = choose_model(display, depths, aperture).model
            lines.append(f"| {name}: {what} | {aperture} | {' | '.join(cells)} | `{chosen}` |")
    return "\n".join(lines) + "\n"


def write_table():
    text = MODELS_PAGE.read_text()
    before, rest = text.split(TABLE_MARKS[0])
    _, after = rest.split(TABLE_MARKS[1])
    MODELS_PAGE.write_text(before + TABLE_MARKS[0] + models_table() + TABLE_MARKS[1] + after)
    print(MODELS_PAGE.relative_to(TOP))


def make_plot():
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    depths = np.linspace(-200.0, 200.0, 81)
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.2), sharey=True, layout="constrained")
    shown = {name: display for name, _, display in table_displays()}
    curves = (
        (axes[0], "chief", (("paper-square", "pinhole"), ("paper-hex", "pinhole"), ("uhd-4k", "pinhole"))),
        (axes[1], "full", (("paper-square", "pinhole"), ("paper-square", "thin"), ("slow lenslets", "thin"))),
    )
    for ax, aperture, lines in curves:
        for name, model in lines:
            k = MODELS.index(model)
            errors = [errors_px(shown[name], aperture, (float(z), float(z)))[k] for z in depths]
            ax.semilogy(depths, errors, label=f"{model}, {name}")
        ax.axhline(TOLERANCE, color="0.3", linestyle="--", linewidth=1)
        ax.text(depths[0], TOLERANCE * 1.1, "auto's tolerance", color="0.3", fontsize=8)
        ax.set_title("chief rays" if aperture == "chief" else "rays over the full aperture", fontsize=10)
        ax.set_xlabel("depth z, mm (in front of the display: +)")
        ax.legend(fontsize=8, loc="upper right")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("largest error,\npixels of the reconstructed view")
    axes[0].set_ylim(3e-4, 60.0)
    path = HERE / "model-error.png"
    figure.savefig(path, dpi=96)
    plt.close(figure)
    image = Image.open(path).convert("RGB").quantize(32)
    save(image, path.name)


def main():
    write_table()
    if "--table" not in sys.argv[1:]:
        make_plot()
        make_pictures()


if __name__ == "__main__":
    main()

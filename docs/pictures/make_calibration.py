"""Draw docs/pictures/calibration.png: a photograph of a pattern, and an eye's view before and after calibration."""

import tempfile
from pathlib import Path

import numpy as np
from lippmann.calibration.check import pictures
from lippmann.calibration.photographs import read_photograph
from lippmann.cli import run
from lippmann.display.description import display_text, load_display
from lippmann.eye.observer import Eye, observe, whole_window
from make_pictures import SCENES, picture, row

#: Errors of the display as built, and positions of the camera in mm, both as in docs/how-to/calibrate.md.
BUILT = {"rotation_deg": 0.3, "pitch_scale": 1.002, "gap_mm": 0.2}
PLACES = "0,0,80", "35,12,90", "-30,-10,115"
#: Glob pattern of the photograph in the picture, and the eye whose views are drawn.
SHOWN, EYE = "position-1/*-phase-x-0.png", Eye((0.0, 0.0, 600.0))
WIDTH_PX = 320


def main():
    nominal = load_display(SCENES / "displays/vga-square.toml")
    built = nominal.misaligned(**BUILT)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        files = {name: str(place / f"{name}.toml") for name in ("nominal", "built", "calibrated")}
        Path(files["nominal"]).write_text(display_text(nominal))
        Path(files["built"]).write_text(display_text(built))
        for number, where in enumerate(PLACES, 1):
            photographs = str(place / f"photos/position-{number}")
            shoot = ["calibrate", "shoot", files["nominal"], "--simulated", files["built"], "--from", where]
            assert run([*shoot, "-o", photographs]) == 0
        solve = ["calibrate", "solve", str(place / "photos"), "--display", files["nominal"], "-o", files["calibrated"]]
        assert run(solve) == 0
        found = load_display(files["calibrated"])
        (shown,) = (place / "photos").glob(SHOWN)
        photograph = np.repeat(read_photograph(shown).light[..., None], 3, axis=2)
    window = whole_window(nominal, WIDTH_PX)
    white = [pictures(made, EYE.position_mm)["1-white"].radiance for made in (nominal, found)]
    views = [observe(one, built, EYE, window, 64).radiance for one in white]
    names = ["a photograph of stripes", "white for this eye, by mine.toml", "white for this eye, by calibrated.toml"]
    row([picture(one, WIDTH_PX) for one in (photograph, *views)], names, "calibration.png")


if __name__ == "__main__":
    main()

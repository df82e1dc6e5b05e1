"""Draw docs/pictures/film.png: an eye's view of four frames of a shipped film."""

import lippmann as lp
from lippmann.motion.film import load_film
from lippmann.motion.film_frames import plan_film, render_frame
from lippmann.rendering.options import RenderOptions
from make_pictures import SCENES, look, row

FRAMES = (0, 8, 16, 23)
WIDTH_PX = 220


def main():
    film, display = load_film(SCENES / "films/swim.toml"), lp.load_display(SCENES / "displays/paper-square.toml")
    plans = plan_film(film, display, RenderOptions("exact"))
    views = [look(render_frame(plans[frame]), 0.0, WIDTH_PX) for frame in FRAMES]
    row(views, [f"frame {frame}" for frame in FRAMES], "film.png")


if __name__ == "__main__":
    main()

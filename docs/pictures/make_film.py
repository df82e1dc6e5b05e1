"""Draw the picture of the shipped film: an eye's view of four frames. `make pictures` runs it."""

from lippmann import load_display
from lippmann.animation import to_srgb8
from lippmann.film.film import load_film
from lippmann.film.shot import Options, render_shot, shots_of
from lippmann.observer import Eye, observe, whole_window
from lippmann.variant import start_mitsuba
from make_pictures import EYE_MM, SCENES, row
from PIL import Image

FRAMES = (0, 8, 16, 23)
WIDTH_PX = 220


def main():
    start_mitsuba()
    film, display = load_film(SCENES / "films/swim.toml"), load_display(SCENES / "displays/paper-square.toml")
    shots = shots_of(film, display, Options("exact"))
    views = []
    for frame in FRAMES:
        radiance, _ = render_shot(shots[frame])
        view = observe(radiance, display, Eye((0.0, 0.0, EYE_MM)), whole_window(display, WIDTH_PX))
        views.append(Image.fromarray(to_srgb8(view.radiance)))
    row(views, [f"frame {frame}" for frame in FRAMES], "film.png")


if __name__ == "__main__":
    main()

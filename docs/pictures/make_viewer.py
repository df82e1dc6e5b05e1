"""Draw docs/pictures/viewer.png: the viewer page of the fish, as headless Chromium shows it."""

import io
import tempfile
from pathlib import Path

import lippmann as lp
from lippmann.base.variant import own_variant
from lippmann.eye.observer import whole_window
from lippmann.eye.viewer_page import Direct, page_html
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_view
from PIL import Image
from tools.browser import browser_page

HERE = Path(__file__).resolve().parent
TOP = HERE.parents[1]
SIZE_PX = (1240, 900)
#: Position of the eye, for the view on the page and for the direct view beside it.
EYE_MM = (-15.0, 5.0, 600.0)

#: JavaScript that waits until the page has traced all rays, moves the eye to the position of the direct view, shows
#: three lenslets of the panel, and waits again.
READY = """
lippmann.eye.then(async () => {
  const later = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
  const rest = async () => {
    do await later(500); while (document.getElementById("rate").value !== "at rest");
  };
  await rest();
  for (const id of ["direct-go", "zoom-lenslets"]) document.getElementById(id).click();
  await rest();
  return true;
})
"""


def main():
    display = lp.load_display(TOP / "scenes/displays/paper-square.toml")
    scene = lp.load_scene(TOP / "scenes/fish/fish.xml")
    integral = lp.render(scene, display, model="exact").radiance
    with own_variant():
        direct = render_view(scene, EYE_MM, whole_window(display, 500), Settings(samples=4)).radiance
    with tempfile.TemporaryDirectory() as folder, browser_page(*SIZE_PX) as shown:
        page = Path(folder) / "page.html"
        page.write_text(page_html(display, integral, "The fish", [Direct(EYE_MM, direct)]), encoding="utf-8")
        shown.goto(page.as_uri())
        shown.evaluate(READY)
        shot = shown.screenshot()
    image = Image.open(io.BytesIO(shot)).convert("RGB")
    path = HERE / "viewer.png"
    image.quantize(200, Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path.relative_to(TOP)}  {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()

"""Draw the pictures of docs/how-it-works.md as SVG that follows the light or dark theme of the page."""

import re
from html import escape
from pathlib import Path

from lippmann import parse_display, trace

WIDTH, LINE = 790, 19
STYLE = """<style>text{font:15px sans-serif}.bold{font-weight:bold}.code{font:14px monospace}.dash{stroke-dasharray:5 4}
.wire{stroke-width:1.6}.ray{stroke-width:2.4}.end,.both{marker-end:url(#head)}.both{marker-start:url(#head)}
.page{fill:#fff}.part{fill:#eef3fa;stroke:#54749c}.file{fill:#fdf4dc;stroke:#a07a1c}.glass{fill:#d7ecf5;stroke:#3a7f9c}
.wire{fill:none;stroke:#4b545e}.ray{fill:none;stroke:#c2261d}.dot{fill:#c2261d}.word{fill:#1d2329}
@media(prefers-color-scheme:dark){.page{fill:#14181d}.part{fill:#22303f;stroke:#8fb3dc}.file{fill:#3a3218;stroke:#d8b45a}
.glass{fill:#1d3d4a;stroke:#7cc4e0}.wire{stroke:#aab4be}.ray{stroke:#ff7b6b}.dot{fill:#ff7b6b}.word{fill:#e8ecf0}}</style>
<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8"
markerUnits="userSpaceOnUse" orient="auto-start-reverse"><path class="wire" d="M1,1 7,4 1,7"/></marker></defs>"""
#: The display in how-ray.svg: three lenslets with six pixels behind each, focused on the pixels.
DISPLAY = """gap_mm = 10.667\n[panel]\nwidth_px = 18\nheight_px = 18\npixel_pitch_mm = 1.66667
[array]\ngrid = "square"\npitch_mm = 10\nradius_mm = 9\nindex = 1.5\nthickness_mm = 11"""
FILES = """*written by*; *file*; *read by, among others*
you, `capture`,|`calibrate solve`; *display file*|`display.toml`; nearly all: `render`,|`observe`, `board start`
you, a 3D program; *scene*|`scene.xml`; `render`, `animate`, `live`,|`capture`, `layers`, `export`
you; *placement*|`scene.toml`; the same, with `scene.xml`
you; *set-up*|`setup.toml`; `capture`, `export povray`
you; *film*|`film.toml`; `animate`, `live`
`render`; *bands*|`picture.exr.bands`; `render`, after an interruption
`render`, `animate`,|`capture`, `pattern`; *picture*|`.exr` or `.png`; `observe`, `view`, `stream`,|`display`, `export`
`calibrate solve`; *calibration*|`.toml` and `.npz`; `.toml`: as a display file|`.npz`: `calibrate report`"""


class Drawing:
    """Collects the SVG elements of one picture. A path is a string of points "x,y x,y" in pixels, with y downwards."""

    def __init__(self, name, height, title):
        self.path, size = Path(__file__).with_name(f"how-{name}.svg"), f'width="{WIDTH}" height="{height}"'
        self.parts = [f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {WIDTH} {height}" role="img">']
        self.parts += [f"<title>{title}</title>", STYLE, f'<rect class="page" {size} rx="8"/>']

    def words(self, x, y, text, anchor="middle"):
        """Write lines of text, separated by |, centred at the height y; `...` is set as code, *...* as bold."""
        lines = re.sub("`(.*?)`", r'<tspan class="code">\1</tspan>', escape(text))
        lines = re.sub(r"\*(.*?)\*", r'<tspan class="bold">\1</tspan>', lines).split("|")
        for k, line in enumerate(lines):
            base = y + 5 + (k - (len(lines) - 1) / 2) * LINE
            self.parts.append(f'<text class="word" text-anchor="{anchor}" x="{x}" y="{base:.1f}">{line}</text>')

    def labels(self, text):
        """Write one-line labels, each preceded by its position."""
        for x, y, label in re.findall(r"(\d+),(\d+) ([^;\n]+)", text):
            self.words(x, int(y) - 5, label)

    def box(self, x, y, width, height, text="", kind="part", corner=6):
        size = f'x="{x:.1f}" y="{y:.1f}" width="{width}" height="{height}" rx="{corner}"'
        self.parts.append(f'<rect class="{kind}" {size}/>')
        if text:
            self.words(x + width / 2, y + height / 2, text)

    def lines(self, *paths, kind="wire end"):
        """Draw a line along each path, with an arrowhead at its end, at both ends, or none."""
        self.parts += [f'<polyline class="{kind}" points="{path}"/>' for path in paths]


def draw_loop():
    d = Drawing("loop", 412, "From the scene to the eye, and the four engines")
    above = "*scene*|`scene.xml`; *render*|`lippmann render`; *integral image*|`.exr` or `.png`; *link*|serial line"
    below = "*eye*|`lippmann observe`; *lenslets*|refract the rays; *panel*|shows the frame; *board*|real or virtual"
    for k, (upper, lower) in enumerate(zip(above.split("; "), below.split("; "), strict=True)):
        d.box(15 + 200 * k, 15, 160, 62, upper, "part" if k % 2 else "file")
        d.box(15 + 200 * k, 335, 160, 62, lower)
    d.lines("175,46 215,46", "375,46 415,46", "575,46 615,46", "755,77 755,335", "240,150 240,77", "665,212 665,335")
    d.lines("215,366 175,366", "415,366 375,366", "615,366 575,366")
    d.lines("50,335 50,77", kind="wire both dash")
    d.words(60, 206, "compare|with the|direct view", "start")
    d.lines("165,112 735,112 735,302 165,302 165,112", kind="wire dash")
    d.labels(
        "450,134 four engines trace the rays of one display file; 420,286 golden: checked against 50-digit arithmetic"
    )
    for k, engine in enumerate(("*fast*|float32", "*golden*|float64", "*twin*|integers", "*rtl*|fixed point")):
        d.box(185 + 142 * k, 150, 109, 62, engine)
    d.lines("295,181 326,181", "437,181 468,181", "579,181 610,181", kind="wire both")
    for x, bound in ((311, "within a|stated error"), (453, "within a|stated error"), (595, "equal,|every bit")):
        d.words(x, 242, bound)
    return d


def draw_ray():
    d = Drawing("ray", 432, "A ray from a pixel through its lenslet to the scene")
    display = parse_display(DISPLAY, "how-ray.svg")
    array, gap, pixel = display.array, display.gap_mm, display.panel.pixel_pitch_mm
    # 1 mm is 10 pixels of the picture. The plane of the vertices is at x = 340, the axis at y = 225.
    domes = "".join(f"A90,90 0 0 0 324.8,{y}" for y in (275, 175, 75))
    d.parts.append(f'<path class="glass" d="M230,375H324.8{domes}H230Z"/>')
    for k in range(18):
        d.box(110, 75 + 10 * pixel * k, 13, 16.7, kind="file" if 6 <= k < 12 else "part", corner=0)
    # Golden traces a chief ray. In air the ray aims at the lenslet's centre in the aperture plane.
    start = -2.5 * pixel
    ray = trace(display, [[9 + start / pixel, 9]])
    (x, _, z), (dx, _, dz) = ray.origin_mm[0], ray.direction[0]
    entry = start - start * gap / (gap + array.thickness_mm / array.index)
    point, eye = ((to, x + (to - z) * dx / dz) for to in (19, 38))
    points = (-array.thickness_mm - gap, start), (-array.thickness_mm, entry), (z, x), eye
    d.lines(" ".join(f"{340 + 10 * z:.1f},{225 - 10 * x:.1f}" for z, x in points), kind="ray")
    d.box(524, 219 - 10 * point[1], 12, 12, kind="dot")
    d.box(720, 214 - 10 * eye[1], 11, 22, corner=5)
    d.lines("123,397 230,397", "230,397 340,397", "356,175 356,75", "97,75 97,92", "250,325 335,355", kind="wire both")
    d.lines("103,175 97,175 97,275 103,275", "610,75 610,375", kind="wire")
    d.lines("380,397 510,397")
    d.labels("""177,417 `gap_mm`; 288,417 `thickness_mm`; 444,417 z, to the viewer; 408,130 `pitch_mm`; 64,241 image
        74,62 `pixel_pitch_mm`; 296,318 `radius_mm`; 278,120 `index`; 278,140 or `glass`; 52,222 elemental
        95,393 *panel*; 230,66 *flat face*; 332,66 *dome*; 394,243 *lenslet*; 148,290 *pixel*; 420,178 exit ray
        610,66 `near_mm`; 524,165 *scene point*; 724,107 *eye*""")
    return d


def draw_board():
    d = Drawing("board", 440, "The board: from the serial line to the panel")
    d.box(15, 20, 145, 104, "*serial line*|`uart_rx`|`uart_tx`")
    d.box(15, 165, 145, 104, "*packets*|`cobs_decoder`|`packet_fifo`|`packet_out`")
    d.box(15, 315, 145, 104, "*requests*|`dispatcher`|one at a time,|one reply each")
    d.box(255, 20, 145, 104, "*frames*|`tile_writer`|`frame_check`|`presenter`")
    d.box(255, 165, 145, 104, "*registers*|`register_bus`|board, optics,|scene")
    d.box(255, 315, 145, 104, "*ray pipeline*|`optics_block`|`ray_pipeline`|a ray each clock")
    d.box(440, 20, 145, 104, "*frame memory*|`block_store` or|`sdram_store`|two buffers", "file")
    d.box(440, 315, 145, 104, "*drawing*|`draw_frame`|`scene`|some boards", "part dash")
    d.box(630, 20, 145, 249, "*scan-out*|`show_frame`|`test_pattern`|`scan_out`|video")
    d.box(630, 335, 145, 64, "*panel*", "file")
    d.lines("90,124 90,165", "90,269 90,315", "400,72 440,72", "160,385 255,385", kind="wire both")
    d.lines("160,345 175,345 175,72 255,72", "175,217 255,217", "585,72 630,72", "400,205 630,205")
    d.lines("328,269 328,315", "702,269 702,335")
    d.lines("400,367 440,367", kind="wire both dash")
    d.lines("512,315 512,240 630,240", kind="wire end dash")
    d.labels("217,77 tile|present; 217,222 read|write; 217,390 trace|sign; 512,195 pattern, brightness; 356,297 optics")
    return d


def draw_files():
    d = Drawing("files", 500, "The files, who writes and who reads them")
    for y, row in zip(range(20, 500, 56), FILES.split("\n"), strict=True):
        writer, file, reader = row.split("; ")
        d.words(205, y, writer, "end")
        d.words(500, y, reader, "start")
        d.box(250, y - 22, 200, 44, file, "file" if y > 20 else "page")
        d.lines(*([f"212,{y} 250,{y}", f"450,{y} 492,{y}"] if y > 20 else []))
    return d


if __name__ == "__main__":
    for drawing in (draw_loop(), draw_ray(), draw_board(), draw_files()):
        drawing.path.write_text("\n".join([*drawing.parts, "</svg>\n"]))

"""Converts shipped scenes to other tools' formats, and renders them on a display (`tools.bench content`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.files import scratch_folder
from lippmann.base.images import Radiance, read_picture, write_picture
from lippmann.base.tones import psnr_db
from lippmann.base.variant import mitsuba
from lippmann.conformance.figures import Rows
from lippmann.conformance.pages import Page
from lippmann.display.description import Display, load_display
from lippmann.eye.many_views import eyes_of, scene_viewer
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.crosstalk_and_viewing_zone import viewing_distance
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.plan import Job
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window, first_depths
from lippmann.rendering.sinks import render_picture
from lippmann.scenes.placement import Placement, arranged
from lippmann.scenes.quilts_and_views import EYES, eyes_note, eyes_text, quilt_path, tiled
from lippmann.scenes.scene import Scene, load_scene
from lippmann.scenes.splats import write_table

from tools.bench import MeasurementRun, measurement
from tools.report_plots import contact_sheet, make_page

Y00 = 0.5 / np.sqrt(np.pi)
#: Splats of the knot: number, two radii and thickness in mm, logit of the opacity.
SPLATS, SPLAT_MM, LOGIT = 12_000, (0.7, 0.7, 0.15), 4.0
#: Display of the measurement, display of the gallery, and number of columns of the gallery's quilt.
DISPLAY, GALLERY, COLUMNS = "vga-square", "paper-square", 8
#: Numbers of views, across and upwards, in each folder of views.
VIEWS = ((4, 1), (8, 1), (16, 1), (32, 1), (64, 1), (8, 5), (16, 9))
#: Position (x, y) of each eye, mm; the eyes' distance, mm; rays per pixel of a view; samples per pixel of a picture.
EYES_MM = {"middle": (0.0, 0.0), "beside": (22.0, 0.0), "above": (0.0, 22.0), "corner": (22.0, 22.0)}
EYE_MM, EYE_SAMPLES, SAMPLES = 600.0, 64, 16
#: Scale of the fish on the measurement's small display, mm per unit.
SCALE = 0.25


@dataclass(frozen=True)
class Surface:
    """A mesh: points (N, 3), normals (N, 3), texture coordinates (N, 2), faces (M, 3), and the texture's file."""

    points: Any
    normals: Any
    uv: Any
    faces: Any
    texture: Path

    @classmethod
    def read(cls, mesh: Path, texture: Path) -> Surface:
        """Read a PLY file with Mitsuba; the v axis of the texture coordinates points down."""
        parameters = mitsuba().traverse(mitsuba().load_dict({"type": "ply", "filename": str(mesh)}))
        points, normals, uv = (
            np.array(parameters[f"vertex_{name}"], np.float64).reshape(-1, size)
            for name, size in (("positions", 3), ("normals", 3), ("texcoords", 2))
        )
        return cls(points, normals, uv, np.array(parameters["faces"]).reshape(-1, 3), texture)

    def colours(self) -> Any:
        """Return the texture's sRGB colours at the points, (N, 3), 0 to 255."""
        from PIL import Image

        with Image.open(self.texture) as image:
            pixels = np.asarray(image.convert("RGB"))
        height, width, _ = pixels.shape
        column, row = (np.floor(np.mod(self.uv, 1.0) * (width, height)).astype(int)).T
        return pixels[row, column]


def write_meshes(surface: Surface, folder: Path) -> list[Path]:
    """Write a surface with trimesh as GLB, OBJ, PLY (with vertex colours) and STL; return the paths."""
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

    def mesh(**colours: Any) -> Any:
        return trimesh.Trimesh(surface.points, surface.faces, vertex_normals=surface.normals, process=False, **colours)

    with Image.open(surface.texture) as opened:
        image = opened.convert("RGB")
    glossy = PBRMaterial(baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.4)
    for material, suffix in ((glossy, "glb"), (SimpleMaterial(image=image), "obj")):
        visual = TextureVisuals(uv=surface.uv * (1.0, -1.0) + (0.0, 1.0), material=material)
        trimesh.Scene(mesh(visual=visual)).export(folder / f"knot.{suffix}")
    painted = mesh(vertex_colors=surface.colours())
    painted.export(folder / "knot.ply", vertex_normal=True)
    # STL has z up, as in CAD.
    painted.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    painted.export(folder / "knot.stl")
    return [folder / f"knot.{suffix}" for suffix in ("glb", "obj", "ply", "stl")]


def write_splats(surface: Surface, path: Path, seed: int) -> Path:
    """Write flat splats on a surface, with y downwards as in files of splat trainers; return the path."""
    random = np.random.default_rng(seed)
    points = random.choice(len(surface.points), min(SPLATS, len(surface.points)), replace=False)
    # Compute the shortest rotation from the z axis to the normal, as a quaternion.
    x, y, z = surface.normals[points].T
    turn = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    turn[z < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    # Rotate by 180 degrees about x.
    down = np.array([1.0, -1.0, -1.0])
    turn = np.stack([-turn[:, 1], turn[:, 0], -turn[:, 3], turn[:, 2]], axis=1)
    columns = {
        **dict(zip("xyz", (surface.points[points] * down).T, strict=True)),
        **dict.fromkeys(("nx", "ny", "nz"), np.zeros(len(points))),
        **{f"f_dc_{k}": (surface.colours()[points, k] / 255.0 - 0.5) / Y00 for k in range(3)},
        "opacity": np.full(len(points), LOGIT),
        **{f"scale_{k}": np.full(len(points), np.log(size)) for k, size in enumerate(SPLAT_MM)},
        **{f"rot_{k}": turn[:, k] for k in range(4)},
    }
    write_table(path, np.array(list(zip(*columns.values(), strict=True)), [(name, "<f4") for name in columns]))
    return path


def write_views(
    scene: Scene, display: Display, folder: Path, across: int, down: int = 1, width: int = 480, seed: int = 0
) -> Path:
    """Write views of a scene from eyes in the display's viewing zone, and views.json; return the folder."""
    window = whole_window(display, width)
    view = scene_viewer(scene, window, Settings(samples=16, seed=seed))
    folder.mkdir()
    eyes = eyes_of(display, across, down)
    names = [f"{number}.exr" for number in range(len(eyes))]
    for name, eye in zip(names, eyes, strict=True):
        write_picture(folder / name, view(Eye(eye)), {})
    (folder / EYES).write_text(eyes_text((window.width_mm, window.height_mm), names, eyes))
    return folder


def write_depth_picture(scene: Scene, display: Display, folder: Path, width: int = 960, seed: int = 0) -> Path:
    """Write an on-axis eye's view of a scene, and the view's depths; return picture.toml, which names both."""
    from PIL import Image

    eye = (0.0, 0.0, viewing_distance(display))
    panel = display.panel
    window = Window(panel.width_mm, panel.height_mm, width, round(width * panel.height_mm / panel.width_mm))
    view = render_view(scene, eye, window, Settings(samples=16, seed=seed)).radiance
    write_picture(folder / "colour.png", view, {})
    steps = np.round(10.0 * (eye[2] - first_depths(scene, eye, window)))
    there = np.isfinite(steps) & (steps > 0.0) & (steps < 65536.0)
    Image.fromarray(np.where(there, steps, 0.0).astype(np.uint16)).save(folder / "depth.png")
    fov = float(2.0 * np.degrees(np.arctan(0.5 * panel.width_mm / eye[2])))
    files = 'colour = "colour.png"\ndepth = "depth.png"\n'
    path = folder / "picture.toml"
    path.write_text(f"[depth_picture]\n{files}unit_mm = 0.1\nfov_deg = {fov!r}\n")
    return path


def measure(folder: Path, scratch: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield each eye's PSNR (dB) against the fish scene, for folders of views of the fish and for its depth picture."""
    display = load_display(folder / f"displays/{DISPLAY}.toml")
    scene = load_scene(folder / "fish/fish.xml", Placement(SCALE))
    truth = _views(scene, display, seed)

    def decibels(other: Scene, seed: int) -> dict[str, float]:
        views = _views(other, display, seed)
        return {f"{name}_db": psnr_db(views[name], view) for name, view in truth.items()}

    for across, down in VIEWS:
        path = write_views(scene, display, scratch / f"views-{across}x{down}", across, down, seed=seed)
        yield {"source": "views", "across": across, "down": down, **decibels(_placed(path, display), seed)}
    path = write_depth_picture(scene, display, scratch, seed=seed)
    yield {"source": "depth picture", "across": 1, "down": 1, **decibels(_placed(path, display), seed)}
    yield {"source": "the scene, another seed", "across": None, "down": None, **decibels(scene, seed + 1)}


def _views(scene: Scene, display: Display, seed: int) -> dict[str, Radiance]:
    options = RenderOptions(model="exact", settings=Settings(SAMPLES, seed=seed))
    image = render_picture(Job(scene, display, options).plan())
    window = whole_window(display)
    return {
        name: observe(image.radiance, display, Eye((*place, EYE_MM)), window, EYE_SAMPLES).radiance
        for name, place in EYES_MM.items()
    }


def _placed(path: Path, display: Display) -> Scene:
    scene = load_scene(path)
    return scene if scene.usual is None else arranged(scene, display, scene.usual)


def gallery(folder: Path, scratch: Path, seed: int) -> tuple[list[Radiance], list[str]]:
    """Return an eye's view of a display with each kind of content, and the captions."""
    display = load_display(folder / f"displays/{GALLERY}.toml")
    knot = Surface.read(folder / "knot/knot.ply", folder / "knot/skin.png")
    fish = load_scene(folder / "fish/fish.xml")
    paths = [*write_meshes(knot, scratch), write_splats(knot, scratch / "splats.ply", seed)]
    views = write_views(fish, display, scratch / "views", 2 * COLUMNS, seed=seed)
    eyes, window = eyes_of(display, 2 * COLUMNS), whole_window(display)
    pictures = [read_picture(views / f"{number}.exr").radiance for number in range(len(eyes))]
    quilt = quilt_path(scratch / "quilt.png", COLUMNS, 2, pictures[0].shape[1] / pictures[0].shape[0])
    write_picture(quilt, tiled(pictures, COLUMNS, 2), eyes_note((window.width_mm, window.height_mm), eyes))
    paths += [views, quilt, write_depth_picture(fish, display, scratch, seed=seed)]
    options = RenderOptions(model="pinhole", settings=Settings(4, seed=seed))
    images = (render_picture(Job(_placed(path, display), display, options).plan()) for path in paths)
    eye = Eye((10.0, 5.0, EYE_MM))
    gallery_views = [observe(image.radiance, display, eye, window, 16).radiance for image in images]
    return gallery_views, [path.name + "/" * path.is_dir() for path in paths]


@measurement(page="content")
def content(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare what eyes see of view folders, depth pictures and the scene itself; show all kinds of content.

    Example: python -m tools.bench content
    """
    with scratch_folder() as folder:
        rows = bench.collect(measure(bench.scenes, folder, bench.seed))
    with scratch_folder() as folder:
        views = None if bench.report is None else gallery(bench.scenes, folder, bench.seed)
    return {"rows": rows}, content_page(bench.origin, rows, views)


def content_page(origin: Mapping[str, str], rows: Rows, views: tuple[list[Radiance], list[str]] | None = None) -> Page:
    """Return the page of `tools.bench content`; `views` has the pictures of the contact sheet, and their captions."""
    context = {"rows": rows, "display": DISPLAY, "gallery": GALLERY, "samples": SAMPLES, "eye_mm": round(EYE_MM)}
    return make_page("content", origin, contact_sheet("content", views, 4, 2), {"content": rows}, context)

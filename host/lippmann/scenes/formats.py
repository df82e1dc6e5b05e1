"""Recognizes the formats of scenes, and converts scenes to Mitsuba's format."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from lippmann.base.files import scratch_folder
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.scenes import depth_picture, meshes, quilts_and_views, splats

Kind = Literal["mitsuba", "mesh", "splats", "quilt", "views", "depth picture"]
PLY_HEAD = 1 << 16
FORMATS = (
    f"give a Mitsuba scene (.xml), a mesh or splats ({', '.join(meshes.SUFFIXES)}), a quilt (NAME_qs8x6a0.75.png), "
    f"a folder with {quilts_and_views.EYES}, or a .toml with [depth_picture]"
)
#: Suffixes of files that an error suggests for a misspelt name.
SUFFIXES = (".xml", *meshes.SUFFIXES)


def kind_of(path: Path) -> Kind | None:
    """Return the kind of a scene's file or folder, or None for an unknown format."""
    suffix = path.suffix.lower()
    if path.is_dir():
        return "views" if (path / quilts_and_views.EYES).is_file() else None
    if suffix == ".xml":
        return "mitsuba"
    if suffix == ".ply" and _has_splats(path):
        return "splats"
    if suffix in meshes.SUFFIXES:
        return "mesh"
    if suffix in quilts_and_views.PICTURES and quilts_and_views.TILING.search(path.stem):
        return "quilt"
    return "depth picture" if depth_picture.is_depth_picture(path) else None


def usual_rotation(path: Path) -> tuple[float, float, float]:
    """Return a file's default rotation about x, y, z, degrees: z is up in STL, y down in splats."""
    if kind_of(path) == "splats":
        return (180.0, 0.0, 0.0)
    return (-90.0, 0.0, 0.0) if path.suffix.lower() == ".stl" else (0.0, 0.0, 0.0)


@contextmanager
def as_mitsuba(path: Path, scene_from_display: Floats, notes: list[str]) -> Iterator[Path]:
    """Yield the path of a scene, converted to Mitsuba, or raise InputError."""
    # `scene_from_display` (3, 3) rotates added lights; `notes` gets lines for the user.
    kind = kind_of(path)
    if kind == "mitsuba":
        yield path
        return
    with scratch_folder() as folder:
        try:
            if kind == "mesh":
                scene_file = meshes.write_scene(path, folder, scene_from_display, notes)
            elif kind == "splats":
                scene_file = splats.write_scene(path, folder)
            elif kind == "depth picture":
                scene_file = depth_picture.write_scene(path, folder, notes)
            else:
                read_views = quilts_and_views.read_quilt if kind == "quilt" else quilts_and_views.read_folder
                scene_file = read_views(path).write_scene(folder)
        except OSError as error:
            raise input_error(path, f"cannot be read ({error.strerror or error})", "check the file") from None
        yield scene_file


def _has_splats(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        head = stream.read(PLY_HEAD).partition(b"end_header")[0]
    return b"element face" not in head and any(word in head for word in (b" scale_0", b" f_dc_0"))

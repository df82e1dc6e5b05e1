"""Runs POV-Ray on the files that `lippmann export povray` writes, and measures POV-Ray's time."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import resource
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from lippmann.base.files import replacing
from lippmann.base.images import read_picture
from lippmann.base.programs import run_program
from lippmann.capturing.povray_export import POVRAY, Exported, View, write_folder
from lippmann.capturing.povray_text import pinhole
from lippmann.errors import input_error
from lippmann.rendering.sampling import Window
from lippmann.scenes.placement import Triple
from lippmann.scenes.scene import Scene


@dataclass(frozen=True)
class Run:
    """The cost of a POV-Ray run including parsing: wall-clock seconds, and CPU seconds of all threads."""

    command: str
    seconds: float
    cpu_seconds: float


def run_povray(ini: Path, *options: str) -> Run:
    """Render an .ini file with additional options; raise InputError with POV-Ray's first error if it fails."""
    command = [str(POVRAY.path()), ini.name, *options]
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    result = run_program(command, folder=ini.parent)
    seconds = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if result.returncode != 0:
        errors = [line.strip() for line in result.stderr.splitlines() if "error" in line.lower()]
        first = errors[0] if errors else "it printed no error"
        raise input_error(str(ini), f"POV-Ray refuses the file ({first})", "export it again")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(" ".join(["povray", ini.name, *options]), seconds, cpu)


def render_folder(exported: Exported, *options: str) -> tuple[npt.NDArray[np.float32], Run]:
    """Render an exported folder; return linear radiance (height, width, 3) and the run's cost."""
    run = run_povray(exported.ini, *options)
    return read_picture(exported.ini.with_suffix(".exr")).radiance[exported.spare_rows :], run


def render_folder_once(exported: Exported, *options: str) -> tuple[npt.NDArray[np.float32], Run]:
    """Return the result of `render_folder`, from the cache if files and options are the same."""
    content = hashlib.sha256(" ".join(options).encode())
    for name in exported.files:
        content.update((exported.ini.parent / name).read_bytes())
    cached = exported.ini.parent / f"kept-{content.hexdigest()[:16]}"
    if not cached.with_suffix(".json").is_file():
        run = run_povray(exported.ini, *options)
        os.replace(exported.ini.with_suffix(".exr"), cached.with_suffix(".exr"))
        with replacing(cached.with_suffix(".json")) as partial:
            partial.write_text(json.dumps(dataclasses.asdict(run)))
    run = Run(**json.loads(cached.with_suffix(".json").read_text()))
    return read_picture(cached.with_suffix(".exr")).radiance[exported.spare_rows :], run


def export_view(scene: Scene, eye_mm: Triple, window: Window, folder: Path) -> Exported:
    """Write a scene for POV-Ray as an eye sees it through a window in z = 0, without a display."""
    x, y, z = eye_mm
    camera = pinhole(eye_mm, (-x, -y, -z), window.width_mm, window.height_mm)
    return write_folder(scene, View(camera, window.width_px, window.height_px), folder)

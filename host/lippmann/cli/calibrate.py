"""`lippmann calibrate`: photographs of the mounted array become a display file."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from lippmann.base.files import make_folder
from lippmann.base.fullscreen import full_screen
from lippmann.base.images import check_output
from lippmann.base.variant import own_variant
from lippmann.board.streaming import send_frame
from lippmann.calibration.coded_patterns import FILE, PatternSet, Pixels, write_patterns
from lippmann.cli.frame import Folder, argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY_PATH, Point, finite
from lippmann.cli.options_port import BAUD, opened_board
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar, with_progress
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, input_error
from lippmann.optics.zones import status_share

#: Exit code when photographs were judged and contradict the display file.
FOUND_WRONG = 4
PANEL_PORT = option("A board that drives the panel: the patterns are streamed to it.", None, metavar="URL")


@click.group("calibrate")
def command() -> None:
    """Calibrate a display from photographs of its mounted array.

    Draw patterns, photograph them from three places, solve, and check the result by eye.

    Example: lippmann calibrate patterns scenes/displays/vga-square.toml -o out/patterns
    """


@contextmanager
def _panel(display: Display, port: str | None, baud: int | None, monitor: int) -> Iterator[Callable[[Pixels], object]]:
    """Give a function that shows pixels on the panel: that of a board, or a monitor."""
    if port is None:
        with full_screen((display.panel.width_px, display.panel.height_px), monitor) as show:
            yield show
        return
    with opened_board(port, baud, display, frames=True) as board:
        yield lambda pixels: send_frame(board, pixels)


@make_command("patterns", command)
def patterns_command(
    display: Display = argument("DISPLAY.toml"),
    output: Folder = option("Folder for the pictures and patterns.toml."),
    port: str | None = PANEL_PORT,
    baud: int | None = BAUD,
    wait_s: float = option("Time that the board shows each pattern.", 2.0, finite(0.0)),
) -> None:
    """Draw the patterns that a camera photographs on the panel.

    Gray code and phase shift in both directions, white, black, and marks that show where the panel is. Show them
    full-screen and unscaled, one after the other, or let a board show them with --port.

    Example: lippmann calibrate patterns scenes/displays/vga-square.toml -o out/patterns
    """
    patterns = PatternSet.of(display)
    files = write_patterns(patterns, display, output)
    if port is not None:
        import time

        with _panel(display, port, baud, 0) as show:
            for pattern in with_progress("patterns", patterns.patterns):
                show(patterns.panel_values(pattern, display))
                log(f"shown: {pattern.stem}")
                time.sleep(wait_s)
    names = [one.name for one in files]
    result = {"folder": output, "patterns": names, "period_px": patterns.period_px, "streamed": port is not None}
    text = f"{output}: {len(files)} patterns and {FILE}; photograph each from 3 places into position-1, -2, -3"
    emit(result, text, display)


@dataclasses.dataclass(frozen=True)
class _Simulation:
    """A display as built, and the camera that is simulated in front of it."""

    built: Display | None = option("Photograph this display as built by simulation.", None, flag="--simulated")
    place: Point | None = option("Place of the simulated camera, mm.", None, flag="--from")
    width_px: int = option("Width of simulated photographs.", 1280, click.IntRange(64, 16384), flag="--width")
    focal: float = option("Focal length of the simulated lens, in widths of the photograph.", 2.5, finite(0.1))
    seed: int = option("Seed of a simulated camera's rays and noise.", 0, click.IntRange(0))

    def photograph(self, patterns: PatternSet, display: Display, folder: Path) -> list[Path]:
        """Photograph the patterns of the nominal display through the optics of the one as built."""
        from lippmann.calibration.simulated_camera import Camera
        from lippmann.calibration.simulated_photographs import photograph_folder

        if self.built is None or self.place is None:
            raise InputError("a simulated camera needs both --simulated BUILT.toml and --from X,Y,Z")
        panel, own = self.built.panel, display.panel
        if (panel.width_px, panel.height_px) != (own.width_px, own.height_px):
            size = f"the panel has {panel.width_px} x {panel.height_px} pixels"
            what = f"{size}, '{display.name}' has {own.width_px} x {own.height_px}"
            raise input_error(f"display '{self.built.name}'", what, "give the same panel with its array as mounted")
        height_px = round(self.width_px * 0.75)
        # One lens for all places: a zoom between them would tell the solver another distance.
        focal_px = self.focal * self.width_px
        camera = Camera(self.place, (0.0, 0.0, 0.0), 0.0, self.width_px, height_px, focal_px, pupil_mm=1.0, blur_px=0.5)
        with tempfile.TemporaryDirectory() as drawn:
            write_patterns(patterns, display, Path(drawn))
            return photograph_folder(self.built, camera, drawn, folder, self.seed)


@make_command("shoot", command)
def shoot_command(
    display: Display = argument("DISPLAY.toml"),
    output: Folder = option("Folder for this position's photographs, such as photos/position-1."),
    camera: int = option("Number of the webcam.", 0, click.IntRange(0)),
    monitor: int = option("Number of the monitor that is the panel.", 0, click.IntRange(0)),
    port: str | None = PANEL_PORT,
    baud: int | None = BAUD,
    settle_s: float = option("Wait between a pattern and its photograph.", 0.4, finite(0.0)),
    average: int = option("Frames of the camera that make one photograph.", 4, click.IntRange(1, 64)),
    simulated: Any = _Simulation,
    device: str = DEVICE,
) -> None:
    """Show each pattern and photograph it with a webcam, or by simulation.

    Run it once for each place of the camera. The camera must stand still meanwhile.

    Example: lippmann calibrate shoot mine.toml -o photos/position-1 --camera 0 --monitor 1
    """
    patterns = PatternSet.of(display)
    if simulated.built is not None or simulated.place is not None:
        with own_variant(device):
            files = simulated.photograph(patterns, display, output)
        built = simulated.built.name
        result = {"folder": output, "photographs": len(files), "simulated": built}
        emit(result, f"{output}: {len(files)} photographs of {built}, simulated", display)
        return
    from lippmann.calibration.shooting import open_webcam, shoot

    with (
        open_webcam(camera) as webcam,
        _panel(display, port, baud, monitor) as show,
        progress_bar("shoot") as progress,
    ):
        files = shoot(patterns, display, show, webcam, output, settle_s, average, progress)
    result = {"folder": output, "photographs": len(files), "camera": camera}
    emit(result, f"{output}: {len(files)} photographs", display)


@make_command("solve", command)
def solve_command(
    photos: Path = argument("PHOTOS"),
    display_path: Path = DISPLAY_PATH,
    output: Path = option("The calibrated display file, .toml; a .npz for `report` beside it."),
    bow: bool = option("Fit tilts and curvatures of the array over the panel, too.", False),
    radius: bool = option("Find the lenslets' radius, too.", False),
) -> None:
    """Solve photographs for the array: rotation, pitches, shear, offset and gap, with their uncertainties.

    PHOTOS holds a folder for each place of the camera: position-1, position-2 and so on. In each, the photographs have
    the names of the patterns.

    Example: lippmann calibrate solve photos --display mine.toml -o calibrated.toml
    """
    from lippmann.calibration.solve import calibrate

    nominal, path = load_display(display_path), check_output(output, (".toml",))
    if path.exists() and path.samefile(display_path):
        raise input_error(str(output), "is the nominal display file", "give the calibrated one another name")
    with progress_bar("photographs") as progress:
        calibration = calibrate(photos, nominal, bow, radius, progress)
    sidecar_path = calibration.save(path)
    lines = [
        f"{one.name:<10}{one.value:+12.6f} +- {one.uncertainty:.6f} {one.unit}"
        + ("" if one.determined else "   (not determined)")
        for one in calibration.parameters
    ]
    lines += [
        f"panel points within {calibration.rms_panel_px:.3f} px rms, {100.0 * calibration.outliers:.1f} % outliers, "
        f"{len(calibration.cameras)} positions, {len(calibration.field)} lenslets",
        *(f"note: {one}" for one in calibration.remarks),
        f"{output}: {calibration.display.name}, identity {calibration.display.identity}",
    ]
    emit({**calibration.summary(), "output": output, "kept": sidecar_path}, lines)


#: Least share of the panel that an eye sees through the lenslets in front, for a picture that proves something.
LEAST_OWN = 0.5
#: Share from which on the rest is not worth a word: corners of cells.
WHOLE = 0.95


@make_command("check", command)
def check_command(
    display: Display = argument("CALIBRATED.toml"),
    output: Folder | None = option("Folder for the pictures.", None),
    eye: Point | None = option("The eye that sees white, mm.", None),
    photos: Folder | None = option("Folder with photographs of 1-white and 2-dark, to be judged.", None),
    device: str = DEVICE,
) -> int:
    """Draw pictures that prove a calibration, or judge photographs of them.

    1-white is white for the eye, and black elsewhere; 2-dark is its opposite; 3-rings shows rings to every eye. With
    --photos, photographs of the first two from the eye's place are judged.

    Exit code 0: right; 4: a part of the panel is wrong.

    Example: lippmann calibrate check calibrated.toml --eye 0,0,600 -o out/check
    """
    from lippmann.calibration.check import judge_folder, pictures

    if photos is not None:
        verdict = judge_folder(photos)
        emit(
            dataclasses.asdict(verdict),
            f"{photos}: {100.0 * verdict.right_share:.1f} % of the panel is right; dark has "
            f"{100.0 * verdict.dark_share:.1f} % of the light ({100.0 * verdict.worst_dark_share:.1f} % at its worst)",
            display,
        )
        return 0 if verdict.right else FOUND_WRONG
    if output is None or eye is None:
        raise InputError(
            "give the eye's place and a folder, --eye X,Y,Z -o FOLDER, or photographs with --photos FOLDER"
        )
    own = status_share(display, eye)["ok"]
    if own < LEAST_OWN:
        what = (
            f"the eye sees {100.0 * own:.0f} % of the panel through the lenslets in front; elsewhere neighbours' pixels"
        )
        raise input_error(
            f"--eye {eye[0]:g},{eye[1]:g},{eye[2]:g}", what, "choose a place nearer to the axis, or farther away"
        )
    make_folder(output)
    with own_variant(device):
        images = pictures(display, eye)
    for name, image in images.items():
        image.save(output / f"{name}.png")
    if own < WHOLE:
        log(f"{100.0 * (1.0 - own):.0f} % of the panel stays dark in 1-white: the eye sees neighbours' pixels there")
    result = {"folder": output, "pictures": list(images), "eye_mm": eye, "own_share": own}
    emit(result, f"{output}: {', '.join(images)}; look from {eye[0]:g},{eye[1]:g},{eye[2]:g} mm", display)
    return 0


@make_command("report", command)
def report_command(
    display_path: Path = argument("CALIBRATED.toml"),
    output: Folder = option("Folder for the page."),
    eye: Point | None = option("The eye of the views before and after.  [default: the first camera]", None),
    device: str = DEVICE,
) -> None:
    """Write a page about a calibration: uncertainties, residuals, and an eye's view before and after.

    Example: lippmann calibrate report calibrated.toml -o out/calibration
    """
    from lippmann.base.provenance import provenance
    from lippmann.calibration.result import load_calibration
    from lippmann.conformance.calibration_page import calibration_page

    with own_variant(device):
        page = calibration_page(
            provenance(f"lippmann calibrate report {display_path.name}", ("numpy", "scipy", "opencv-python-headless")),
            load_calibration(display_path),
            eye,
        )
    files = page.write(output, as_html=True)
    emit({"folder": output, "files": [one.name for one in files]}, f"{output}: {', '.join(one.name for one in files)}")

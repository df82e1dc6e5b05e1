"""Commands `lippmann calibrate`."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import click

from lippmann.base.files import make_folder
from lippmann.base.fullscreen import full_screen
from lippmann.base.images import check_output
from lippmann.base.variant import own_variant
from lippmann.board.streaming import send_frame
from lippmann.calibration.coded_patterns import FILE, PatternSet, Pixels, write_patterns
from lippmann.cli.frame import Folder, argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, Point, finite
from lippmann.cli.options_port import BAUD, opened_board
from lippmann.cli.output import FOUND_WRONG, emit, log
from lippmann.cli.progress_bar import progress_bar, with_progress
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, input_error
from lippmann.optics.crosstalk_and_viewing_zone import status_share

PANEL_PORT = option("Port of the board that drives the panel and shows the patterns.", metavar="URL")


@click.group("calibrate")
def command() -> None:
    """Calibrate a display from photographs of its mounted array.

    The steps: draw patterns, photograph them from three positions, solve, check.

    Example: lippmann calibrate patterns scenes/displays/vga-square.toml -o out/patterns
    """


@contextlib.contextmanager
def _panel(display: Display, port: str | None, baud: int | None, monitor: int) -> Iterator[Callable[[Pixels], object]]:
    if port is None:
        with full_screen(display.panel.size_px, monitor) as show:
            yield show
        return
    with opened_board(port, baud, display, frames=True) as board:
        yield lambda pixels: send_frame(board, pixels)


@make_command("patterns", command)
def patterns_command(
    display: Display = argument("DISPLAY.toml"),
    output: Folder = option("Output folder for the patterns and patterns.toml."),
    port: str | None = PANEL_PORT,
    baud: int | None = BAUD,
    wait_s: float = option("Time for which a board shows each pattern, s.", 2.0, finite(0.0)),
) -> None:
    """Draw the patterns for a camera: Gray code, phase shift, white, black, marks.

    Show the patterns on the panel one after the other, full-screen and unscaled. With
    --port, a board shows the patterns.

    Example: lippmann calibrate patterns scenes/displays/vga-square.toml -o out/patterns
    """
    patterns = PatternSet.of(display)
    with contextlib.nullcontext() if port is None else _panel(display, port, baud, 0) as show:
        files = write_patterns(patterns, display, output)
        for pattern in with_progress("patterns", patterns.patterns) if show else ():
            assert show is not None
            show(patterns.panel_values(pattern, display))
            log(f"shown: {pattern.stem}")
            time.sleep(wait_s)
    names = [one.name for one in files]
    result = {"folder": output, "patterns": names, "period_px": patterns.period_px, "streamed": port is not None}
    text = f"{output}: {len(files)} patterns and {FILE}; photograph all from 3 positions into position-1, -2, -3"
    emit(result, text, display)


def _check_same_panel(built: Display, display: Display) -> None:
    panel, own = built.panel, display.panel
    if panel.size_px != own.size_px:
        size = f"the panel has {panel.width_px} x {panel.height_px} pixels"
        what = f"{size}, '{display.name}' has {own.width_px} x {own.height_px}"
        raise input_error(f"display '{built.name}'", what, "give a display file with the same panel")


@make_command("shoot", command)
def shoot_command(
    display: Display = argument("DISPLAY.toml"),
    output: Folder = option("Output folder for the photographs, such as photos/position-1."),
    camera: int = option("Number of the webcam; the first is 0.", 0, click.IntRange(0, 999)),
    monitor: int = option("Number of the monitor that is the panel.", 0, click.IntRange(0)),
    port: str | None = PANEL_PORT,
    baud: int | None = BAUD,
    settle_s: float = option("Delay between a pattern and its photograph, s.", 0.4, finite(0.0)),
    average: int = option("Number of camera frames averaged per photograph.", 4, click.IntRange(1, 64)),
    simulated: Display | None = option("Simulate photographs of the display in this file."),
    place: Point | None = option("Position of the simulated camera, mm.", flag="--from"),
    width: int = option("Width of simulated photographs, pixels.", 1280, click.IntRange(64, 16384)),
    focal: float = option("Focal length of the simulated lens, in photograph widths.", 2.5, finite(0.1)),
    seed: int = option("Random seed of simulated rays and noise.", 0, click.IntRange(0)),
    device: str = DEVICE,
) -> None:
    """Show each pattern and photograph it with a webcam or a simulated camera.

    Run the command once per camera position. The camera must not move during a run.

    Example: lippmann calibrate shoot mine.toml -o photos/position-1 --camera 0
    --monitor 1
    """
    patterns = PatternSet.of(display)
    if simulated is not None or place is not None:
        from lippmann.calibration.simulated_camera import Camera
        from lippmann.calibration.simulated_photographs import photograph_folder

        if simulated is None or place is None:
            raise InputError("a simulated camera needs both --simulated BUILT.toml and --from X,Y,Z")
        _check_same_panel(simulated, display)
        # Positions share a focal length, because `solve` cannot tell zoom from distance.
        focal_px, height = focal * width, round(width * 0.75)
        eye = Camera(place, (0.0, 0.0, 0.0), 0.0, width, height, focal_px, pupil_mm=1.0, blur_px=0.5)
        with own_variant(device), tempfile.TemporaryDirectory() as folder:
            write_patterns(patterns, display, Path(folder))
            files = photograph_folder(simulated, eye, folder, output, seed)
        result = {"folder": output, "photographs": len(files), "simulated": simulated.name}
        emit(result, f"{output}: {len(files)} photographs of {simulated.name}, simulated", display)
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
    display_path: Path = DISPLAY,
    output: Path = option("Calibrated display file (.toml); a .npz for `report` is written to its folder."),
    bow: bool = option("Also fit tilts and curvatures of the array."),
    radius: bool = option("Also fit the lenslets' radius."),
) -> None:
    """Compute the array's rotation, pitches, shear, offset and gap from photographs.

    PHOTOS contains a folder per camera position: position-1 and so on. Each photograph
    has the file name of its pattern.

    Example: lippmann calibrate solve photos --display mine.toml -o calibrated.toml
    """
    from lippmann.calibration.solve import calibrate

    nominal, path = load_display(display_path), check_output(output, (".toml",))
    if path.exists() and path.samefile(display_path):
        raise input_error(output, "is the nominal display file", "give the output another name")
    with progress_bar("photographs") as progress:
        solution = calibrate(photos, nominal, bow, radius, progress)
    sidecar_path = solution.save(path)
    lines = [
        f"{one.name:<10}{one.value:+12.6f} +- {one.uncertainty:.6f} {one.unit}"
        + ("" if one.determined else "   (not determined)")
        for one in solution.parameters
    ]
    lines += [
        f"panel points within {solution.rms_panel_px:.3f} px rms, {100.0 * solution.outliers:.1f} % outliers, "
        f"{len(solution.cameras)} positions, {len(solution.field)} lenslets",
        *(f"note: {one}" for one in solution.remarks),
        f"{output}: {solution.display.name}, identity {solution.display.identity}",
    ]
    emit({**solution.summary(), "output": output, "kept": sidecar_path}, lines)


#: Minimum fraction of the panel that the eye of `check` must see without crosstalk.
MIN_OWN_SHARE = 0.5
#: Fraction of the panel without crosstalk below which `check` logs a note. Above it,
#: only the corners of lenslet cells have crosstalk.
LOGGED_SHARE = 0.95


@make_command("check", command)
def check_command(
    display: Display = argument("CALIBRATED.toml"),
    output: Folder | None = option("Output folder for the test pictures."),
    eye: Point | None = option("Position of the eye that sees 1-white as white, mm."),
    photos: Folder | None = option("Check photographs of 1-white and 2-dark in this folder."),
    device: str = DEVICE,
) -> int:
    """Draw pictures that test a calibration, or check photographs of these pictures.

    1-white is white from the eye's position, and black from other positions. 2-dark is
    the inverse of 1-white. 3-rings shows rings to every eye. Photograph the pictures
    from the eye's position.

    Exit code 0: the calibration is correct; 4: it is wrong on over 5 % of the panel.

    Example: lippmann calibrate check calibrated.toml --eye 0,0,600 -o out/check
    """
    from lippmann.calibration.check import judge_folder, pictures

    if photos is not None:
        verdict = judge_folder(photos)
        right, dark, high = (100.0 * x for x in (verdict.right_share, verdict.dark_share, verdict.worst_dark_share))
        text = f"{right:.1f} % of the panel is correct; 2-dark has {dark:.1f} % of the light (95 % quantile {high:.1f})"
        emit(asdict(verdict), f"{photos}: {text}", display)
        return 0 if verdict.right else FOUND_WRONG
    if output is None or eye is None:
        raise InputError("give --eye X,Y,Z and -o FOLDER to draw, or --photos FOLDER to check")
    own, place = status_share(display, eye)["ok"], ",".join(f"{x:g}" for x in eye)
    if own < MIN_OWN_SHARE:
        what = f"the eye sees only {100.0 * own:.0f} % of the panel without crosstalk"
        raise input_error(f"--eye {place}", what, "move the eye nearer to the axis, or away from the panel")
    make_folder(output)
    with own_variant(device):
        images = pictures(display, eye)
    for name, image in images.items():
        image.save(output / f"{name}.png")
    if own < LOGGED_SHARE:
        log(f"{100.0 * (1.0 - own):.0f} % of the panel is dark in 1-white: the eye sees crosstalk there")
    result = {"folder": output, "pictures": list(images), "eye_mm": eye, "own_share": own}
    emit(result, f"{output}: {', '.join(images)}; look from {place} mm", display)
    return 0


@make_command("report", command)
def report_command(
    display_path: Path = argument("CALIBRATED.toml"),
    output: Folder = option("Output folder for the page."),
    eye: Point | None = option("Position of the eye for both views, mm.  [default: the first camera]"),
    device: str = DEVICE,
) -> None:
    """Write a page about a calibration: uncertainties, residuals, and views before and after it.

    Example: lippmann calibrate report calibrated.toml -o out/calibration
    """
    from lippmann.base.report_provenance import provenance
    from lippmann.calibration.result import load_calibration
    from lippmann.conformance.calibration_page import calibration_page

    with own_variant(device):
        line = f"lippmann calibrate report {display_path.name}"
        origin = provenance(line, ("numpy", "scipy", "opencv-python-headless"))
        page = calibration_page(origin, load_calibration(display_path), eye)
    files = [file.name for file in page.write(output, as_html=True)]
    emit({"folder": output, "files": files}, f"{output}: {', '.join(files)}")

"""Command `lippmann regress`."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import click

from lippmann.base import interrupts
from lippmann.base.files import make_folder
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.cli.frame import Folder, flag_of, make_command, option
from lippmann.cli.options import FILE_BITS, LENS_MODEL, is_given
from lippmann.cli.output import FOUND_WRONG, as_json, emit, log
from lippmann.conformance.coverage_points import summary
from lippmann.conformance.error_bounds import Bounds, load_bounds
from lippmann.conformance.judge import Verdict, judge
from lippmann.conformance.ray_sets import ForeignRays
from lippmann.conformance.ray_stream import StreamReader, bounded_lines
from lippmann.conformance.vector_files import read_foreign
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error, printable
from lippmann.optics.rays import Model


@make_command("regress")
def command(
    display: Display | None = option("Display file (.toml) for --rays."),
    rays_path: Path | None = option("File of rays to check: .npz, .csv or .mem."),
    stream: bool = option("Check the answers to lippmann vectors --stream, read from stdin."),
    inputs_path: Path | None = option("Inputs of a .mem file's rays.  [default: inputs.mem in the file's folder]"),
    model: Model = LENS_MODEL,
    fraction_bits: int = FILE_BITS,
    tolerance_urad: float | None = option("Tolerance of directions, microradians.  [default: 2]"),
    tolerance_nm: float | None = option("Tolerance of points, nm.  [default: 50]"),
    bounds_path: Path | None = option("File of bounds per step and hard case (.toml), instead of tolerances."),
    junit: Path | None = option("Also write the verdicts as JUnit XML for continuous integration."),
    report: Folder | None = option("Output folder for a page with plots of the errors."),
) -> int:
    """Check the rays of another ray tracer or RTL design.

    Decimal numbers are compared with the engine golden; the tolerances include the
    rounding of the inputs to float32. Fixed-point words must equal those of the RTL's
    integer twin. The command names the first wrong step of the computation.

    Exit code 0: all rays are correct; 4: some rays are wrong.

    Example: lippmann regress --display scenes/displays/paper-square.toml --rays
    rays.npz
    """
    bounds = _read_bounds(bounds_path, tolerance_urad, tolerance_nm)
    output = _Output(junit, report)
    if stream:
        for name in ("display", "rays_path", "inputs_path", "model", "fraction_bits"):
            if is_given(name):
                flag = flag_of(name)
                raise input_error(flag, "conflicts with --stream", f"leave out {flag} or --stream")
        return _judge_stream(bounds, output)
    if rays_path is None or display is None:
        raise InputError("no rays to check; give --display and --rays, or --stream")
    return _judge_file(rays_path, read_foreign(rays_path, display, model, fraction_bits, inputs_path), bounds, output)


def _read_bounds(path: Path | None, urad: float | None, nm: float | None) -> Bounds:
    for key, value, name in (("direction_urad", urad, "--tolerance-urad"), ("point_nm", nm, "--tolerance-nm")):
        if value is not None and path:
            raise input_error(
                name, "conflicts with --bounds", f"write {key} into the bounds file instead, or leave out --bounds"
            )
        if value is not None and value <= 0.0:
            raise input_error(name, f"{value:g} is not positive", "give a positive number")
    if path:
        return load_bounds(path)
    return Bounds(direction_urad=urad or Bounds.direction_urad, point_nm=nm or Bounds.point_nm)


class _Output:
    def __init__(self, junit: Path | None, report: Path | None) -> None:
        self.junit, self.report, self.maps = junit, report, None
        if junit:
            check_output(junit, (".xml",))
        if report:
            from lippmann.conformance.regress_page import ErrorMaps  # late import of plot libraries

            make_folder(report)
            self.maps = ErrorMaps()

    def judge(self, foreign: ForeignRays, bounds: Bounds, two_faults: bool = True) -> Verdict:
        """Check a ray set; add its errors to the error maps."""
        verdict = judge(foreign, bounds, two_faults)
        if self.maps is not None:
            self.maps.add(foreign, bounds)
        return verdict

    def write(
        self, verdicts: list[tuple[str, Verdict]], words: bool, ended: str | None, about: Mapping[str, object]
    ) -> None:
        """Write the verdicts; `ended` is the error that ended a stream early."""
        texts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in about.items() if value}
        if self.junit:
            from lippmann.conformance.junit import write_junit

            write_junit(self.junit, verdicts, ended, texts)
        if self.report is not None and self.maps is not None:
            from lippmann.conformance.regress_page import errors_page

            origin = provenance("lippmann regress", ("numpy",)) | texts
            errors_page(origin, verdicts, self.maps, words, ended).write(self.report, as_html=True)


def _judge_file(path: Path, foreign: ForeignRays, bounds: Bounds, output: _Output) -> int:
    display, words = foreign.inputs.display, foreign.words is not None
    verdict = output.judge(foreign, bounds)
    if verdict.right:
        lines = [f"{verdict.rays} rays right ({verdict.on_edge} of them within a rounding of an edge)"]
    else:
        lines = verdict.headline.split("; ", 1)
    lines = [*verdict.lines, *lines, summary([verdict.covered], words)[1]]
    about = {"rays": str(path), "identity": display.identity, "bounds": asdict(bounds)}
    output.write([(path.stem, verdict)], words, None, about)
    own = {"right": verdict.right, "model": foreign.inputs.model, **about}
    emit({**asdict(verdict), **own}, lines, display)
    return 0 if verdict.right else FOUND_WRONG


def _judge_stream(bounds: Bounds, output: _Output) -> int:
    if sys.stdin is None:
        raise InputError("stdin is closed; run lippmann vectors --stream | YOUR PROGRAM | lippmann regress --stream")
    verdicts: list[tuple[str, Verdict]] = []
    ended, code, words = None, 0, False
    reader = StreamReader(bounded_lines(sys.stdin.buffer))
    try:
        for name, foreign in reader.sets():
            # A search for a pair of faults takes 10 s; repeat it only for sets larger than before.
            search = not any(one.searched and one.rays >= len(foreign.inputs.pixels) for _, one in verdicts)
            verdict = output.judge(foreign, bounds, search)
            verdicts.append((name, verdict))
            words = foreign.words is not None
            if not verdict.right and not as_json():
                click.echo(printable(f"{name}: {verdict.headline}"))
    except InputError as error:
        ended, code = str(error), error.exit_code
    except KeyboardInterrupt:
        ended, code = "interrupted", interrupts.exit_code()
    rays, wrong = (sum(getattr(verdict, name) for _, verdict in verdicts) for name in ("rays", "wrong"))
    points, line = summary((verdict.covered for _, verdict in verdicts), words)
    sets = [{"set": name, "right": verdict.right, **asdict(verdict)} for name, verdict in verdicts]
    count = f"{len(verdicts)} set{'s' * (len(verdicts) != 1)}"
    lines = [f"{rays} rays in {count}: {f'{wrong} wrong' if wrong else 'right'}", line]
    if reader.hash:
        lines.append(f"stream: {reader.hash}")
    about = {"made": reader.command, "hash": reader.hash or None, "bounds": asdict(bounds)}
    output.write(verdicts, words, ended, about)
    # Add the keys that every failed command prints.
    failure = {"error": ended, "exit_code": code} if ended is not None else {}
    total = {"right": not (wrong or ended), "rays": rays, "wrong": wrong, "ended": ended, "covered": points}
    emit({**total, **about, **failure, "sets": sets}, lines if verdicts else "no rays were checked")
    if ended is not None:
        log(f"lippmann: {ended}")
        return code
    return FOUND_WRONG if wrong else 0

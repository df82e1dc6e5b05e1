"""Command `lippmann vectors`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import click

from lippmann.base.report_provenance import provenance
from lippmann.cli.frame import Folder, make_command, option
from lippmann.cli.options import DISPLAY, FILE_BITS, LENS_MODEL, SEED
from lippmann.cli.output import as_json, emit
from lippmann.conformance.hard_cases import hard_sets
from lippmann.conformance.ray_stream import Stream
from lippmann.conformance.vector_files import write_vectors
from lippmann.display.description import load_display
from lippmann.errors import InputError, input_error
from lippmann.optics.rays import Model


@make_command("vectors")
def command(
    display_path: Path = DISPLAY,
    case: str = option("Name of a hard case, or all; an unknown name prints the names.", "all"),
    model: Model = LENS_MODEL,
    fraction_bits: int = FILE_BITS,
    count: int = option("Approximate number of rays in each set.", 24, click.IntRange(1, 10_000)),
    seed: int = SEED,
    output: Folder | None = option("New output folder."),
    stream: bool = option("Write the rays as text lines to stdout, for another program."),
    words: bool = option("With --stream: write hexadecimal words of the RTL."),
    random: int = option("With --stream: number of random rays after the hard cases.", 0, click.IntRange(0, 10**8)),
) -> None:
    """Write test vectors: rays that are hard to compute.

    Each set contains rays with 50-digit results (.npz), and the rays as words of the
    RTL (.csv, $readmemh). To use text lines instead, run lippmann vectors --stream |
    YOUR PROGRAM | lippmann regress --stream.

    Example: lippmann vectors --display scenes/displays/paper-square.toml -o vectors
    """
    display = load_display(display_path)
    line = (
        f"lippmann vectors --display {shlex.quote(str(display_path))} --case {case} --model {model} "
        f"--fraction-bits {fraction_bits} --count {count} --seed {seed}"
    )
    if stream:
        if output or as_json():
            other = "--json" if output is None else "-o"
            raise input_error(
                other, "conflicts with --stream, which writes to stdout", f"leave out {other} or --stream"
            )
        line += f" --stream{' --words' * words}{f' --random {random}' * bool(random)}"
        questions = Stream(display, case, model, seed, count, random, fraction_bits if words else None)
        sys.stdout.writelines(f"{question}\n" for question in questions.lines(line))
        sys.stdout.flush()
        return
    if words or random:
        raise input_error("--words" if words else "--random", "needs --stream", "add --stream")
    if output is None:
        raise InputError("no output; give a folder with -o, or --stream")
    sets = hard_sets(display, case, seed, count)
    about = provenance(line, ("numpy", "mpmath")) | {"model": model, "fraction_bits": fraction_bits, "seed": seed}
    entries = write_vectors(output, sets, model, fraction_bits, about)
    result = {
        "output": output,
        "sets": len(entries),
        "rays": sum(entry["rays"] for entry in entries),
        "words": sum(entry["words"] for entry in entries),
        "refused": {entry["set"]: entry["refused"] for entry in entries if entry["refused"]},
    }
    emit(result, f"{output}: {result['rays']} rays in {result['sets']} sets, {result['words']} of them in words")

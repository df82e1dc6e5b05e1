"""Speed against error of everything, into docs/reports: `python -m tools.full_report`, `make report`.

The sections of `lippmann report` on the shipped displays, and those of the RTL's builds, the renderer, and the error
budget by step.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lippmann.cli import run
from lippmann.cli.frame import make_command
from lippmann.cli.report import ReportOptions, write_report
from lippmann.conformance import display_report, engine_speeds
from lippmann.conformance.display_report import Comparison, Section, display_sections, make_report
from lippmann.conformance.figures import Figures, Stored
from lippmann.conformance.pages import Page

from tools import fixed_errors, renderer_speed, report_builds, report_plots

TEMPLATES = Path(__file__).with_name("templates")
#: The tables that are kept, in the order of the sections.
TABLES = ("report-engines", "report-rtl", "report-renderer", "report-growth", "report-budget")


@dataclass(frozen=True)
class Plan(engine_speeds.Plan):
    """Sizes of a run."""

    #: Word lengths whose exact pipelines are measured, and whether all named configurations are, or only four.
    fraction_bits: tuple[int, ...] = tuple(range(14, 24))
    named: bool = True
    #: Renders whose noise is measured: width of the picture, samples a pixel, samples of the reference.
    noise_px: int = 320
    noise_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    reference_samples: int = 1024
    #: Configurations whose error is measured step by step.
    budget: tuple[str, ...] = ("widest-square", "widest-hex", "compact-square", "compact-hex")
    #: Width of the panels over which growth is measured (except with the pixels); repeats of each peak of memory.
    growth_px: int = 800
    memory_rounds: int = 3
    #: Sizes over which growth is measured.
    pixels_across: tuple[int, ...] = (600, 1200, 2400, 4800)
    lenslets_across: tuple[int, ...] = (11, 26, 51, 102, 204)
    triangles: tuple[int, ...] = (200, 2_000, 20_000, 200_000, 2_000_000)
    lights: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32)


WHOLE = Plan()
#: For tests, and for a first look.
QUICK = Plan(
    **dataclasses.asdict(display_report.QUICK),
    fraction_bits=(16, 23),
    named=False,
    noise_px=64,
    noise_samples=(1, 4),
    reference_samples=16,
    budget=("compact-square",),
    growth_px=150,
    pixels_across=(150, 300),
    lenslets_across=(4, 8),
    triangles=(200, 2_000),
    lights=(1, 2),
    samples=(1, 2),
)


def make_sections(scenes: Path, plan: Plan, seed: int) -> list[Section]:
    """Return all sections, in the order of the page."""
    measured = (scenes, plan, seed)
    builds = (report_plots.draw_costs, report_plots.draw_word_lengths)
    return [
        *display_sections(*measured),
        Section("rtl", partial(report_builds.measure, *measured), builds),
        Section("noise", partial(renderer_speed.measure_noise, *measured), (report_plots.draw_renderer,)),
        Section("growth", partial(renderer_speed.measure_growth, *measured), (report_plots.draw_growth,)),
        Section("budget", partial(fixed_errors.measure_budget, *measured), (report_plots.draw_budget,)),
    ]


def template_names(tables: Mapping[str, Figures]) -> dict[str, Any]:
    """Return further names for the template."""
    front = report_builds.on_front(tables["rtl"])
    return {
        "powers": renderer_speed.powers_of(tables["growth"]),
        "front": [name for name, best in front.items() if best],
        "placed": report_builds.placed()[0],
    }


@make_command("full_report")
def main(options: ReportOptions = ReportOptions) -> None:  # type: ignore[assignment]
    """Measure speed and error of everything, and write a report.

    It covers engines, models, word lengths and the renderer, and lists what changed since an earlier run. The files are
    report.md, report.html, plots and CSV. Run it on a quiet machine, in the project's top folder.

    Example: python -m tools.full_report -o out/report
    """

    def measure(scenes: Path, before: Stored | None) -> tuple[Page, Comparison]:
        report_builds.placed()  # a missing file is told before anything is measured
        plan, words = QUICK if options.quick else WHOLE, f"python -m tools.full_report {options.words()}"
        sections = make_sections(scenes, plan, options.seed)
        return make_report(sections, plan, options.seed, words, before, template_names, TEMPLATES)

    write_report(options, TABLES, measure)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))

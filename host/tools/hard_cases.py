"""Every engine on the hard cases (`tools.bench hard`)."""

from __future__ import annotations

import logging
from pathlib import Path

from lippmann.conformance.engine_errors import Row, measure_fixed
from lippmann.conformance.engine_errors import measure as measure_engines
from lippmann.conformance.hard_cases import changed, hard_sets
from lippmann.conformance.ray_sets import PanelRays
from lippmann.display.description import load_display
from lippmann.fixed.words import COMPACT, WIDEST
from lippmann.simulation.harness import rtl_pipeline

logger = logging.getLogger("lippmann.report")


def measure(scenes: Path, seed: int, device: str) -> tuple[list[Row], list[Row]]:
    """Compare golden and fast with 50 digits, the twin with golden, and the RTL (F = 23) with the twin.

    The displays are the founding paper's, as they ship and with the plano side to the viewer.
    """
    shipped = [load_display(scenes / f"displays/{name}.toml") for name in ("paper-square", "paper-hex")]
    turned = [changed(one, plano_side="viewer", gap_mm=one.array.focal_length_mm) for one in shipped]
    real, fixed = [], []
    for display in (one for pair in zip(shipped, turned, strict=True) for one in pair):
        logger.info("%s, plano side to the %s ...", display.name, display.array.plano_side)
        for rays in hard_sets(display, "all", seed):
            real += measure_engines(rays, ("golden", "fast"), device)
            if isinstance(rays, PanelRays):
                fixed.append(measure_fixed(rays, COMPACT))
                fixed.append(measure_fixed(rays, WIDEST, rtl_pipeline))
    return real, fixed

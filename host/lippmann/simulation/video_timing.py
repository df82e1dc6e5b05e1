"""Lists panels' video timings: porches, sync, polarities."""

from __future__ import annotations

from lippmann.display.description import Display

#: RTL parameters of video timing: porches and sync in pixels and lines, polarities.
TIMING = ("HFront", "HSync", "HBack", "VFront", "VSync", "VBack", "HPositive", "VPositive")
#: Video timings of VESA DMT (640 x 480) and CEA-861 (1280 x 720, 1920 x 1080).
KNOWN_TIMINGS = {
    (640, 480): (16, 96, 48, 10, 2, 33, 0, 0),
    (1280, 720): (110, 40, 220, 5, 5, 20, 1, 1),
    (1920, 1080): (88, 44, 148, 4, 5, 36, 1, 1),
}
#: Video timing of other panels: VESA CVT with reduced blanking.
REDUCED = (48, 32, 80, 3, 8, 30, 1, 0)


def timing_of(display: Display) -> tuple[int, ...]:
    """Return the video timing of a display's panel, in the order of `TIMING`."""
    return KNOWN_TIMINGS.get(display.panel.size_px, REDUCED)

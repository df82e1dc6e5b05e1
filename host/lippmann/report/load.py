"""What else the machine did while something was measured."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

#: Kinds of time in /proc/stat that the processors work: all but idle (3) and waiting for a disk (4), and the times of
#: virtual machines (8, 9), which the first two hold already.
BUSY = (0, 1, 2, 5, 6, 7)


@dataclass(frozen=True)
class Load:
    """A moment: the load average, and seconds of all processors' work so far, by everybody and by us."""

    average: float
    everybody: float | None
    ours: float

    @classmethod
    def now(cls) -> Load:
        """Look at the machine; `everybody` is None where it does not tell."""
        stat = Path("/proc/stat")
        everybody = None
        if stat.exists():
            ticks = [int(word) for word in stat.read_text().splitlines()[0].split()[1:]]
            everybody = sum(ticks[kind] for kind in BUSY) / os.sysconf("SC_CLK_TCK")
        return cls(os.getloadavg()[0], everybody, sum(os.times()[:4]))


def load_since(start: Load) -> str:
    """Say how busy the machine was at a moment, and how much of the work since then was not ours."""
    end = Load.now()
    said = f"average {start.average:.1f} at the start"
    if start.everybody is None or end.everybody is None:
        return said
    ours, all_ = end.ours - start.ours, end.everybody - start.everybody
    return f"{said}; {max(0.0, all_ - ours):.0f} of {all_:.0f} s of processor time since then were other programs'"

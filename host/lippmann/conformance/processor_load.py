"""What else the machine did while something was measured."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

#: Columns of /proc/stat in which the processors work: not idle (3) or waiting for a disk (4), and not the times of
#: virtual machines (8, 9), which the first two columns contain.
BUSY = (0, 1, 2, 5, 6, 7)


@dataclass(frozen=True)
class Load:
    """A moment: the load average, and the processor time so far, seconds, of all programs and of ours."""

    average: float
    everybody: float | None
    ours: float

    @classmethod
    def now(cls) -> Load:
        """Read the machine's counters; `everybody` is None where the system has none."""
        stat = Path("/proc/stat")
        ticks = stat.read_text().splitlines()[0].split()[1:] if stat.exists() else None
        everybody = sum(int(ticks[kind]) for kind in BUSY) / os.sysconf("SC_CLK_TCK") if ticks else None
        return cls(os.getloadavg()[0], everybody, sum(os.times()[:4]))


def load_since(start: Load) -> str:
    """Return the load average at a moment, and how much of the processor time since then other programs used."""
    end = Load.now()
    average = f"average {start.average:.1f} at the start"
    if start.everybody is None or end.everybody is None:
        return average
    ours, all_ = end.ours - start.ours, end.everybody - start.everybody
    return f"{average}; {max(0.0, all_ - ours):.0f} of {all_:.0f} s of processor time since then were other programs'"

"""The memory that this process may still take: of the machine, and of the control groups that limit it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

#: Of each version of control groups: the folder below their root, if not the root itself, and its files: the limit in
#: bytes, what is used, and the entry of memory.stat for pages of files, which the kernel can drop.
VERSIONS = {
    1: ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    2: ("", "memory.max", "memory.current", "inactive_file"),
}


def free_memory_mb() -> float:
    """Return the free memory, MB, including what caches can release: of this machine or, if less, of a control group.

    Containers and batch systems limit their programs by control groups, of which /proc/meminfo knows nothing.
    """
    machine = proc_mb("meminfo", "MemAvailable") or os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6
    return min([machine, *group_memory_mb()])


def group_memory_mb(root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> Iterator[float]:
    """Yield the free memory, MB, of each control group with a limit that this process is in.

    Linux' versions 1 and 2 (cgroups(7)); `own` lists the process' groups below `root`.
    """
    for line in own.read_text().splitlines() if own.exists() else ():
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        name, limit, used, dropped = VERSIONS[1 if controllers else 2]
        top = root / name
        # In a container the path may be that outside, and its own group is the top.
        group = top / path.lstrip("/")
        for folder in [top] if ".." in group.parts else [group, *group.parents]:
            if folder.is_relative_to(top):
                most, taken = (_number(folder / file, r"^(\d+)$") for file in (limit, used))
                if most is not None and taken is not None:
                    yield max(0.0, most - taken + (_number(folder / "memory.stat", rf"^{dropped} (\d+)$") or 0)) / 1e6


def _number(file: Path, pattern: str) -> int | None:
    """Return the number in a file; None without one, as where there is no limit."""
    try:
        found = re.search(pattern, file.read_text(), re.M)
    except OSError:
        return None
    return None if found is None else int(found[1])


def proc_mb(file: str, entry: str) -> float | None:
    """Return an entry in kB of a file below /proc, in MB; None where there is none."""
    path = Path("/proc", file)
    found = re.search(rf"^{entry}:\s*(\d+) kB", path.read_text(), re.M) if path.exists() else None
    return None if found is None else int(found[1]) * 1024 / 1e6

"""The memory that this process may still take: of the machine, and of the control groups that limit it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

#: Of each version of control groups: the folders below their root where they may be, and the files of a group: its
#: limit in bytes, what is used, and how memory.stat calls pages of files, which the kernel can drop.
VERSIONS = {
    1: (("memory",), "memory.limit_in_bytes", "memory.usage_in_bytes", r"total_(?:in)?active_file"),
    2: (("", "unified"), "memory.max", "memory.current", r"(?:in)?active_file"),
}
#: Limits from here on count as none: where memory is not limited, version 1 writes a number just below 2^63.
UNLIMITED = 1 << 62


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
    for line in _text(own).splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        names, limit, used, dropped = VERSIONS[1 if controllers else 2]
        for top in (root / name for name in names):
            # In a container the path may be that outside, and its own group is the top.
            group = top / path.lstrip("/")
            for folder in [top] if ".." in group.parts else [group, *group.parents]:
                if folder.is_relative_to(top):
                    most, taken = (re.findall(r"^(\d+)$", _text(folder / file), re.M) for file in (limit, used))
                    if most and taken and int(most[0]) < UNLIMITED:
                        spare = sum(map(int, re.findall(rf"^{dropped} (\d+)$", _text(folder / "memory.stat"), re.M)))
                        yield max(0, int(most[0]) - int(taken[0]) + spare) / 1e6


def _text(file: Path) -> str:
    """Return a file's text; "" where it cannot be read."""
    try:
        return file.read_text(errors="replace")
    except OSError:
        return ""


def proc_mb(file: str, entry: str) -> float | None:
    """Return an entry of a file below /proc, in MB; None without the file or the entry."""
    path = Path("/proc", file)
    found = re.search(rf"^{entry}:\s*(\d+) kB", path.read_text(), re.M) if path.exists() else None
    if found is None:
        return None
    kib = int(found[1])  # which Linux calls kB
    return kib * 1024 / 1e6

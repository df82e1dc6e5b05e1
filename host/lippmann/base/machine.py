"""Describes the processor, and measures the memory that can still be allocated."""

from __future__ import annotations

import functools
import os
import platform
import re
import time
from collections.abc import Iterator
from pathlib import Path

#: For each version of control groups: folders below the root, file of the memory limit,
#: file of the memory use, and pattern of cache sizes in memory.stat.
VERSIONS = {
    1: (("memory",), "memory.limit_in_bytes", "memory.usage_in_bytes", r"total_(?:in)?active_file"),
    2: (("", "unified"), "memory.max", "memory.current", r"(?:in)?active_file"),
}
#: A memory limit of this size or more means no limit; cgroups 1 write nearly 2^63.
UNLIMITED = 1 << 62
#: Assumed free memory, MB, if the system does not report it.
DEFAULT_FREE_MB = 4000.0


def free_memory_mb() -> float:
    """Return the free memory, MB: the minimum of machine and control groups; caches count as free."""
    return min([proc_mb("meminfo", "MemAvailable") or DEFAULT_FREE_MB, *group_memory_mb()])


def group_memory_mb(root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> Iterator[float]:
    """Yield the free memory, MB, of each limited control group of this process (cgroups(7)).

    Containers and batch systems set limits that /proc/meminfo ignores. The file `own`
    lists the process's groups, whose folders are below `root`.
    """
    for line in _text(own).splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        names, limit, used, dropped = VERSIONS[1 if controllers else 2]
        for top in (root / name for name in names):
            # In a container, `path` may be a path of the host; `top` is then the group.
            group = top / path.lstrip("/")
            for folder in [top] if ".." in group.parts else [group, *group.parents]:
                if folder.is_relative_to(top):
                    texts = _text(folder / limit), _text(folder / used)
                    upper, use = (re.findall(r"^(\d+)$", text, re.M) for text in texts)
                    if upper and use and int(upper[0]) < UNLIMITED:
                        caches = re.findall(rf"^{dropped} (\d+)$", _text(folder / "memory.stat"), re.M)
                        yield max(0, int(upper[0]) - int(use[0]) + sum(map(int, caches))) / 1e6


def _text(file: Path) -> str:
    try:
        return file.read_text(errors="replace")
    except OSError:
        return ""


def proc_mb(file: str, entry: str) -> float | None:
    """Return an entry of a file below /proc, in MB, or `None` if the entry is missing."""
    match = re.search(rf"^{entry}:\s*(\d+) kB", _text(Path("/proc", file)), re.M)
    # In /proc, kB means 1024 bytes.
    return None if match is None else int(match[1]) * 1024 / 1e6


def peak_memory_mb() -> float:
    """Return the peak memory of this process, MB, or 0 if unknown."""
    # Prefer /proc, because `getrusage` includes the memory of the parent process.
    if (peak := proc_mb("self/status", "VmHWM")) is not None:
        return peak
    try:
        import resource  # Windows does not have this module
    except ImportError:
        return 0.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def process_seconds() -> float:
    """Return the seconds since the start of this process, or 0 if /proc is missing."""
    status = _text(Path("/proc/self/stat"))
    if not status or not hasattr(os, "sysconf"):
        return 0.0
    # Field 22 of stat is the start time. Field 2, the name, may contain spaces.
    ticks = int(status.rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")


def processor_name() -> str:
    """Return the processor's name and, on Linux, its vector extension, such as "AMD EPYC with AVX2"."""
    match = re.search(r"^model name\s*:(.*)$", _information(), re.MULTILINE)
    name = match[1].strip() if match else platform.processor() or "unknown processor"
    vectors = " with AVX-512" if has_avx512() else " with AVX2" if "avx2" in features() else ""
    return name + vectors


def has_avx512() -> bool:
    """Return whether Dr.Jit can compute 16 floats at once (AVX-512VL)."""
    return "avx512vl" in features()


def features() -> frozenset[str]:
    """Return the processor's flags from /proc/cpuinfo (only on Linux and x86)."""
    lines = re.findall(r"^flags\s*:(.*)$", _information(), re.MULTILINE)
    return frozenset(" ".join(lines).split())


@functools.cache
def _information() -> str:
    return _text(Path("/proc/cpuinfo"))


def machine_name() -> str:
    """Describe the machine, such as "AMD EPYC with AVX-512, 2 cores, Linux x86_64"."""
    return f"{processor_name()}, {processor_count()} cores, {platform.system()} {platform.machine()}"


def processor_count() -> int:
    """Return the number of processors that this process can use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

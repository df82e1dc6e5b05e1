"""The machine: its processor and GPU, and the memory that this process may still take."""

from __future__ import annotations

import functools
import os
import platform
import re
import time
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
#: Free memory that is assumed where the system does not tell it, MB.
UNTOLD_MB = 4000.0


def free_memory_mb() -> float:
    """Return the free memory, MB, including what caches can release: of this machine or, if less, of a control group.

    Containers and batch systems limit their programs by control groups, of which /proc/meminfo knows nothing.
    """
    machine = proc_mb("meminfo", "MemAvailable") or UNTOLD_MB
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
    match = re.search(rf"^{entry}:\s*(\d+) kB", _text(Path("/proc", file)), re.M)
    # What Linux calls kB is a KiB.
    return None if match is None else int(match[1]) * 1024 / 1e6


def peak_memory_mb() -> float:
    """Return the peak memory of this process so far, MB; 0 where the system does not tell it."""
    # Unlike /proc, the resource usage is what a process inherits from its parent.
    if (peak := proc_mb("self/status", "VmHWM")) is not None:
        return peak
    try:
        import resource  # only Unix has it
    except ImportError:
        return 0.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def process_seconds() -> float:
    """Return the seconds since this process was started; 0 where /proc is not there to tell."""
    status = _text(Path("/proc/self/stat"))
    if not status or not hasattr(os, "sysconf"):
        return 0.0
    # The 22nd field; the second, the program's name in brackets, may hold spaces.
    ticks = int(status.rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")


def processor_name() -> str:
    """Return its name and vectors, where Linux tells them, such as "AMD EPYC with AVX2" or "... with AVX-512"."""
    named = re.search(r"^model name\s*:(.*)$", _information(), re.MULTILINE)
    name = named[1].strip() if named else platform.processor() or "unknown processor"
    vectors = " with AVX-512" if has_avx512() else " with AVX2" if "avx2" in features() else ""
    return name + vectors


def has_avx512() -> bool:
    """Tell whether the processor has AVX-512VL: Dr.Jit then computes 16 floats at once, else 8 or 4."""
    return "avx512vl" in features()


def features() -> frozenset[str]:
    """Return the flags of /proc/cpuinfo: those of Linux on x86, none elsewhere."""
    told = re.findall(r"^flags\s*:(.*)$", _information(), re.MULTILINE)
    return frozenset(word for line in told for word in line.split())


@functools.cache
def _information() -> str:
    return _text(Path("/proc/cpuinfo"))


def machine_name() -> str:
    """Return processor and cores, such as "AMD EPYC with AVX-512, 2 cores, Linux x86_64"."""
    return f"{processor_name()}, {processor_count()} cores, {platform.system()} {platform.machine()}"


def processor_count() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

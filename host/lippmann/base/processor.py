"""What the processor is called, and what it can do."""

from __future__ import annotations

import functools
import platform
import re
from pathlib import Path


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
    path = Path("/proc/cpuinfo")
    return path.read_text() if path.exists() else ""

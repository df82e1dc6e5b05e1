"""What the processor is called, and what it can do."""

from __future__ import annotations

import functools
import platform
import re
from pathlib import Path


def processor_name() -> str:
    """Return its name, such as "AMD EPYC"; one with vectors of 512 bits is "AMD EPYC with AVX-512"."""
    named = re.search(r"^model name\s*:(.*)$", _information(), re.MULTILINE)
    name = named[1].strip() if named else platform.processor() or "unknown processor"
    return f"{name} with AVX-512" if has_avx512() else name


@functools.cache
def has_avx512() -> bool:
    """Tell whether Dr.Jit and Embree trace 16 rays at once, and not 8."""
    return "avx512vl" in features()


def features() -> frozenset[str]:
    """Return the names of what its instructions can do, as Linux tells them; none elsewhere."""
    told = re.findall(r"^flags\s*:(.*)$", _information(), re.MULTILINE)
    return frozenset(word for line in told for word in line.split())


def _information() -> str:
    path = Path("/proc/cpuinfo")
    return path.read_text() if path.exists() else ""

"""Functional coverage: which of the situations that a module can be in were seen at its ports, and how often.

Counted only from words that the RTL has answered. A test ends with `close`, which fails when a situation was never
seen; the counts are kept in build/rtl-tests/coverage/, and pytest ends with their table (tests/conftest.py).
"""

import json
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from runner import BUILD

FOLDER = BUILD / "coverage"


class Coverage:
    """The situations of one module in one test, each with the times it was seen."""

    def __init__(self, module: str, case: str, seen: Mapping[str, int] = MappingProxyType({})) -> None:
        self.module, self.case, self.seen = module, case, Counter(seen)

    def point(self, name: str, seen: npt.ArrayLike) -> None:
        """Count a situation: a mask over words, or a number."""
        self.seen[name] += int(np.sum(seen))

    def values(self, name: str, got: npt.ArrayLike, wanted: Iterable[object]) -> None:
        """Count each of the values that must come up."""
        got = np.asarray(got)
        for value in wanted:
            self.point(f"{name} {value}", got == value)

    def close(self) -> None:
        """Keep the counts, and fail where one is 0."""
        FOLDER.mkdir(parents=True, exist_ok=True)
        path = FOLDER / f"{self.module}-{self.case}.json"
        path.write_text(json.dumps({"module": self.module, "case": self.case, "seen": self.seen}, indent=1))
        missing = [name for name, count in self.seen.items() if count == 0]
        assert self.seen, f"{self.module}: no situation was looked for"
        assert not missing, f"{self.module} {self.case}: never seen: {', '.join(missing)}"


def clear() -> None:
    """Forget the counts of earlier runs."""
    shutil.rmtree(FOLDER, ignore_errors=True)


def table() -> list[str]:
    """One line a module: situations, and the one seen least over all its cases; nothing where none was counted."""
    modules: dict[str, dict[str, int]] = {}
    for path in sorted(FOLDER.glob("*.json")):
        kept = json.loads(path.read_text())
        counts = modules.setdefault(kept["module"], {})
        for name, count in kept["seen"].items():
            counts[name] = counts.get(name, 0) + count
    modules = {module: counts for module, counts in modules.items() if counts}  # none: its bench failed at once
    if not modules:
        return []
    lines = ["| module | situations seen | seen least |", "|---|---|---|"]
    for module, counts in sorted(modules.items()):
        least = min(counts, key=lambda name: counts[name])
        hit = sum(count > 0 for count in counts.values())
        lines.append(f"| {module} | {hit} of {len(counts)} | {least}: {counts[least]} |")
    return lines

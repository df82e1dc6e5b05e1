"""Ends a run of the RTL's tests with the table of their functional coverage.

Here, not beside those tests: pytest calls these hooks in the conftest files of its first arguments only.
"""

import sys
from pathlib import Path

# Helpers of the RTL's benches, which the simulator's process imports too, and of the host's tests.
sys.path.insert(0, str(Path(__file__).with_name("host")))
sys.path.insert(0, str(Path(__file__).with_name("rtl")))

import rtl_coverage


def pytest_sessionstart(session):
    # xdist's workers share the folder; their controller clears it before they start.
    if not hasattr(session.config, "workerinput"):
        rtl_coverage.clear()


def pytest_terminal_summary(terminalreporter):
    lines = rtl_coverage.table()
    if lines:
        (rtl_coverage.FOLDER / "coverage.md").write_text("\n".join(lines) + "\n")
        terminalreporter.section("functional coverage of the RTL")
        for line in lines:
            terminalreporter.write_line(line)

"""Puts this folder on the path of the benches' tests, and ends their run with the table of their coverage."""

import shutil

import rtl_coverage


def pytest_sessionstart(session):
    # xdist's workers share the folder; their controller clears it before they start.
    if not hasattr(session.config, "workerinput"):
        shutil.rmtree(rtl_coverage.FOLDER, ignore_errors=True)


def pytest_terminal_summary(terminalreporter):
    if not rtl_coverage.FOLDER.exists():
        return
    lines = rtl_coverage.table()
    (rtl_coverage.FOLDER / "coverage.md").write_text("\n".join(lines) + "\n")
    terminalreporter.section("functional coverage of the RTL")
    for line in lines:
        terminalreporter.write_line(line)

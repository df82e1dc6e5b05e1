"""Runs slow files first, and ends a run of the RTL's tests with the table of their functional coverage.

Here, not beside those tests: pytest calls these hooks in the conftest files of its first arguments only.
"""

import os
import sys
from pathlib import Path

# numpy's threads wait busily, too, and for words of these sizes gain nothing. It looks when it is imported: the workers
# are started with this.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Helpers of the RTL's benches, which the simulator's process imports too, and of the host's tests.
sys.path.insert(0, str(Path(__file__).with_name("host")))
sys.path.insert(0, str(Path(__file__).with_name("rtl")))

import pytest
import rtl_coverage

#: Files that take longest, the longest first. `make test` gives each file to one worker, so that what its tests share
#: is made once; a long one at the end would leave the other workers idle. The run ends with the slowest tests.
FIRST = (
    "test_virtual_board.py", "test_formal.py", "test_foreign_stream.py", "test_viewer.py", "test_docs.py",
    "test_cells.py", "test_elaboration.py", "test_fast_engine.py", "test_diagnose_regress.py", "test_board_commands.py",
    "test_calibration.py", "test_fuzz.py", "test_bands.py", "test_fit.py", "test_renderer.py", "test_site.py",
    "test_demo.py", "test_board_scene.py", "test_povray_scene.py", "test_link_faults.py", "test_foreign_rtl.py",
    "test_film_cluster.py", "test_report_command.py", "test_cli.py", "test_board_line.py", "test_scan_out.py",
    "test_fixed_error.py", "test_batch.py", "test_golden_exact.py", "test_povray_optics.py", "test_scene_files.py",
    "test_live.py", "test_observer.py", "test_aim.py",
)  # fmt: skip


def pytest_sessionstart(session):
    there = {path.name for path in Path(__file__).parent.rglob("test_*.py")}
    assert there.issuperset(FIRST), f"tests/conftest.py: FIRST names no files: {set(FIRST) - there}"
    # xdist's workers share the folder; their controller clears it before they start.
    if not hasattr(session.config, "workerinput"):
        rtl_coverage.clear()
        return
    # Workers have a processor each: Dr.Jit's threads wait busily for each other, which takes it from the other workers.
    import drjit as dr

    dr.set_thread_count(1)


@pytest.fixture
def four_threads():
    """Four threads of Dr.Jit, for tests of what must not depend on their order."""
    import drjit as dr

    before = dr.thread_count()
    dr.set_thread_count(4)
    yield
    dr.set_thread_count(before)


def pytest_collection_modifyitems(config, items):
    # In one process the files' given order stands: the mutation tools name the nearest first.
    if hasattr(config, "workerinput"):
        places = {name: k for k, name in enumerate(FIRST)}
        items.sort(key=lambda item: places.get(item.path.name, len(FIRST)))


def pytest_terminal_summary(terminalreporter):
    lines = rtl_coverage.table()
    if lines:
        (rtl_coverage.FOLDER / "coverage.md").write_text("\n".join(lines) + "\n")
        terminalreporter.section("functional coverage of the RTL")
        for line in lines:
            terminalreporter.write_line(line)

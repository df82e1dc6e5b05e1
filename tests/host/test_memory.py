"""The free memory: of the machine, and of control groups, by trees of files as Linux shows them."""

from pathlib import Path

import pytest
from lippmann.base import machine
from lippmann.base.machine import free_memory_mb, group_memory_mb

MB = 1_000_000
#: A limit, and what is used.
FILES = {1: ("memory.limit_in_bytes", "memory.usage_in_bytes"), 2: ("memory.max", "memory.current")}


def group(folder, version, limit, used, inactive=0, active=0):
    """Write a group's files. Version 1 counts a group's children in its entries total_...: the others are a trap."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, value in zip(FILES[version], (limit, used), strict=True):
        (folder / file).write_text(f"{value}\n")
    alone = f"inactive_file {7 * MB}\nactive_file {9 * MB}\ntotal_" if version == 1 else ""
    both = "total_active_file" if version == 1 else "active_file"
    stat = f"anon {3 * MB}\n{alone}inactive_file {inactive}\n{both} {active}\n"
    (folder / "memory.stat").write_text(stat)


def found(tmp_path, own):
    (tmp_path / "own").write_text(own)
    return list(group_memory_mb(tmp_path / "root", tmp_path / "own"))


@pytest.mark.parametrize(("version", "own"), [(1, "9:pids:/\n4:cpu,memory:/jobs/7\n0::/\n"), (2, "0::/jobs/7\n")])
def test_each_group_around_the_process_limits_it(tmp_path, version, own):
    top = tmp_path / "root" / ("memory" if version == 1 else "")
    group(top / "jobs/7", version, 900 * MB, 500 * MB, 10 * MB, 20 * MB)
    group(top / "jobs", version, 2000 * MB, 1500 * MB)
    group(top / "jobs/8", version, 10 * MB, 9 * MB)
    assert found(tmp_path, own) == pytest.approx([430.0, 500.0])


def test_a_container_sees_its_own_group_at_the_top(tmp_path):
    """By the path that it has outside, which is not there."""
    group(tmp_path / "root/memory", 1, 900 * MB, 500 * MB)
    assert found(tmp_path, "4:memory:/docker/0123\n") == pytest.approx([400.0])
    group(tmp_path / "root", 2, 700 * MB, 500 * MB)
    for outside in ("0::/../../x\n", "0::/\n", "0::/a:b\n"):
        assert found(tmp_path, outside) == pytest.approx([200.0])
    # Beside version 1, those of version 2 have a folder of their own.
    group(tmp_path / "root/unified/x", 2, 900 * MB, 500 * MB)
    assert 400.0 in found(tmp_path, "3:pids:/x\n0::/x\n")


@pytest.mark.parametrize(
    ("limit", "used", "left_mb"),
    [*((limit, 5, []) for limit in ("max", "", "-1", (1 << 63) - 4096)), (5, "", []), (5 * MB, 7 * MB, [0.0])],
)
def test_no_limit_that_can_be_read_is_none(tmp_path, limit, used, left_mb):
    group(tmp_path / "root", 2, limit, used)
    assert found(tmp_path, "0::/\n") == left_mb


def test_without_control_groups_there_is_no_limit(tmp_path):
    assert list(group_memory_mb(tmp_path / "root", tmp_path / "none")) == []
    assert found(tmp_path, "4:memory:/x\n0::/x\n") == []


def test_free_memory_counts_what_caches_give_back(monkeypatch):
    monkeypatch.setattr(machine, "group_memory_mb", lambda: iter(()))  # these tests may run in a container
    lines = Path("/proc/meminfo").read_text().splitlines()
    available = next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) * 1024 / 1e6
    assert free_memory_mb() == pytest.approx(available, rel=0.2)


def test_the_least_counts(monkeypatch):
    monkeypatch.setattr(machine, "proc_mb", lambda *_: 1000.0)
    for groups, least in (([], 1000.0), ([1e12], 1000.0), ([1e12, 123.0, 200.0], 123.0)):
        monkeypatch.setattr(machine, "group_memory_mb", lambda groups=groups: iter(groups))
        assert free_memory_mb() == least

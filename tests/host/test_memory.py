"""The free memory of control groups, by trees of files as Linux shows them."""

import pytest
from lippmann import memory
from lippmann.memory import free_memory_mb, group_memory_mb

MB = 1_000_000


def group(folder, version, limit, used, dropped=0):
    folder.mkdir(parents=True, exist_ok=True)
    _, most, taken, entry = memory.VERSIONS[version]
    (folder / most).write_text(f"{limit}\n")
    (folder / taken).write_text(f"{used}\n")
    # The entry of the group without its children, and another one, are none of it.
    (folder / "memory.stat").write_text(f"anon 5\ninactive_file {dropped if version == 2 else 7}\n{entry} {dropped}\n")


def found(tmp_path, own):
    (tmp_path / "own").write_text(own)
    return list(group_memory_mb(tmp_path / "root", tmp_path / "own"))


@pytest.mark.parametrize(("version", "own"), [(1, "9:pids:/\n4:cpu,memory:/jobs/7\n0::/\n"), (2, "0::/jobs/7\n")])
def test_each_group_around_the_process_limits_it(tmp_path, version, own):
    top = tmp_path / "root" / ("memory" if version == 1 else "")
    group(top / "jobs/7", version, 900 * MB, 500 * MB, 30 * MB)
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


@pytest.mark.parametrize(("limit", "used"), [("max", 5), ("", 5), (5, ""), ("-1", 5)])
def test_no_limit_that_can_be_read_is_none(tmp_path, limit, used):
    group(tmp_path / "root", 2, limit, used)
    assert found(tmp_path, "0::/\n") == []


def test_more_than_the_limit_leaves_nothing(tmp_path):
    group(tmp_path / "root", 2, 5 * MB, 7 * MB)
    assert found(tmp_path, "0::/\n") == [0.0]


def test_without_control_groups_there_is_no_limit(tmp_path):
    assert list(group_memory_mb(tmp_path / "root", tmp_path / "none")) == []
    assert found(tmp_path, "4:memory:/x\n0::/x\n") == []


def test_the_least_counts(monkeypatch):
    machine = free_memory_mb()
    monkeypatch.setattr(memory, "group_memory_mb", lambda: iter([1e12, 123.0, 200.0]))
    assert free_memory_mb() == 123.0
    monkeypatch.setattr(memory, "group_memory_mb", lambda: iter([1e12]))
    assert free_memory_mb() == pytest.approx(machine, rel=0.2)

"""A small disk, for tests of full ones."""

import contextlib
import subprocess

import pytest


@contextlib.contextmanager
def full_disk(place):
    """Provide an empty folder on a disk of 64 KB."""
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", place], check=False).returncode:
        pytest.skip("mounting a small disk needs root")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", place], check=True)

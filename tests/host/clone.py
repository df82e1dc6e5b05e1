"""A fresh clone of the checkout, with what is not committed yet: the files that git knows, or would add."""

import shutil
import subprocess
from pathlib import Path

TOP = Path(__file__).parents[2]


def files(*folders):
    """The files of some folders of the checkout, or of all."""
    command = ["git", "-C", str(TOP), "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--", *folders]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
    return sorted({name for name in found if name and (TOP / name).is_file()})


def clone(into):
    for name in files():
        (into / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(TOP / name, into / name)
    return into

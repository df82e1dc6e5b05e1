"""SECURITY.md names the limits that hold, and tests that are there."""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest
from lippmann.base import file_limits, images, toml
from lippmann.calibration import photographs
from lippmann.eye import page_server
from lippmann.layers import layers_and_pictures
from lippmann.scenes import depth_picture, meshes, quilts_and_views, splats
from lippmann.simulation.toolchain import repository
from lippmann.simulation.virtual_board import IDLE_S

PAGE = (repository() / "SECURITY.md").read_text()


def test_each_promise_has_its_test():
    rows = re.findall(r"^\| .* \| `(tests/\S+\.py)::(\w+)` \|$", PAGE, re.M)
    assert len(rows) == PAGE.split("## Promises")[1].count("\n| ") - 1
    for file, name in rows:
        assert re.search(rf"^def {name}\(", (repository() / file).read_text(), re.M), name


def test_the_limits_are_those_of_the_code():
    def row(start):
        return re.search(rf"^\| {re.escape(start)} \| (.*) \|$", PAGE, re.M)[1]

    assert row("TOML file") == f"{file_limits.MAX_TOML_BYTES >> 20} MB; {toml.MAX_KEY_PARTS} parts in a dotted key"
    assert row("scene's XML").startswith(
        f"{file_limits.MAX_XML_BYTES >> 20} MB; elements {file_limits.MAX_XML_DEPTH} deep"
    )
    assert row("table of pixels or words") == f"{file_limits.MAX_TABLE_BYTES >> 20} MB"
    assert file_limits.MAX_RAYS == 10**8
    assert file_limits.SHARE == 0.8
    assert f"{images.MAX_CHANNELS} channels; {images.MAX_TEXT_BYTES >> 10} KB" in row("image")
    assert row("photograph of a calibration") == f"{photographs.MAX_PIXELS // 10**6} million pixels"
    assert row("picture of depths") == f"{depth_picture.MAX_PIXELS // 10**6} million pixels"
    million = quilts_and_views.MAX_PIXELS // 10**6
    views, megabytes = quilts_and_views.MAX_VIEWS, quilts_and_views.MAX_BYTES >> 20
    told = f"{million} million pixels in all; {views} views; {megabytes} MB of `views.json`"
    assert row("quilt, folder of views") == told
    most = layers_and_pictures.MAX_PIXELS // 10**6
    assert row("layer's picture").endswith(f"; {most} million pixels of a picture that `layers` cuts")
    corners, large = meshes.MAX_CORNERS // 10**6, splats.MAX_BYTES >> 30
    texture = f"{corners} million corners of faces and {meshes.MAX_PIXELS // 10**6} million pixels a texture"
    assert row("mesh, splats") == f"{meshes.MAX_BYTES >> 30} GB, {texture}; {large} GB"
    assert file_limits.MAX_HEADER_BYTES == 10_000
    assert row("bitstream") == f"{file_limits.MAX_BITSTREAM_BYTES >> 20} MB"
    assert IDLE_S == 60
    assert page_server.MAX_REQUESTS == 8


@pytest.mark.parametrize("name", ["a:b", "a$(id)", "a`id`", "a'b", 'a"b', "a\\b", "a\nb", "read-only"])
def test_setup_refuses_folders_before_it_installs_anything(tmp_path, name):
    """As another user where this one is root, who may write everywhere."""
    for folder in (tmp_path, *tmp_path.parents):
        if folder.is_relative_to(tempfile.gettempdir()) and folder != Path(tempfile.gettempdir()):
            folder.chmod(0o755)
    checkout = tmp_path / name
    (checkout / "host").mkdir(parents=True)
    shutil.copy(repository() / "host/setup.sh", checkout / "host")
    checkout.chmod(0o555 if name == "read-only" else 0o777)
    user = {"user": 65534} if os.getuid() == 0 else {}
    words = ["bash", str(checkout / "host/setup.sh"), "system"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd="/", **user)
    assert (done.returncode, done.stdout) == (3, "")
    (line,) = done.stderr.splitlines()
    # As bash shows it: with the signs that it would obey escaped.
    shown = subprocess.run(["bash", "-c", 'printf %q "$0"', checkout], capture_output=True, text=True, check=True)
    assert shown.stdout in line
    assert line.endswith("clone into a folder of your own" if name == "read-only" else "move the checkout")

"""SECURITY.md names the limits that hold, and tests that are there."""

import re

from lippmann import images, limits, toml
from lippmann.sim.tools import repository
from lippmann.sim.virtual_board import IDLE_S
from lippmann.viewer import serve

PAGE = (repository() / "SECURITY.md").read_text()


def test_each_promise_has_its_test():
    rows = re.findall(r"^\| .* \| `(tests/\S+\.py)::(\w+)` \|$", PAGE, re.M)
    assert len(rows) == PAGE.split("## Promises")[1].count("\n| ") - 1
    for file, name in rows:
        assert re.search(rf"^def {name}\(", (repository() / file).read_text(), re.M), name


def test_the_limits_are_those_of_the_code():
    def row(start):
        return re.search(rf"^\| {re.escape(start)} \| (.*) \|$", PAGE, re.M)[1]

    assert row("TOML file") == f"{limits.MAX_TOML_BYTES >> 20} MB; {toml.MAX_KEY_PARTS} parts in a dotted key"
    assert row("scene's XML").startswith(f"{limits.MAX_XML_BYTES >> 20} MB; elements {limits.MAX_XML_DEPTH} deep")
    assert row("table of pixels or words") == f"{limits.MAX_TABLE_BYTES >> 20} MB"
    assert limits.MAX_RAYS == 10**8
    assert limits.SHARE == 0.8
    assert f"{images.MAX_CHANNELS} channels; {images.MAX_TEXT_BYTES >> 10} KB" in row("image")
    assert row("bitstream") == f"{limits.MAX_BITSTREAM_BYTES >> 20} MB"
    assert IDLE_S == 60
    assert serve.MAX_REQUESTS == 8

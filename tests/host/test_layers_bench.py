"""`bench layers`: what it measures on scenes whose layers, holes and bytes are known, and its kept page."""

import dataclasses
import itertools
import zlib

import numpy as np
import pytest
from cobs import cobs
from lippmann.conformance.figures import read_csv
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.layer_drawing import exit_lines
from lippmann.layers.scene_cutting import SLOT as BUILD_SLOT
from lippmann.layers.scene_cutting import cut_scene
from lippmann.layers.stack import light_of
from lippmann.rendering.options import Settings
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from scene_cases import focused_display, glowing_card, write_scene
from tools import layers_likeness

REPORTS = repository() / "docs/generated/reports"
DISPLAY = focused_display("square", focal=4.0, width_px=160, height_px=120, pixel_pitch=0.2)
SLOT = (64, 64)
FAST = Settings(samples=4, integrator="direct")


@pytest.fixture
def scene(mi, tmp_path):

    def load(*parts):
        return load_scene(write_scene(tmp_path / "cards.xml", *parts), Placement(near_mm=30.0, far_mm=-80.0))

    return load


def test_two_plain_cards_are_two_layers_without_a_hole(scene):
    cards = scene(glowing_card("front", 10.0, (0.6, 0.1, 0.1), 5.0), glowing_card("wall", -15.0, (0.1, 0.5, 0.2)))
    streamed, *rows = layers_likeness.measure_scene(cards, DISPLAY, 0, slot=SLOT, settings=FAST)
    # There are two depths, and no third layer.
    assert [(row["layers"], row["drawn"]) for row in rows] == [
        (1, "nearest"), (1, "bilinear"), (2, "nearest"), (2, "bilinear"),
    ]  # fmt: skip
    assert all(row["worst_db"] <= row["view_db"] for row in (streamed, *rows))
    assert rows[2]["view_db"] > rows[0]["view_db"] + 3.0
    # Its 8 bits are all that it loses: half a level of 255, uniform, 20 log10(255 sqrt(12)) = 59 dB.
    assert streamed["view_db"] == pytest.approx(59.0, abs=3.0)
    assert {row["holes_percent"] for row in rows} == {0.0}
    # A packet of 1024 bytes: 9 around them, before the stuffing of 1 byte in 254 at most, and its end.
    assert rows[2]["load_bytes"] == 2 * 5 * 1024
    assert 10 * (1024 + 9 + 2) <= rows[2]["line_bytes"] <= 10 * (1024 + 9 + 6)
    assert {row["frame_bytes"] for row in rows} == {39}  # docs/reference/protocol.md
    assert streamed["frame_bytes"] == streamed["line_bytes"] < 160 * 120 * 3
    assert list(streamed) == list(rows[0])


def test_a_hole_is_found_where_a_layer_was_pierced(scene):
    """A slanted card in three layers; then the one in the middle gets a square hole of an eighth of its sides."""
    slant = scene(glowing_card("slant", -10.0, (0.5, 0.5, 0.5), 200.0, turn='<rotate y="1" angle="40"/>'))
    cut = cut_scene(slant, DISPLAY, 3, (128, 96), FAST)
    lines = list(exit_lines(DISPLAY))
    pierced = list(cut.stack.layers)
    layer, (rows, columns) = pierced[1], pierced[1].texels.shape
    assert light_of(layer.palette[:, :3]).max() == pytest.approx(0.5, abs=0.01)
    texels = layer.texels.copy()
    texels[rows * 7 // 16 : rows * 9 // 16, columns * 7 // 16 : columns * 9 // 16] = 0  # the transparent colour
    pierced[1] = dataclasses.replace(layer, texels=texels)
    broken = dataclasses.replace(cut, stack=dataclasses.replace(cut.stack, layers=tuple(pierced)))
    for drawn in ("nearest", "bilinear"):
        assert layers_likeness.hole_percent(slant, cut, DISPLAY, lines, drawn, FAST) == 0.0
        assert layers_likeness.hole_percent(slant, broken, DISPLAY, lines, drawn, FAST) > 0.2
    # Seen against nothing at all: the last layer away.
    last = dataclasses.replace(pierced[2], palette=np.zeros((256, 4), np.uint8))
    gone = dataclasses.replace(cut, stack=dataclasses.replace(cut.stack, layers=(*cut.stack.layers[:2], last)))
    assert layers_likeness.hole_percent(slant, gone, DISPLAY, lines, "nearest", FAST) > 10.0


def test_a_streamed_frame_is_its_packets():
    """A plain frame of 2 x 1 tiles: one colour, 3 bytes, each; the packets are made again from the protocol's page."""
    frame = np.full((32, 64, 3), (1, 2, 3), np.uint8)
    wanted = 0
    for tile in (0, 1):
        # Type 5, sequence 0; epoch 0, tile, coding 1.
        data = bytes([layers_likeness.Kind.TILE, 0, 0, 0, 0, tile, 0, 1, 1, 2, 3])
        wanted += len(cobs.encode(data + zlib.crc32(data).to_bytes(4, "little"))) + 1
    assert layers_likeness.tile_bytes(frame) == wanted
    assert layers_likeness.line_seconds(300_000) == pytest.approx(1.0)  # 8 bits, start and stop at 3 Mbaud


def test_the_builds_of_the_page_are_those_that_make_synth_places():
    from tools.synthesis import SCENES

    for drawn in ("nearest", "bilinear"):
        for design in (design for design in SCENES if f"-{drawn}-" in design.name):
            scene = design.scene
            assert (scene.layers, scene.width, scene.height) == (SceneBuild().layers, *BUILD_SLOT) == (4, 256, 192)
            assert scene.bilinear == (drawn == "bilinear")


def test_figures_of_the_how_to_are_those_of_the_kept_report():
    _, rows = read_csv(REPORTS / "layers.csv")
    text = (repository() / "docs/how-to/layers.md").read_text().split("## How many layers?")[1].split("\n## ")[0]

    def db(display, scene, number, drawn="nearest"):
        wanted = (display, scene, number, drawn)
        (row,) = (row for row in rows if (row["display"], row["scene"], row["layers"], row["drawn"]) == wanted)
        return f"{row['view_db']:.1f}"

    gains = []
    for display, scene in itertools.product(layers_likeness.DISPLAYS, ("chart", "fish")):
        nearest = [db(display, scene, number) for number in (4, 8)]
        assert f"| {scene}, `{display}` | {' | '.join(nearest)} |" in text
        bilinear = [db(display, scene, number, "bilinear") for number in (4, 8)]
        gains += [float(one) - float(other) for one, other in zip(bilinear, nearest, strict=True)]
    assert f"Bilinear adds up to {max(gains):.0f} dB" in text
    assert min(gains) >= 0.0
    streamed, drawn = ([row for row in rows if (row["drawn"] == "streamed") == kind] for kind in (True, False))
    best = {(row["display"], row["scene"]): row["view_db"] for row in streamed}
    assert all(row["view_db"] < best[row["display"], row["scene"]] for row in drawn)
    assert all(row["holes_percent"] == 0.0 and row["worst_db"] <= row["view_db"] for row in drawn)
    assert f"gives {min(row['view_db'] for row in streamed):.1f} dB or more" in text
    assert f"up to {max(layers_likeness.line_seconds(row['line_bytes']) for row in streamed):.1f} s" in text
    loads = {f"{layers_likeness.line_seconds(row['line_bytes']):.1f} s once" for row in rows if row["layers"] == 4}
    assert all(load in text for load in loads)
    assert "then 39 bytes" in text
    assert {row["frame_bytes"] for row in drawn} == {39}

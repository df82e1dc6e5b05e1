"""The demo on small panels: its results, its figures, and what it says of a board that shows something else."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from lippmann.board.film_player import Played
from lippmann.board.virtual_loop import frames_differ
from lippmann.cli import demo, run
from lippmann.fixed.scene_build import SceneBuild
from PIL import Image

SCENES = Path(__file__).parents[2] / "scenes"
PAGE = SCENES.parent / "docs/reference/command-line.md"
#: The size of the panels that other system tests compile, too.
WIDTH, HEIGHT = 112, 80


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """The scenes that ship, with small panels."""
    folder = tmp_path_factory.mktemp("scenes")
    for name in ("fish", "films", "layers"):
        (folder / name).symlink_to(SCENES / name)
    (folder / "displays").mkdir()
    for name in (demo.DISPLAY, demo.DRAWN_DISPLAY):
        text = (SCENES / name).read_text()
        text = re.sub(r"^width_px = .*", f"width_px = {WIDTH}", text, flags=re.M)
        (folder / name).write_text(re.sub(r"^height_px = .*", f"height_px = {HEIGHT}", text, flags=re.M))
    return folder


@pytest.fixture
def few_pixels(monkeypatch):
    """Views of the panels that are no larger than those are."""
    for name in ("VIEW_WIDTH_PX", "DRAWN_VIEW_WIDTH_PX"):
        monkeypatch.setattr(demo, name, WIDTH)
    monkeypatch.setattr(demo, "VIEW_SAMPLES", 4)


def ran(scenes, out, capfd):
    code = run(["demo", "--scenes", str(scenes), "-o", str(out)])
    said, told = capfd.readouterr()
    return code, said, told


@pytest.mark.usefixtures("few_pixels")
def test_every_result_is_there(scenes, tmp_path, capfd):
    code, said, told = ran(scenes, tmp_path, capfd)
    assert code == 0, told
    result = json.loads((tmp_path / "demo.json").read_text())
    assert list(result["drawn"]) == ["fish", "chart"]
    assert [film["frames"] for film in result["drawn"].values()] == [17, 1]
    for film in result["drawn"].values():
        assert (film["pixels_differ"], film["underflows"]) == (0, 0)
        assert film["pixels"] == film["frames"] * WIDTH * HEIGHT
        assert film["load_bytes"] > 4 * SceneBuild().slot_bytes
    # Three layers move, of which each takes seven words at most; those between are written, too.
    assert 39 < result["drawn"]["fish"]["most_bytes"] <= 39 + 2 * 32
    for name in result["drawn"]:
        with Image.open(tmp_path / f"drawn-{name}.gif") as animation:
            views = []
            for k in range(animation.n_frames):
                animation.seek(k)
                views.append(np.asarray(animation.convert("RGB")))
        assert len(views) >= 16
        assert all((one != other).any() for one, other in itertools.pairwise(views)), "the eye moves"
    # The page lists every file and every figure, and the last lines name the files.
    section = PAGE.read_text().split("\n## demo\n")[1].split("\n## ")[0]
    keys = {*result, *result["drawn"]["fish"]}
    assert not [key for key in keys if f"`{key}`" not in section]
    for path in tmp_path.iterdir():
        assert f"`{path.name}`" in section
        assert path.name in said or path.name == "demo.json"


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize("planted", ["frames_differ", pytest.param("play_film", marks=pytest.mark.full)])
def test_a_board_that_draws_something_else_is_told(scenes, tmp_path, capfd, monkeypatch, planted):
    """A pixel of a frame differs from the twin's; or pixels came too late. Exit code 1; the results are kept."""
    monkeypatch.setattr(demo, "_views", lambda *_: ([], []))  # of the frame that was streamed, before
    monkeypatch.delitem(demo.FILMS, "chart")  # drawn after it
    right = getattr(demo, planted)

    def wrong(*arguments, **options):
        result = right(*arguments, **options)
        return result + 1 if planted == "frames_differ" else Played(**{**vars(result), "underflows": 7})

    monkeypatch.setattr(demo, planted, wrong)
    code, said, told = ran(scenes, tmp_path, capfd)
    assert code == 1
    assert not said
    assert told.splitlines()[-1].endswith("board and twin drew different frames; please report this")
    fish = json.loads((tmp_path / "demo.json").read_text())["drawn"]["fish"]
    assert (fish["pixels_differ"], fish["underflows"]) == ((1, 0) if planted == "frames_differ" else (0, 7))
    assert (tmp_path / "drawn-fish.gif").is_file()


@pytest.mark.parametrize(("shown", "differ"), [([0, 1], 0), ([0], 6), ([0, 1, 1], 6), ([0, 2], 1), ([], 12)])
def test_frames_that_are_missing_or_too_many_count_whole(shown, differ):
    """Frames of 2 x 3 pixels; 0 is black, 1 is drawn, 2 is another in one pixel."""
    frames = [np.zeros((2, 3, 3), np.uint8), np.full((2, 3, 3), 9, np.uint8), np.full((2, 3, 3), 9, np.uint8)]
    frames[2][1, 1] = 8, 7, 9
    assert frames_differ([frames[k] for k in shown], frames[:2]) == differ

"""`tools.bench content`: the files that it makes, and its figures and pictures, on a small display."""

import numpy as np
import pytest
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_view
from lippmann.rendering.sampling import Window
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import arranged, load_scene
from lippmann.simulation.toolchain import repository
from tools import content
from tools.content import Surface, content_page, write_meshes, write_splats

SCENES = repository() / "scenes"


def test_every_mesh_and_the_splats_show_the_same_knot(tmp_path, mi):
    """Its texture's bright and dark dots, and without them the same outline as the STL."""
    knot, window = Surface.read(SCENES / "knot/knot.ply", SCENES / "knot/skin.png"), Window(90.0, 90.0, 90, 90)

    def seen(path, samples, placement=None):
        return render_view(load_scene(path, placement), (0.0, 0.0, 600.0), window, Settings(samples)).radiance

    meshes = {
        path.suffix: seen(path, 4, Placement(rotation_deg=(-90.0 * (path.suffix == ".stl"), 0.0, 0.0)))
        for path in write_meshes(knot, tmp_path)
    }
    outline = meshes[".stl"].max(axis=2) > 0.02
    for suffix in (".glb", ".obj", ".ply"):
        assert (outline ^ (meshes[suffix].max(axis=2) > 0.02)).mean() < 0.03
        assert np.std(meshes[suffix][outline], axis=0).min() > 0.1
    assert np.median(np.abs(meshes[".obj"] - meshes[".ply"])[outline]) < 0.05

    splats, wanted = seen(write_splats(knot, tmp_path / "s.ply", 1), 1), meshes[".glb"]
    there = wanted.max(axis=2) > 0.02
    assert (splats.max(axis=2)[there] > 0.05).mean() > 0.97
    assert (splats.max(axis=2)[~there] > 0.05).mean() < 0.1
    hue = [view[there] / np.maximum(view[there].sum(axis=1, keepdims=True), 1e-6) for view in (splats, wanted)]
    assert np.median(np.abs(hue[0] - hue[1])) < 0.05


@pytest.mark.full
def test_more_views_are_nearer_to_the_scene(tmp_path, monkeypatch, mi):
    monkeypatch.setattr(content, "VIEWS", ((3, 1), (16, 1)))
    monkeypatch.setattr(content, "SAMPLES", 2)
    rows = list(content.measure(SCENES, tmp_path, 1))
    few, many, depths, itself = (row["middle_db"] for row in rows)
    assert few < many < itself
    assert depths > few - 3.0
    assert "| views | 16 | 1 |" in content_page({}, rows).text()


@pytest.mark.full
def test_the_gallery_has_a_picture_of_each_kind(tmp_path, monkeypatch, mi):
    monkeypatch.setattr(content, "GALLERY", "vga-square")
    pictures, captions = content.gallery(SCENES, tmp_path, 1)
    assert len(pictures) == len(captions) == 8
    assert captions[-3:] == ["views/", "quilt_qs8x2a1.33333.png", "picture.toml"]
    assert all(picture.max() > 0.2 for picture in pictures)


def test_a_depth_picture_is_placed_by_its_camera(tmp_path, mi):
    display = content.load_display(SCENES / "displays/vga-square.toml")
    scene = load_scene(SCENES / "fish/fish.xml", Placement(0.25))
    path = content.write_depth_picture(scene, display, tmp_path, 160)
    placed = arranged(load_scene(path), display, "camera")
    # The camera was the display's eye: the scale brings the surface on the axis to the panel.
    near = placed.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(0.0, 0.0, -1.0))).t
    assert placed.placement.scale == pytest.approx(600.0 / float(np.array(near).ravel()[0]), rel=1e-6)

"""Light that rays share: lattices by hand, pictures against those of each ray's own light, and when it is not."""

import gc
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from lippmann.base.tones import psnr_db
from lippmann.base.variant import current_device
from lippmann.eye.observer import Eye, Window, observe
from lippmann.rendering import irradiance_cache_choice as choice
from lippmann.rendering import memory_estimate
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Renderer, render_integral
from lippmann.rendering.sampling import display_source
from lippmann.rendering.shading import IrradianceCache
from lippmann.rendering.surface_lattice import FAN, Place, corners, on_octahedron, place_of
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import scene_of
from scene_cases import focused_display, generator, programs_of

PAINT = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.5, 0.2]}}
BOTH = {"type": "twosided", "bsdf": PAINT}
SETTINGS = Settings(samples=4, shading="shared")
PLACED = Placement(near_mm=30.0, far_mm=-30.0)


def lamp(position, power=4000.0):
    return {"type": "point", "position": position, "intensity": {"type": "rgb", "value": [power, power, 0.8 * power]}}


def wall(mi, z=-6.0, half=12.0, bsdf=BOTH):
    to_world = mi.ScalarTransform4f().translate([0, 0, z]).scale([half, half, 1.0])
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def ball(x, y, z, radius, bsdf=PAINT):
    return {"type": "sphere", "center": [x, y, z], "radius": radius, "bsdf": bsdf}


def scene(**parts):
    return scene_of({"type": "scene", **parts}, PLACED)


@pytest.fixture(scope="module")
def display():
    """24 x 18 lenslets of 12 x 12 pixels."""
    return focused_display("square", width_px=288, height_px=216, pixel_pitch=1.0 / 12.0)


@pytest.fixture
def eager(monkeypatch):
    """Let auto share light in small pictures, of few lamps."""
    monkeypatch.setattr(choice, "RAYS_A_POINT", 0.1)
    monkeypatch.setattr(choice, "MIN_LAMPS", 1)
    monkeypatch.setattr(choice, "MIN_RAYS", 1)


def both_ways(scene, display, settings=SETTINGS):
    ways = (settings, replace(settings, shading="each"))
    made = [render_integral(scene, display, "exact", way) for way in ways]
    assert [one.shading for one in made] == [way.shading for way in ways]
    return [one.radiance for one in made]


def views_db(shared, each, display):
    window = Window(24.0, 18.0, 160, 120)
    eyes = [Eye((x, y, 60.0)) for x, y in ((0.0, 0.0), (6.0, -4.0))]
    return min(psnr_db(*(observe(one, display, eye, window).radiance for one in (shared, each))) for eye in eyes)


#: Corners of a slender triangle, from its apex on.
SLENDER = np.array([[30.0, 0.3, 0.0], [0.0, 0.7, 0.0], [0.0, 0.0, 0.0]])


def triangles(mi, corners, bsdf=BOTH):
    mesh = mi.Mesh("triangles", 3 * len(corners), len(corners))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(corners)
    parameters["faces"] = np.arange(3 * len(corners))
    parameters.update()
    mesh.set_bsdf(mi.load_dict(bsdf))
    return mesh


def in_triangle(rng, count):
    u, v = rng.random((2, count))
    return np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)


def test_points_lie_no_further_apart_than_asked(mi):
    """Of triangles of all shapes, by their corners' places in space; slender ones need few points."""
    rng, spacing = generator(9), 0.5
    others = rng.normal(size=(40, 3, 3)) * rng.uniform(0.1, 3.0, (40, 1, 1))
    placed = np.array([*(np.roll(SLENDER, k, axis=0) for k in range(3)), *others])
    light = IrradianceCache(scene(mesh=triangles(mi, placed), lamp=lamp([0, 20, 30])), spacing)
    kinds, number = np.array(light.lattices.kind), rng.integers(0, len(placed), 6000).astype(np.uint32)
    assert len(kinds) == len(placed)
    assert ((kinds[:3] & FAN) != 0).all()
    # 0.7 by 30 mm: rows of two steps, and as many rows as half millimetres.
    assert np.array(light.lattices.first)[:4].tolist() == [3 * 62 * k for k in range(4)]
    u, v = in_triangle(rng, 6000)

    def in_space(place):
        """Mitsuba's u and v are the shares of the second corner and the third."""
        s, t = np.array(place.u)[:, None], np.array(place.v)[:, None]
        a, b, c = (placed[np.array(place.lattice)][:, k] for k in range(3))
        return (1.0 - s - t) * a + s * b + t * c

    given = Place(mi.UInt32(number), mi.Float(u), mi.Float(v), mi.Bool(np.zeros(6000, bool)))
    points, weights = corners(light.lattices, given)
    found = np.stack([in_space(place_of(light.lattices, point)) for point in points])
    shares = np.stack([np.array(weight) for weight in weights])
    assert shares.min() > -1e-3
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, atol=1e-5)
    # Along a row, and from row to row; the cell's diagonal is longer where they meet at a blunt angle.
    for other in found[1:]:
        assert np.linalg.norm(other - found[0], axis=1).max() < spacing * (1 + 1e-5)
    assert np.linalg.norm(found[1] - found[2], axis=1).max() < 2.0 * spacing
    # A place is the mean of the three; rows of a slender triangle narrow on their way to the apex.
    apart = np.linalg.norm((shares[..., None] * found).sum(axis=0) - in_space(given), axis=1)
    assert apart[(kinds[number] & FAN) == 0].max() < 1e-4
    assert apart.max() < 0.1 * spacing


@pytest.mark.parametrize("apex", range(3))
def test_the_apex_of_a_slender_triangle(mi, apex):
    """Where rounding leaves no share for the other corners, or a little below 0, weights stay between 0 and 1."""
    placed = np.roll(SLENDER, apex, axis=0)[None]
    light = IrradianceCache(scene(mesh=triangles(mi, placed), lamp=lamp([0, 20, 30])), 0.1)
    rng = generator(10, apex)
    shares = np.concatenate([10.0 ** -rng.uniform(3, 12, (2000, 1)) * rng.random((2000, 2)), np.zeros((9, 2))])
    shares += rng.choice([0.0, 6e-8, -6e-8], shares.shape)
    full = np.insert(shares, 0, 1.0 - shares.sum(axis=1), axis=1)
    u, v = np.roll(full, apex, axis=1)[:, 1:].T.astype(np.float32)
    zero = np.zeros(len(u), np.uint32)
    _, weights = corners(light.lattices, Place(mi.UInt32(zero), mi.Float(u), mi.Float(v), mi.Bool(zero > 0)))
    assert min(np.array(weight).min() for weight in weights) > -1e-3
    assert max(np.array(weight).max() for weight in weights) < 1 + 1e-3


def test_shapes_without_a_lattice(mi):
    """Corners that are no numbers, no triangle at all, and triangles of more points than are allowed."""
    lost = np.array([np.full((3, 3), 1e30), np.full((3, 3), np.nan)])
    lost[0, 1] = 0.0
    empty = mi.Mesh("empty", 3, 0)
    empty.set_bsdf(mi.load_dict(BOTH))
    bodies = {"ball": ball(0, 0, 0, 1.0), "lamp": lamp([2, 3, 40])}
    meshes = (triangles(mi, lost), triangles(mi, [*lost[:1], SLENDER]), empty, wall(mi, half=3000.0))
    assert [IrradianceCache(scene(mesh=mesh, **bodies), 1.0).points for mesh in meshes] == [33**2] * 4
    many = scene(floor=wall(mi, half=300.0), **bodies)
    assert IrradianceCache(many, 1.0).points > 300_000
    assert IrradianceCache(many, 1.0, 300_000).points == 33**2
    assert IrradianceCache(many, 1.0, 1000).points == 0


def lit_by_hand(point, normal, lamps):
    """Light of lamps without shadows, divided by pi, in float64."""
    total = np.zeros((len(point), 3))
    for position, power in lamps:
        way = np.asarray(position, np.float64) - point
        distance = np.linalg.norm(way, axis=1)
        cosine = np.maximum((way * normal).sum(axis=1) / distance, 0.0)
        total += (power * cosine / distance**2)[:, None] * [1.0, 1.0, 0.8] / math.pi
    return total


def test_light_by_hand(mi):
    """On a convex body alone: of a sphere the far side is dark; a wall is lit on the side of each lamp."""
    lamps = [([3.0, 9.0, 12.0], 4000.0), ([-8.0, 2.0, -15.0], 1000.0)]
    given = {f"lamp{k}": lamp(position, power) for k, (position, power) in enumerate(lamps)}
    rng = generator(5)
    # A sphere.
    light = IrradianceCache(scene(b=ball(0.5, -0.3, 0.2, 2.0), **given), 0.05)
    out = rng.normal(size=(3, 2000))
    out /= np.linalg.norm(out, axis=0)
    u, v = on_octahedron(mi.Vector3f(out))
    no = mi.Bool(np.zeros(2000, bool))
    found = light.between(Place(mi.UInt32(np.zeros(2000, np.uint32)), u, v, no), mi.Bool(np.ones(2000, bool)))
    wanted = lit_by_hand(2.0 * out.T + [0.5, -0.3, 0.2], out.T, lamps)
    np.testing.assert_allclose(np.array(found).T, wanted, atol=2e-3 * wanted.max())
    # The two triangles of a wall, and slender ones, from both sides.
    flat = triangles(mi, [np.roll(SLENDER, k, axis=0) for k in range(3)])
    for body in (wall(mi), flat):
        made = scene(a=body, **given)
        (mesh,) = made.mitsuba.shapes()
        corners_of = np.array(mesh.vertex_positions_buffer(), np.float64).reshape(-1, 3)
        faces = np.array(mesh.faces_buffer()).reshape(-1, 3)
        light = IrradianceCache(made, 0.25)
        for back in (False, True):
            u, v = in_triangle(rng, 2000)
            which = rng.integers(0, len(faces), 2000).astype(np.uint32)
            place = Place(mi.UInt32(which), mi.Float(u), mi.Float(v), mi.Bool(np.full(2000, back)))
            found = light.between(place, mi.Bool(np.ones(2000, bool)))
            ends = corners_of[faces[which]]
            at = ends[:, 0] + u[:, None] * (ends[:, 1] - ends[:, 0]) + v[:, None] * (ends[:, 2] - ends[:, 0])
            wanted = lit_by_hand(at, np.tile([0.0, 0.0, -1.0 if back else 1.0], (2000, 1)), lamps)
            np.testing.assert_allclose(np.array(found).T, wanted, atol=1e-3 * wanted.max())


def test_another_picture_needs_no_other_programs(mi, display):
    """By another seed other samples ask for other points: their numbers are in no program, each would be compiled."""
    gc.collect()  # programs have the code of all scenes that are there
    lit = scene(a=wall(mi), b=ball(0, 0, 0, 2.0), lamp=lamp([3, 20, 30]), other=lamp([-9, 5, 20]))

    def programs(seed):
        return programs_of(lambda: render_integral(lit, display, "exact", replace(SETTINGS, seed=seed)))

    first = programs(1)
    assert len(first) > 5
    for seed in (2, 3, 4):
        assert programs(seed) <= first


def test_pictures_are_those_of_each_rays_light(mi, display):
    """Shadows, a mirror, glass, and one-sided paint from behind; light and dark."""
    glass = {"type": "dielectric", "int_ior": 1.5}
    made = scene(
        wall=wall(mi), ball=ball(-3, 1, 0, 2.0), small=ball(3, 3, 2, 0.7, BOTH),
        mirror=ball(4, -2, -1, 2.0, {"type": "conductor"}), glass=ball(-4, -4, 3, 1.0, glass),
        behind=wall(mi, -4.0, 1.5, {"type": "diffuse"}), a=lamp([10, 25, 40]), b=lamp([-30, 5, 25], 2000.0),
    )  # fmt: skip
    shared, each = both_ways(made, display)
    assert shared.max() > 0.3
    assert psnr_db(shared, each) > 45.0
    assert views_db(shared, each, display) > 45.0


def test_glass_draws_the_same_lots_both_ways(mi, display):
    """Through a ball and a pane of glass: both ways to shade reflect the same samples, and refract the others."""
    pane = {"type": "cube", "to_world": mi.ScalarTransform4f().translate([5, -4, 2]).scale([3, 3, 0.2]),
            "bsdf": {"type": "thindielectric"}}  # fmt: skip
    glass = ball(-2, 0, 2, 5.0, {"type": "dielectric", "int_ior": 1.5})
    made = scene(wall=wall(mi), glass=glass, pane=pane, a=lamp([10, 25, 40]), b=lamp([-30, 5, 25], 2000.0))
    shared, each = both_ways(made, display)
    assert each.max() > 0.3
    assert psnr_db(shared, each) > 45.0
    other = render_integral(made, display, "exact", replace(SETTINGS, seed=1)).radiance
    assert psnr_db(other, shared) < 35.0


def test_gloss_is_not_shared(mi, display):
    """Bit for bit the picture of each ray's light: gloss, a bump, a disk, and an instance have no lattice."""
    heights = mi.Bitmap(generator(6).random((16, 16, 1)).astype(np.float32))
    bump = {"type": "bumpmap", "arbitrary": {"type": "bitmap", "bitmap": heights, "raw": True}, "bsdf": PAINT}
    shiny = {"type": "roughplastic", "alpha": 0.2}
    disk = {"type": "disk", "to_world": mi.ScalarTransform4f().translate([3, 2, 1]).scale([3, 3, 1]), "bsdf": PAINT}
    made = scene(
        a=wall(mi, bsdf=shiny), b=ball(-3, 0, 0, 2.0, bump), c=disk, d=ball(50, 0, 0, 0.1), l=lamp([9, 25, 40])
    )
    shared, each = both_ways(made, display)
    assert each.max() > 0.05
    assert (shared == each).all()


@pytest.mark.parametrize(("subpixels", "rows"), [("none", 64), ("none", 128), ("rgb", 8)])
def test_pictures_do_not_depend_on_bands(mi, subpixels, rows):
    """Nor on their order: light is the same, whoever finds it first."""
    display = focused_display("hex", width_px=96, height_px=150, pixel_pitch=1.0 / 8.0, subpixels=subpixels)
    made = scene(wall=wall(mi), ball=ball(-1, 0, 0, 2.0), a=lamp([10, 25, 40]))
    source = display_source(display, "exact", 4)
    whole = Renderer(made, source, SETTINGS).render(0)[0]
    bands = [range(first, min(first + rows, 150)) for first in range(0, 150, rows)]
    parts = Renderer(made, source, SETTINGS, bands)
    found = {number: parts.render(number)[0] for number in reversed(range(len(bands)))}
    assert (np.concatenate([found[number] for number in range(len(bands))]) == whole).all()


def random_scene(mi, seed):
    """Bodies of all kinds, paints and lamps."""
    rng = generator(seed)
    glass = {"type": "dielectric", "int_ior": 1.5}
    paints = [BOTH, PAINT, {"type": "conductor"}, glass, {"type": "roughplastic", "alpha": 0.2}, {"type": "plastic"}]
    parts = {"wall": wall(mi, rng.uniform(-9.0, -4.0))}
    for k in range(rng.integers(2, 7)):
        at, size = rng.uniform(-6.0, 6.0, 3) * [1.0, 0.7, 0.5], rng.uniform(0.5, 2.0)
        bsdf = paints[rng.choice(6, p=[0.3, 0.3, 0.1, 0.1, 0.1, 0.1])]
        kind = rng.choice(["sphere", "cube", "rectangle", "cylinder", "disk"])
        turn = mi.ScalarTransform4f().translate(list(at)).rotate([1, 1, 0], rng.uniform(0, 90)).scale(size)
        parts[f"body{k}"] = {"type": str(kind), "to_world": turn, "bsdf": bsdf}
    for k in range(rng.integers(1, 5)):
        away, power = rng.uniform([-30, -10, 15], [30, 40, 60]), rng.uniform(500.0, 4000.0)
        to_world = mi.ScalarTransform4f().look_at(list(away), [0, 0, 0], [0, 1, 0])
        parts[f"lamp{k}"] = [
            lamp(list(away), power),
            {"type": "spot", "to_world": to_world, "intensity": power, "cutoff_angle": rng.uniform(5.0, 40.0)},
            {"type": "directional", "direction": list(-away), "irradiance": rng.uniform(0.3, 2.0)},
        ][rng.choice(3, p=[0.6, 0.2, 0.2])]
    # Bars, of slender triangles.
    for k in range(rng.integers(1, 4)):
        sides = [rng.uniform(2.0, 7.0), *rng.uniform(0.02, 0.5, 2)]
        at, axis, angle = rng.uniform(-6.0, 6.0, 3) * [1.0, 0.7, 0.5], rng.normal(size=3), rng.uniform(0, 180)
        turn = mi.ScalarTransform4f().translate(list(at)).rotate(list(axis), angle).scale(sides)
        parts[f"bar{k}"] = {"type": "cube", "to_world": turn, "bsdf": paints[rng.choice(2)]}
    return scene(**parts)


@pytest.fixture(scope="module")
def fine():
    """48 x 36 lenslets of 6 x 6 pixels."""
    return focused_display("square", width_px=288, height_px=216, pitch=0.5, pixel_pitch=1.0 / 12.0)


@pytest.mark.parametrize("first", [0, pytest.param(5, marks=pytest.mark.full), pytest.param(10, marks=pytest.mark.full),
                                   pytest.param(15, marks=pytest.mark.full)])  # fmt: skip
def test_the_tolerance_is_kept_on_random_scenes(mi, fine, first, eager):
    """Where auto shares, views are as like as it promises; and it shares in some of five scenes."""
    ways = set()
    for seed in range(first, first + 5):
        made = random_scene(mi, 100 + seed)
        auto = render_integral(made, fine, "exact", replace(SETTINGS, shading="auto"))
        each = render_integral(made, fine, "exact", replace(SETTINGS, shading="each"))
        ways.add(auto.shading)
        if auto.shading == "each":
            assert (auto.radiance == each.radiance).all()
        else:
            assert views_db(auto.radiance, each.radiance, fine) >= choice.CACHE_DB, seed
    if current_device() == "llvm":
        assert "shared" in ways


def lamp_with_picture(mi, kind):
    """A lamp whose light changes between points."""
    stripes = mi.Bitmap(np.tile(np.float32([0, 0, 0, 1])[None, :, None], (4, 16, 3)))
    picture = {"type": "bitmap", "bitmap": stripes, "raw": True}
    to_world = mi.ScalarTransform4f().look_at([0, 0, 40], [0, 0, 0], [0, 1, 0])
    return {"to_world": to_world} | {
        "projector": {"type": "projector", "irradiance": picture, "fov": 40.0, "scale": 4000.0},
        "spot": {"type": "spot", "texture": picture, "intensity": 4000.0},
        "directionalarea": {"type": "rectangle", "lamp": {"type": "directionalarea"}},
    }[kind]  # fmt: skip


@pytest.mark.parametrize(
    ("lamps", "integrator", "why"),
    [
        ({"sky": {"type": "constant"}}, "lights", "other lamps"),
        ({}, "lights", "other lamps"),
        ({"a": lamp([0, 0, 30])}, "direct", "the integrator direct uses random numbers"),
        ({f"l{k}": lamp([k, 0, 30]) for k in range(32)}, "lights", "other lamps"),
        ("projector", "lights", "other lamps"),
        ("spot", "lights", "other lamps"),
        ("directionalarea", "lights", "other lamps"),
    ],
)
def test_why_it_is_not_shared_is_told_where_it_was_asked_for(mi, display, lamps, integrator, why, caplog):
    caplog.set_level("INFO", "lippmann")
    settings = replace(SETTINGS, integrator=integrator, samples=1)
    made = scene(wall=wall(mi), **({"lamp": lamp_with_picture(mi, lamps)} if isinstance(lamps, str) else lamps))
    assert render_integral(made, display, "exact", settings).shading == "each"
    (message,) = caplog.messages
    assert message.startswith("no irradiance cache: ")
    assert why in message
    caplog.clear()
    render_integral(made, display, "exact", replace(settings, shading="auto"))
    assert not caplog.messages


def test_auto_leaves_thin_shadows_to_each_ray(mi, display, eager, caplog):
    """Of wires, thinner than a tenth of the lenslets' pitch, before a wall."""
    caplog.set_level("INFO", "lippmann")
    wires = {}
    for k in range(60):
        to_world = mi.ScalarTransform4f().translate([0.4 * k - 12.0, 0, -5.5]).scale([0.04, 12.0, 1.0])
        wires[f"wire{k}"] = {"type": "rectangle", "to_world": to_world, "bsdf": BOTH}
    made = scene(wall=wall(mi), **wires, a=lamp([10, 3, 10], 900.0))
    settings = replace(SETTINGS, shading="auto")
    auto = render_integral(made, display, "exact", settings)
    assert auto.shading == "each"
    if current_device() == "llvm":  # a GPU does not try
        (remark,) = caplog.messages
        assert re.search(r"PSNR \d+\.\d dB; 45 dB are needed, so it is not used$", remark)
    each = render_integral(made, display, "exact", replace(settings, shading="each"))
    assert (auto.radiance == each.radiance).all()


@pytest.mark.parametrize("free_mb", [1.0, 1e6])
@pytest.mark.parametrize(("limit_mb", "shading"), [(None, "shared"), (700.0, "each"), (800.0, "shared")])
def test_the_users_limit_decides_and_not_the_free_memory(mi, display, eager, monkeypatch, free_mb, limit_mb, shading):
    """500 MB, 250 more for the irradiance cache, and 2.2 MB for 288 x 216 pixels."""
    monkeypatch.setattr(memory_estimate, "free_memory_mb", lambda: free_mb)
    made = scene(wall=wall(mi), a=lamp([2, 3, 40]))
    settings = replace(SETTINGS, shading="auto", memory_mb=limit_mb)
    found = Renderer(made, display_source(display, "exact", 4, "chief", "fast", None), settings)
    assert found.shading == shading
    assert ("no room" in found.cache_report) == (shading == "each")


def rods(mi):
    """Wider than the lenslets' pitch, whose shadows are in the middle of the picture."""
    return {f"rod{k}": {"type": "rectangle", "bsdf": BOTH,
                        "to_world": mi.ScalarTransform4f().translate([3.0 * k - 6.0, 0, 2]).scale([0.7, 3.0, 1.0])}
            for k in range(5)}  # fmt: skip


@pytest.mark.parametrize("radius", [60.0, 1600.0])
def test_a_large_body_does_not_coarsen_others(mi, display, radius):
    """A studio around all has points a pitch apart, or none: what stands in it keeps its shadows."""
    made = scene(card=wall(mi, 0.0, 5.0), studio=ball(0, 0, 0, radius, BOTH), **rods(mi), a=lamp([2, 3, 40]))
    shared, each = both_ways(made, display, replace(SETTINGS, samples=1))
    lost = (each.max(axis=2) == 0.0) & (shared.max(axis=2) > 0.02)
    assert np.count_nonzero(lost) < 60  # corners of shadows; a rod's shadow has hundreds
    assert psnr_db(shared, each) > 35.0


@pytest.mark.parametrize("samples", [4, 16])
def test_the_trial_looks_between_the_columns_of_a_grid(mi, samples):
    """Of 300 x 300 tiles some are tried in every strip of 6, upright or level: a regular grid left most strips out."""
    wide = focused_display("square", width_px=2400, height_px=2400, pitch=0.5, pixel_pitch=1.0 / 12.0)
    tiles = choice.CacheTrial(display_source(wide, "pinhole", samples), samples)._tiles()
    for place in (tiles % 300, tiles // 300):
        assert (np.bincount(place // 6, minlength=50) > 0).all()


def test_why_a_trial_was_not_kept_is_told(mi, display, eager, caplog):
    """Gloss, which has no lattice, hides all that has one."""
    caplog.set_level("INFO", "lippmann")
    glossy = {"type": "roughconductor"}
    front = {"type": "rectangle", "bsdf": glossy, "to_world": mi.ScalarTransform4f().scale([50, 50, 1])}
    made = scene(front=front, back=wall(mi), a=lamp([2, 9, 40]))
    settings = replace(SETTINGS, shading="auto")
    assert render_integral(made, display, "exact", settings).shading == "each"
    assert caplog.messages == ["no irradiance cache: most rays meet surfaces that are too large or not diffuse"]


@pytest.mark.parametrize("samples", [1, 300])
def test_the_trial_does_not_depend_on_how_it_is_done(mi, display, eager, samples, monkeypatch):
    """All tiles at once, or one after the other; and it is that of these tiles in the two pictures."""
    made = scene(wall=wall(mi), ball=ball(0, 0, 0, 2.0), a=lamp([2, 9, 40]), b=lamp([-20, 9, 40]))
    source = display_source(display, "exact", samples)
    settings = replace(SETTINGS, samples=samples, shading="auto")
    likeness, psnr = [], choice.CacheTrial.psnr
    monkeypatch.setattr(choice.CacheTrial, "psnr", lambda *arguments: likeness.append(psnr(*arguments)) or likeness[-1])
    # The last is too few for all at once: 16 single tiles.
    for most in (choice.TRIAL_SAMPLES, 16 * 64 * samples, 7 * 64 * samples):
        monkeypatch.setattr(choice, "TRIAL_SAMPLES", most)
        Renderer(made, source, settings)
    assert likeness[1] == pytest.approx(likeness[2], abs=1e-6)
    assert 45.0 < likeness[0] <= likeness[1] + 20.0


def test_small_pictures_and_those_of_few_lamps_do_not_share(mi, display):
    lamps = {f"lamp{k}": lamp([9 * k, 5, 30]) for k in range(2)}
    made, few = scene(wall=wall(mi, half=200.0), **lamps), scene(wall=wall(mi, half=200.0), a=lamp([0, 0, 30]))
    assert render_integral(made, display, "exact", Settings(samples=1)).shading == "each"
    assert render_integral(few, display, "exact", Settings(samples=64)).shading == "each"
    many = render_integral(made, display, "exact", Settings(samples=64)).shading
    assert many == ("shared" if current_device() == "llvm" else "each")


@pytest.mark.parametrize("subpixels", ["none", "rgb"])
def test_the_trial_looks_at_as_many_places_of_many_samples(mi, subpixels, eager):
    """Its places, and what it says, depend little on the number of samples; before, of 22 it saw 16 places."""
    wide = focused_display("square", width_px=1000, height_px=1000, pixel_pitch=1.0 / 12.0, subpixels=subpixels)
    made = scene(wall=wall(mi), ball=ball(2, 1, 2, 1.5), a=lamp([10, 25, 40]), b=lamp([-30, 5, 25], 2000.0))
    said = []
    for samples in (4, 22, 1024):
        settings = replace(SETTINGS, samples=samples, shading="auto")
        source = display_source(wide, "exact", samples)
        assert len(choice.CacheTrial(source, samples)._tiles()) == 28 * 28
        tried = Renderer(made, source, settings)
        said.append(float(re.search(r"PSNR ([\d.]+) dB", tried.cache_report)[1]))
    assert max(said) - min(said) < 6.0, said

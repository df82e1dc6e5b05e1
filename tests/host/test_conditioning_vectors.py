"""`lippmann vectors`: what it writes is read back, by hand and by `lippmann regress`; and what regress refuses."""

import json

import numpy as np
import pytest
from lippmann.cli import run
from lippmann.conformance.hard_cases import changed
from lippmann.conformance.ray_sets import OUTPUTS, memory_lines, widths
from lippmann.conformance.vector_files import words_of_memory
from lippmann.display.description import display_text, load_display
from lippmann.engines import trace
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.simulation.toolchain import repository

SQUARE = str(repository() / "scenes/displays/paper-square.toml")
HEX = str(repository() / "scenes/displays/paper-hex.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Vectors of a few cases, one folder each."""
    top = tmp_path_factory.mktemp("vectors")
    for case in ("cell-edges", "indices", "far-origins"):
        assert run(["vectors", "--display", HEX, "--case", case, "--count", "6", "--fraction-bits", "16",
                    "-o", str(top / case), "--json"]) == 0  # fmt: skip
    return top


def test_header_says_what_is_there(folder):
    header = json.loads((folder / "indices/vectors.json").read_text())
    assert header["fraction_bits"] == 16
    assert "lippmann vectors --display" in header["command"]
    sets = {entry["set"]: entry for entry in header["sets"]}
    assert sets["indices-2.4"]["words"] == 0
    assert "register index" in sets["indices-2.4"]["refused"]
    assert sets["indices-2.2"]["words"] == 6
    assert not (folder / "indices/indices-2.4/expected.mem").exists()
    assert [word["bits"] for word in header["words"]["expected.mem"]] == [12, 12, 20, 20, 20, 18, 18, 18, 3]


def test_display_is_read_back_to_the_bit(folder):
    for entry in json.loads((folder / "indices/vectors.json").read_text())["sets"]:
        assert load_display(folder / "indices" / entry["set"] / "display.toml").identity == entry["identity"]
    display = load_display(SQUARE)
    odd = changed(display, rotation_deg=1 / 3, offset_mm=(1e-300, -2.5), radius_mm=10.0 / 7.0)
    (folder / "odd.toml").write_text(display_text(odd))
    again = load_display(folder / "odd.toml")
    assert (again.panel, again.array, again.gap_mm) == (odd.panel, odd.array, odd.gap_mm)


def test_arrays_are_golden_s_to_a_rounding(folder):
    place = folder / "cell-edges/cell-edges-aims"
    with np.load(place / "rays.npz") as rays:
        got = trace(load_display(place / "display.toml"), rays["pixel"], rays["aperture_mm"])
        same = got.status == rays["status"]
        assert same.sum() >= 5
        assert (np.abs(got.direction - rays["direction"]).max(axis=1) <= 4 * rays["turn_unit"])[same].all()
        assert set(rays.files) >= {"origin_mm", "centre_mm", "lenslet", "shift_unit_mm", "panel_mm", "home", "near_mm"}


def test_memory_files_by_hand(folder):
    """Bits written out: u in the most significant place, two's complement."""
    place = folder / "cell-edges/cell-edges-aims"
    lines = (place / "inputs.mem").read_text().split()
    with (place / "words.csv").open() as stream:
        heading, first = stream.readline().split(","), [int(word) for word in stream.readline().split(",")]
    u, v, a, b = first[:4]
    bits = "".join(format(word & (2**width - 1), f"0{width}b") for word, width in ((u, 18), (v, 18), (a, 18), (b, 18)))
    assert int(lines[0], 16) == int(bits, 2)
    assert len(lines[0]) == 18
    assert heading[4:7] == ["i", "j", "x"]
    registers = (place / "registers.mem").read_text().splitlines()
    assert [line.split(" // ")[1] for line in registers][:2] == ["x_from_u", "x_from_v"]
    assert all(len(line.split()[0]) == 16 for line in registers)


def test_words_survive_a_memory_file(tmp_path):
    bits = widths(OUTPUTS, 23)
    random = np.random.default_rng(9)
    words = [random.integers(-(1 << (w - 1)), 1 << (w - 1), 50) for w in bits[:-1]] + [random.integers(0, 5, 50)]
    (tmp_path / "x.mem").write_text("// rays\n" + "\n".join(memory_lines(words, bits)))
    for wrote, read in zip(words, words_of_memory(tmp_path / "x.mem", bits), strict=True):
        np.testing.assert_array_equal(wrote, read)
    assert len(FixedRays._fields) == len(bits)


@pytest.mark.parametrize("file", ["rays.npz", "words.csv", "expected.mem"])
def test_vectors_pass_their_own_judge(folder, file, capsys):
    place = folder / "cell-edges/cell-edges-aims"
    code = run(["regress", "--display", str(place / "display.toml"), "--rays", str(place / file),
                "--fraction-bits", "16", "--json"])  # fmt: skip
    assert (code, json.loads(capsys.readouterr().out)["wrong"]) == (0, 0)


@pytest.mark.parametrize("model", ["pinhole", "thin", "paraxial"])
def test_vectors_of_the_simpler_models_pass(model, tmp_path, capsys):
    folder = tmp_path / "vectors"
    assert run(["vectors", "--display", HEX, "--case", "cell-edges", "--model", model, "--count", "4",
                "-o", str(folder)]) == 0  # fmt: skip
    for file in ("rays.npz", "words.csv", "expected.mem"):
        place = folder / "cell-edges-aims"
        code = run(["regress", "--display", str(place / "display.toml"), "--rays", str(place / file),
                    "--model", model])  # fmt: skip
        assert code == 0, capsys.readouterr().out


def test_traced_rays_pass_and_others_do_not(tmp_path, capsys, monkeypatch):
    # These rays have no two faults, and to look for them takes long.
    monkeypatch.setattr("lippmann.conformance.judge._two", lambda seen: None)
    rays = str(tmp_path / "rays.npz")
    arguments = ["trace", "--display", SQUARE, "--engine", "fast", "--aperture", "full", "--pixels", "500", "-o", rays]
    assert run(arguments) == 0
    assert run(["regress", "--display", SQUARE, "--rays", rays]) == 0
    out = capsys.readouterr().out
    assert "500 rays right" in out
    assert "microradian (allowed: 2 to 2)" in out
    assert run(["regress", "--display", HEX, "--rays", rays]) == 4
    assert "stage: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("rays.npz", "no zip", "cannot be read"),
        ("rays.csv", "u,v\n1,2\n", "no columns"),
        ("rays.csv", "u,v,i,j,x,y,z,dx,dy,dz,status\n1,2,3\n", "contains a non-integer"),
        ("rays.mem", "xyz\n", "no such file"),
        ("rays.txt", "", "unknown extension"),
    ],
)
def test_files_that_cannot_be_judged_are_bad_input(tmp_path, refusal_of, name, text, says):
    (tmp_path / name).write_text(text)
    assert says in refusal_of("regress", "--display", SQUARE, "--rays", tmp_path / name)


@pytest.mark.parametrize("case", ["far-origins", "tangent"])
def test_rays_from_the_world_are_refused_not_judged(case, tmp_path, refusal_of):
    assert run(["vectors", "--display", HEX, "--case", case, "--count", "4", "-o", str(tmp_path / "set")]) == 0
    places = sorted((tmp_path / "set").glob("*/rays.npz"))
    assert places
    for rays in places:
        line = refusal_of("regress", "--display", rays.parent / "display.toml", "--rays", rays)
        assert f"{rays}: holds rays from the world; give rays from the panel" in line


def words_of(**changed):
    heading = "u,v,i,j,x,y,z,dx,dy,dz,status"
    row = dict.fromkeys(heading.split(","), 0) | changed
    return f"{heading}\n{','.join(str(word) for word in row.values())}\n"


@pytest.mark.parametrize(
    ("word", "value", "says"),
    [("u", 1 << 17, "beyond its 18 bits"), ("i", -(1 << 11) - 1, "beyond its 12"), ("x", 1 << 19, "beyond its 20"),
     ("dx", 1 << 62, "beyond its 18"), ("dz", -(1 << 17) - 1, "beyond its 18"), ("status", 8, "give 0 to 7"),
     ("status", -1, "give 0 to 7")],
)  # fmt: skip
def test_words_beyond_their_bits_are_bad_input(word, value, says, tmp_path, refusal_of):
    """F = 16: 18 bits in and out, 20 for places."""
    path = tmp_path / "rays.csv"
    path.write_text(words_of(**{word: value}))
    err = refusal_of("regress", "--display", SQUARE, "--rays", path, "--fraction-bits", "16")
    assert f"{path}: {word} of ray 0 is {value}" in err
    assert says in err


@pytest.mark.parametrize(
    ("inputs", "rays", "says"),
    [
        ("0\n", "12_ab // a ray\nxyz\n", "rays.mem:2: 'xyz' is not hexadecimal; give a line a ray"),
        ("0\n", "\n" + "f" * 40 + "\n", "rays.mem:2: more than the 141 bits of a ray; see vectors.json"),
        ("0\n0\n", "0\n", "rays.mem: inputs and outputs differ in number, or are empty"),
        ("", "", "rays.mem: inputs and outputs differ in number, or are empty"),
    ],
)
def test_memory_files_that_hold_no_rays_are_bad_input(inputs, rays, says, tmp_path, refusal_of):
    (tmp_path / "inputs.mem").write_text(inputs)
    (tmp_path / "rays.mem").write_text(rays)
    command = ["regress", "--display", SQUARE, "--fraction-bits", "16", "--rays"]
    assert says in refusal_of(*command, tmp_path / "rays.mem")
    assert "none.csv: no such file; give a .npz, .csv or .mem" in refusal_of(*command, tmp_path / "none.csv")


@pytest.mark.parametrize("name", ["rays.csv", "rays.mem", "inputs.mem"])
@pytest.mark.parametrize("content", [b"\xff\xfe\x00\x01", b"u,v\n\0\n"])
def test_words_that_are_no_text_are_bad_input(name, content, tmp_path, refusal_of):
    (tmp_path / "inputs.mem").write_text("0\n")
    (tmp_path / "rays.mem").write_text("0\n")
    (tmp_path / name).write_bytes(content)
    judged = "rays.mem" if name == "inputs.mem" else name
    assert f"{tmp_path / name}: is not text" in refusal_of("regress", "--display", SQUARE, "--rays", tmp_path / judged)


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"pixel": np.zeros((3, 2)), "direction": np.zeros((2, 3))}, "direction has shape (2, 3); give (3, 3)"),
        ({"pixel": np.zeros((0, 2)), "direction": np.zeros((0, 3))}, "holds no rays; give at least one"),
        ({"pixel": np.zeros((2, 2)), "direction": np.zeros((2, 3), complex)}, "direction is complex128; give real"),
        ({"pixel": np.array([["a", "b"]]), "direction": np.zeros((1, 3))}, "pixel is <U1; give real"),
        ({"pixel": np.float64(3.0), "direction": np.zeros((1, 3))}, "pixel has shape"),
        ({"pixel": np.zeros((1, 2))}, "has no array direction; give at least pixel and direction"),
        ({"pixel": np.full((1, 2), np.nan), "direction": np.zeros((1, 3))}, "pixel holds values that are not finite"),
    ],
)
def test_arrays_that_are_no_rays_are_bad_input(arrays, says, tmp_path, refusal_of):
    np.savez(tmp_path / "rays.npz", **arrays)
    assert says in refusal_of("regress", "--display", SQUARE, "--rays", tmp_path / "rays.npz")


def test_vectors_refuse_what_is_there_and_leave_nothing_half_written(tmp_path, refusal_of):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").write_text("mine")
    arguments = ["vectors", "--display", SQUARE, "--count", "2"]
    assert run([*arguments, "-o", str(tmp_path / "full")]) == 2
    assert run([*arguments, "-o", str(tmp_path / "no/where")]) == 2
    line = refusal_of(*arguments, "--case", "nosuch", "-o", tmp_path / "new")
    assert "unknown case 'nosuch'; choose from all, chief-ray" in line
    assert [path.name for path in tmp_path.iterdir()] == ["full"]

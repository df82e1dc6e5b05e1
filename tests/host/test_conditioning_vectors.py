"""`lippmann vectors`: what it writes is read back, by hand and by `lippmann regress`; and what regress refuses."""

import json

import numpy as np
import pytest
from lippmann.cli import run
from lippmann.conformance.hard_cases import changed
from lippmann.display.description import display_text, load_display
from lippmann.engines import trace
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


@pytest.mark.parametrize("model", ["exact", "pinhole", "thin", "paraxial"])
def test_vectors_pass_their_own_judge(model, tmp_path, capsys):
    words = ["--model", model, "--fraction-bits", "16"]
    assert run(["vectors", "--display", HEX, "--case", "cell-edges", "--count", "4", *words,
                "-o", str(tmp_path / "set")]) == 0  # fmt: skip
    place = tmp_path / "set/cell-edges-aims"
    for file in ("rays.npz", "words.csv", "expected.mem"):
        capsys.readouterr()
        judged = ["--display", str(place / "display.toml"), "--rays", str(place / file), *words, "--json"]
        assert (run(["regress", *judged]), json.loads(capsys.readouterr().out)["wrong"]) == (0, 0)


def test_traced_rays_pass_and_others_do_not(tmp_path, capsys, monkeypatch):
    # These rays have no two faults, and to look for them takes long.
    monkeypatch.setattr("lippmann.conformance.judge.find_two_faults", lambda seen: None)
    rays = str(tmp_path / "rays.npz")
    arguments = ["trace", "--display", SQUARE, "--engine", "fast", "--aperture", "full", "--pixels", "500", "-o", rays]
    assert run(arguments) == 0
    assert run(["regress", "--display", SQUARE, "--rays", rays]) == 0
    out = capsys.readouterr().out
    assert "500 rays right" in out
    assert "microradian (allowed: 2 to 2)" in out
    assert run(["regress", "--display", HEX, "--rays", rays]) == 4
    assert "500 of 500 rays wrong, the first is 0\nstage: lenslet (lenslet); " in capsys.readouterr().out


def words_of(**changed):
    heading = "u,v,i,j,x,y,z,dx,dy,dz,status"
    row = dict.fromkeys(heading.split(","), 0) | changed
    return f"{heading}\n{','.join(str(word) for word in row.values())}\n"


def arrays_of(pixel, direction=None):
    arrays = {"pixel": np.asarray(pixel)}
    return arrays if direction is None else {**arrays, "direction": np.asarray(direction)}


NO_TEXT = (b"\xff\xfe\x00\x01", b"u,v\n\0\n")


@pytest.mark.parametrize(
    ("name", "content", "inputs", "says"),
    [
        ("rays.npz", "no zip", None, "cannot be read"),
        ("rays.csv", "u,v\n1,2\n", None, "no columns"),
        ("rays.csv", "u,v,i,j,x,y,z,dx,dy,dz,status\n1,2,3\n", None, "contains a non-integer"),
        ("rays.txt", "", None, "unknown extension"),
        ("rays.mem", "xyz\n", None, "no such file"),
        # F = 16: 18 bits in and out, 20 for places.
        ("rays.csv", words_of(u=1 << 17), None, "rays.csv: u of ray 0 is 131072, beyond its 18 bits"),
        ("rays.csv", words_of(i=-(1 << 11) - 1), None, "rays.csv: i of ray 0 is -2049, beyond its 12"),
        ("rays.csv", words_of(x=1 << 19), None, "rays.csv: x of ray 0 is 524288, beyond its 20"),
        ("rays.csv", words_of(dx=1 << 62), None, f"rays.csv: dx of ray 0 is {1 << 62}, beyond its 18"),
        ("rays.csv", words_of(dz=-(1 << 17) - 1), None, "rays.csv: dz of ray 0 is -131073, beyond its 18"),
        *(
            ("rays.csv", words_of(status=code), None, f"status of ray 0 is {code}, beyond its 3 bits; give 0 to 7")
            for code in (-1, 8)
        ),
        ("rays.mem", "12_ab // a ray\nxyz\n", "0\n", "rays.mem:2: 'xyz' is not hexadecimal; give one hexadecimal line"),
        ("rays.mem", "\n" + "f" * 40, "0\n", "rays.mem:2: exceeds the 141 bits of a ray; clear the high bits"),
        ("rays.mem", "0\n", "0\n0\n", "rays.mem: has no rays, or not as many as the input file"),
        ("rays.mem", "", "", "rays.mem: has no rays, or not as many as the input file"),
        *(("rays.csv", content, None, "rays.csv: is not text") for content in NO_TEXT),
        *(("rays.mem", content, "0\n", "rays.mem: is not text") for content in NO_TEXT),
        *(("rays.mem", "0\n", inputs, "inputs.mem: is not text") for inputs in NO_TEXT),
        ("rays.npz", arrays_of(np.zeros((3, 2)), np.zeros((2, 3))), None, "direction has shape (2, 3); give (3, 3)"),
        ("rays.npz", arrays_of(np.zeros((0, 2)), np.zeros((0, 3))), None, "contains no rays; give at least one"),
        ("rays.npz", arrays_of([[0, 0]], [[0j, 0, 0]]), None, "direction is complex128; give real"),
        ("rays.npz", arrays_of([["a", "b"]], [[0, 0, 0]]), None, "pixel is <U1; give real"),
        ("rays.npz", arrays_of(3.0, [[0, 0, 0]]), None, "pixel has shape"),
        ("rays.npz", arrays_of([[0, 0]]), None, "has no array direction; add arrays pixel and direction"),
        ("rays.npz", arrays_of([[np.nan] * 2], [[0, 0, 0]]), None, "array pixel contains NaN or infinity"),
    ],
)
def test_files_that_cannot_be_judged_are_bad_input(name, content, inputs, says, tmp_path, refusal_of):
    for path, text in ((tmp_path / name, content), (tmp_path / "inputs.mem", inputs)):
        if isinstance(text, dict):
            np.savez(path, **text)
        elif text is not None:
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert says in refusal_of("regress", "--display", SQUARE, "--rays", tmp_path / name, "--fraction-bits", "16")


@pytest.mark.parametrize("case", ["far-origins", "tangent"])
def test_rays_from_the_world_are_refused_not_judged(case, tmp_path, refusal_of):
    assert run(["vectors", "--display", HEX, "--case", case, "--count", "4", "-o", str(tmp_path / "set")]) == 0
    places = sorted((tmp_path / "set").glob("*/rays.npz"))
    assert places
    for rays in places:
        line = refusal_of("regress", "--display", rays.parent / "display.toml", "--rays", rays)
        assert f"{rays}: contains rays from the world; give rays from the panel" in line


def test_vectors_refuse_what_is_there_and_leave_nothing_half_written(tmp_path, refusal_of):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").write_text("mine")
    arguments = ["vectors", "--display", SQUARE, "--count", "2"]
    assert run([*arguments, "-o", str(tmp_path / "full")]) == 2
    assert run([*arguments, "-o", str(tmp_path / "no/where")]) == 2
    line = refusal_of(*arguments, "--case", "nosuch", "-o", tmp_path / "new")
    assert "unknown case 'nosuch'; choose from all, chief-ray" in line
    assert [path.name for path in tmp_path.iterdir()] == ["full"]

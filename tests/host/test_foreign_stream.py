"""`vectors --stream | PROGRAM | regress --stream`: a tracer in C, right and with faults, words, and bad streams."""

import itertools
import json
import os
import random
import re
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from junitparser import Error, Failure, JUnitXml
from lippmann.conformance.coverage_points import BEYOND_WORDS, POINTS, covered, points_met, summary
from lippmann.conformance.error_bounds import load_bounds
from lippmann.conformance.hard_cases import CASES
from lippmann.conformance.judge import judge
from lippmann.conformance.ray_sets import (
    OUTPUTS,
    PanelRays,
    cell_steps,
    fixed_words,
    hex_digits,
    memory_lines,
    random_aims,
    random_pixels,
    widths,
)
from lippmann.conformance.ray_stream import ANSWERED, ASKED, Stream, StreamReader, _complete_rows
from lippmann.conformance.tracer_faults import golden
from lippmann.display.description import load_display, parse_display
from lippmann.errors import InputError
from lippmann.fixed.conversion import aims_of_words, pixels_of_words
from lippmann.simulation.toolchain import repository

TOP = repository()
FOREIGN = TOP / "tests" / "foreign"
sys.path.insert(0, str(FOREIGN))
from faults import DISPLAYS, FAULTS  # noqa: E402

SOURCE = (FOREIGN / "tracer.c").read_text()
#: What a fault that rounds directions needs.
ROUNDING = "#include <math.h>\n#define B(x) (rint((x) * 16384) / 16384)\n"
LIPPMANN = [sys.executable, "-m", "lippmann"]


def compiled(folder, source=SOURCE):
    """Compile the tracer, without a warning when it is as shipped."""
    (folder / "tracer.c").write_text(source)
    checks = ["-Wall", "-Wextra", "-Werror"] if source == SOURCE else []
    subprocess.run(
        ["cc", "-O1", "-std=c11", *checks, "-o", folder / "tracer", folder / "tracer.c", "-lm"], check=True
    )  # fmt: skip
    return folder / "tracer"


@pytest.fixture(scope="module")
def tracer(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("c"))


def asked(display, case="chief-ray", random=500, model="exact", **options):
    lines = Stream(display, case, model, 0, 24, random, **options).lines("test")
    return "".join(line + "\n" for line in lines).encode()


def answered(program, questions):
    return subprocess.run([program], input=questions, stdout=subprocess.PIPE, check=True).stdout


def verdicts(answers):
    return {name: judge(foreign) for name, foreign in StreamReader(answers.splitlines(keepends=True)).sets()}


DISPLAY_TEXTS = {**DISPLAYS, "viewer": DISPLAYS["plain"].replace('plano_side = "panel"', 'plano_side = "viewer"')}


#: And a shipped one that ends and is skewed.
MEASURED = (TOP / "scenes/displays/measured-hex.toml").read_text()


@pytest.mark.parametrize("name", [*DISPLAY_TEXTS, "measured"])
def test_the_c_tracer_is_right_on_every_hard_case(name, tracer):
    display = parse_display((DISPLAY_TEXTS | {"measured": MEASURED})[name])
    found = verdicts(answered(tracer, asked(display, "all", 2000)))
    without = {"tangent", "far-origins", "tiny-values"} | (
        {"far-cells"} if display.array.plano_side == "panel" else set()
    )
    assert {one.partition("/")[0] for one in found} >= set(CASES) - without
    assert [one for one, verdict in found.items() if not verdict.right] == []


#: One fault of each step of the ray.
QUICK = ("x flipped", "lenslet off by one", "aperture halved", "wrong index", "focal length for radius", "few bits")


def mutated(*names):
    """Return display, source and words of some faults together; None when they change the same lines."""
    displays, source, words = set(), SOURCE, []
    for name in names:
        display, old, new, word = FAULTS[name]
        if old not in source:
            return None
        source = (ROUNDING if "B(" in new else "") + source.replace(old, new)
        displays.add(display)
        words.append(word)
    return (displays.pop(), source, words) if len(displays) == 1 else None


def named(name, folder):
    """Tell whether a planted fault is named."""
    display, source, (word,) = mutated(name)
    found = verdicts(answered(compiled(folder, source), asked(parse_display(DISPLAYS[display]), random=2000)))
    wrong = [verdict for verdict in found.values() if not verdict.right]
    assert wrong, f"{name}: not found"
    return any(word in str(verdict.fault) for verdict in wrong)


@pytest.mark.parametrize("name", QUICK)
def test_a_planted_fault_is_named(name, tmp_path):
    assert named(name, tmp_path)


#: Checks that a tracer may leave out: the display on which that shows, the lines, and those without the check.
LEFT_OUT = {
    "domes hit again, above": ("plain", " || meets_again(*ray, 0)", ""),
    "domes hit again, below": ("viewer", " || meets_again(*ray, 1)", ""),
    "a line beside the sphere, above": ("plain", "if (root < 0.0) return 0;", "if (root < 0.0) root = 0;"),
    "a line beside the sphere, below": ("viewer", "if (root < 0.0) return 0;", "if (root < 0.0) root = 0;"),
    "walls above": ("plain", "if (k > 0 && upward && !inside) return 0;", ""),
    "walls below": ("viewer", "if (k > 0 && !upward && inside && from > t[0] + 1e-12) return 0;", ""),
    "the array's end": ("plain", "if (status != MISSED && !is_there(cell)) status = BLOCKED;", ""),
    "total reflection": ("plain", "if (square <= 0.0) return 0;", "if (square < 0.0) square = 0;"),
}
#: Those that have a twin above the lenslet, or a shorter set.
LONG = ("domes hit again, below", "a line beside the sphere, below", "total reflection")


@pytest.mark.parametrize(
    ("name", "case"),
    [
        *((name, "losses") for name in LEFT_OUT if name not in LONG),
        # A set of its own, because the sets of all fates take ten times as long.
        ("total reflection", "total-reflection"),
        *(pytest.param(name, "losses", marks=pytest.mark.full) for name in LONG),
    ],
)
def test_a_check_that_is_left_out_is_found(name, case, tmp_path):
    """By rays beyond any rounding of the onset."""
    display, old, new = LEFT_OUT[name]
    assert old in SOURCE
    program = compiled(tmp_path, SOURCE.replace(old, new))
    found = verdicts(answered(program, asked(parse_display(DISPLAY_TEXTS[display]), case, 0)))
    wrong = [verdict for verdict in found.values() if not verdict.right]
    assert wrong
    if not name.startswith("walls"):
        assert any("wrong status code" in str(verdict.fault) or "extent" in str(verdict.fault) for verdict in wrong)


def rewritten(answers, change):
    """Return a stream whose answers, as words, are changed."""
    lines = [line if line.startswith(b"#") else b" ".join(change(line.split())) for line in answers.splitlines()]
    return b"".join(line + b"\n" for line in lines)


@pytest.mark.parametrize(
    "case", ["total-reflection", *(pytest.param(k, marks=pytest.mark.full) for k in ("fates", "cell-edges"))]
)
def test_rays_on_an_edge_are_judged_too(case, tracer):
    """They may be golden's on either side, and nothing else."""
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), case, 0))
    assert all(verdict.right for verdict in verdicts(answers).values())
    garbage = {
        "lenslet and point": lambda words: [*words[:5], b"0 77 77 9 9 0 0 0 1"],
        "status": lambda words: [*words[:5], b"1"],
        "direction": lambda words: words if len(words) < 14 else [*words[:11], b"0.6 0 0.8"],
    }
    for what, change in garbage.items():
        found = verdicts(rewritten(answers, change))
        for name, verdict in found.items():
            assert verdict.wrong > 0.3 * verdict.rays, (what, name)
        assert sum(verdict.on_edge for verdict in found.values()) > 20, what


@pytest.mark.full
def test_planted_faults_are_named(tmp_path):
    unnamed = [name for name in FAULTS if not named(name, tmp_path)]
    assert len(FAULTS) == 36
    assert unnamed == []


@pytest.mark.full  # minutes
def test_most_pairs_of_faults_are_named(tmp_path):
    able = [pair for pair in itertools.combinations(FAULTS, 2) if mutated(*pair)]
    random.Random(21).shuffle(able)
    unnamed = []
    for pair in able[:20]:
        display, source, words = mutated(*pair)
        answers = answered(compiled(tmp_path, source), asked(parse_display(DISPLAYS[display]), random=2000))
        *_, (_, foreign) = StreamReader(answers.splitlines(keepends=True)).sets()
        if not any(word in str(judge(foreign).fault) for word in words):
            unnamed.append(pair)
    assert len(unnamed) <= 5, unnamed


PUBLISHED = re.compile(r"^\| (\S+) \| `(--display .*)` \| ([0-9a-f]{64}) \|$", re.M)
SETS = {name: rest for name, *rest in PUBLISHED.findall((TOP / "docs/reference/stream.md").read_text())}
#: Another processor: neither numpy nor the C library uses what the newer ones have.
OLD_MACHINE = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
}


@pytest.mark.parametrize("name", ["square-2", "hex-2", "square-18-2", "hex-18-2"])
@pytest.mark.parametrize("environment", [{}, OLD_MACHINE], ids=["this", "old"])
def test_published_sets_have_their_hash_on_any_machine(name, environment):
    options, digest = SETS[name]
    command = [*LIPPMANN, "vectors", "--stream", "--case", "all", *options.split()]
    done = subprocess.run(command, cwd=TOP, capture_output=True, check=True, env={**os.environ, **environment})
    assert done.stdout.splitlines()[-1].split()[-1].decode() == digest, name


def in_words(questions, fraction_bits=16):
    """Answer a stream in words by the twin."""
    lines, bits = questions.decode().splitlines(), widths(OUTPUTS, fraction_bits)
    zeros = (line if line.startswith("#") else f"{line} {'0' * hex_digits(bits)}" for line in lines)
    cases = [foreign.words[0] for _, foreign in StreamReader(map(str.encode, zeros)).sets()]
    answers = iter([word for case in cases for word in memory_lines(list(case.trace()), bits)])
    return "".join(line + "\n" if line.startswith("#") else f"{line} {next(answers)}\n" for line in lines).encode()


def test_words_are_judged_bit_for_bit():
    questions = asked(parse_display(DISPLAYS["hex"]), "cell-corners", 300, fraction_bits=16)
    assert b"# register " in questions
    answers = in_words(questions)
    found = verdicts(answers)
    assert len(found) >= 3
    assert all(verdict.right for verdict in found.values())
    # The last bit of a status: the last set is wrong.
    lines = answers.splitlines(keepends=True)
    at = max(k for k, line in enumerate(lines) if not line.startswith(b"#"))
    question, answer = lines[at].rsplit(None, 1)
    lines[at] = question + f" {int(answer, 16) ^ 1:0{len(answer)}x}\n".encode()
    *right, wrong = verdicts(b"".join(lines)).values()
    assert all(verdict.right for verdict in right)
    assert (wrong.wrong, wrong.stage) == (1, "status")


def met_by(display, fraction_bits=None):
    """Return the points that the cases meet, in numbers or in words."""
    found = Counter()
    for rays in Stream(display, "all", "exact", 0, 24).sets():
        fixed, _ = fixed_words(rays, fraction_bits) if fraction_bits else (None, None)
        if fixed is not None:
            u, v, a, b = fixed.words
            there = aims_of_words(rays.display, a, b, fraction_bits)
            held = replace(rays, pixels=pixels_of_words(rays.display, u, v), aperture=there)
            found.update(covered(held, golden(held)))
        elif not fraction_bits:
            found.update(covered(rays, golden(rays)))
    return {name for name in POINTS if found[name]}


def test_the_cases_meet_every_point():
    """On each display."""
    for name, text in DISPLAY_TEXTS.items():
        assert met_by(parse_display(text)) == set(POINTS), name


def test_the_cases_meet_every_point_that_words_can_hold():
    """On domes towards the viewer all but two; with domes towards the panel, these too."""
    viewer, panel = (met_by(parse_display(DISPLAY_TEXTS[name]), 23) for name in ("plain", "viewer"))
    assert viewer == set(POINTS) - set(BEYOND_WORDS) - {"far-cell", "missed"}
    assert viewer | panel == set(POINTS) - set(BEYOND_WORDS)
    met, told = summary([dict.fromkeys(viewer, 1), dict.fromkeys(panel, 1)], words=True)
    assert told == f"coverage: {len(met)} of 25 points met"


def test_the_predicates_by_hand():
    """A pixel on a corner of four cells of 0.5 mm; the middle of one; a third on an edge.

    A random ray of a plain display is on no edge, not tiny, and not steep.
    """
    text = DISPLAYS["plain"].replace("rotation_deg = 9.0", "rotation_deg = 0.0").replace("[0.31, -0.17]", "[0.0, 0.0]")
    display = parse_display(text)  # 32 x 20 mm, pixels of 0.05 mm, so lenslets of 20 pixels
    pixels = np.array([[330.0, 210.0], [320.0, 200.0], [330.0, 203.0]])
    given = PanelRays("hand", display, pixels, np.array([[0.0, 0.0], [0.0, 0.0], [0.2, 1e-200]]))
    rays = golden(given)
    masks = {name: which.tolist() for name, which in points_met(given, rays).items()}
    assert masks["pixel-on-a-corner"] == [True, False, False]
    assert masks["pixel-on-an-edge"] == [True, False, True]
    assert masks["chief-ray"] == [True, True, False]
    assert masks["tiny-coordinate"] == [False, False, True]
    assert masks["contact"] == [False] * 3
    display, rng = parse_display(DISPLAYS["plain"]), np.random.default_rng(3)
    plain = PanelRays("plain", display, random_pixels(display, rng, 500), random_aims(display, rng, 500))
    met = {name: rays for name, rays in covered(plain, golden(plain)).items() if rays}
    assert met.keys() <= {"turned-array", "ok", "internal-reflection", "crosstalk"}
    assert met["turned-array"] == 500


BOUNDS = """
direction_urad = 5.0
point_nm = 20.0
[[step]]
array = "origin_mm"
point_nm = 400.0
[[case]]
point = "chief-ray"
direction_urad = 90.0
[[case]]
point = "turned-array"
direction_urad = 70.0
"""


def bias(words, urad, nm):
    """Turn an answer's direction by so much, and move its point along z."""
    if len(words) == 14:
        words[10] = repr(float(words[10]) + nm * 1e-6).encode()
        words[11] = repr(float(words[11]) + urad * 1e-6).encode()
    return words


@pytest.mark.parametrize(
    ("urad", "nm", "right"), [(60, 0, True), (80, 0, "chief"), (100, 0, False), (0, 300, True), (0, 500, False)]
)
def test_bounds_of_steps_and_cases(urad, nm, right, tracer, tmp_path):
    """Chief rays may be off by 90 microradians, others of a turned array by 70, exit points by 400 nm."""
    (tmp_path / "bounds.toml").write_text(BOUNDS)
    bounds = load_bounds(tmp_path / "bounds.toml")
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), random=300))
    lines = rewritten(answers, lambda words: bias(words, urad, nm)).splitlines(keepends=True)
    found = {name: judge(foreign, bounds, two_faults=False).right for name, foreign in StreamReader(lines).sets()}
    assert found == {"chief-ray": bool(right), "random/0": right is True}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("direction_urad = 0.0", "direction_urad"),
        ("colour = 1", "colour"),
        ('[[case]]\npoint = "grazing-exits"', "did you mean grazing-exit?"),
        ('[[step]]\narray = "pixel"\npoint_nm = 1.0', "array"),
        ('[[case]]\npoint = "tie"', "case[0]: the case has no bound"),
        ('[[case]]\npoint = "tie"\npoint_nm = 1.0\n' * 2, "case[1]: 'tie' has two bounds"),
    ],
)
def test_bad_bounds(text, said, tmp_path, refusal_of):
    (tmp_path / "b.toml").write_text(text)
    line = refusal_of("regress", "--stream", "--bounds", tmp_path / "b.toml")
    assert "b.toml" in line
    assert said in line
    assert "leave out --bounds" in refusal_of("regress", "--stream", "--bounds", "b.toml", "--tolerance-nm", "3")


def regressed(answers, *options):
    command = [*LIPPMANN, "regress", "--stream", *map(str, options)]
    return subprocess.run(command, input=answers, capture_output=True, check=False)


def suite_in(path):
    return next(iter(JUnitXml.fromfile(str(path))))


def test_the_pipe_of_commands(tracer, tmp_path):
    (tmp_path / "d.toml").write_text(DISPLAYS["plain"])
    vectors = [*LIPPMANN, "vectors", "--display", str(tmp_path / "d.toml"), "--stream", "--case", "cell-edges"]
    questions = subprocess.run(vectors, stdout=subprocess.PIPE, check=True).stdout
    assert questions == subprocess.run(vectors, stdout=subprocess.PIPE, check=True).stdout
    answers = answered(tracer, questions)
    done = regressed(answers, "--junit", tmp_path / "j.xml")
    assert (done.returncode, done.stderr) == (0, b"")
    coverage = r" in 2 sets: right\ncoverage: \d+ of \d+ points met; not pixel-on-a-corner, tie, "
    assert re.search(coverage, done.stdout.decode())
    suite, stream_hash = suite_in(tmp_path / "j.xml"), answers.split()[-1].decode()
    assert f"stream: {stream_hash}" in done.stdout.decode()
    properties = {one.name: one.value for one in suite.properties()}
    assert properties["hash"] == stream_hash
    assert json.loads(properties["bounds"])["point_nm"] == 50.0
    assert (suite.tests, suite.failures, suite.errors) == (2, 0, 0)
    assert {case.name for case in suite} == {"cell-edges/pixels", "cell-edges/aims"}

    source = SOURCE.replace("display.n, ", "display.n + 0.01, ").replace("1.0 / display.n", "1.0 / 1.6")
    done = regressed(answered(compiled(tmp_path, source), questions), "--junit", tmp_path / "j.xml")
    assert done.returncode == 4
    cases = list(suite_in(tmp_path / "j.xml"))
    assert all(isinstance(one, Failure) for case in cases for one in case.result)
    assert any(case.result for case in cases)

    # A program that dies in the middle: what was judged is told.
    done = regressed(answers[: answers.index(b"# set cell-edges/aims") + 60], "--junit", tmp_path / "j.xml")
    assert done.returncode == 2
    assert b" rays in 1 set: right\n" in done.stdout
    assert b"is truncated in the set cell-edges/aims" in done.stderr
    *_, last = suite_in(tmp_path / "j.xml")
    assert isinstance(last.result[0], Error)


@pytest.mark.parametrize("name", ["x flipped", pytest.param("wrong index", marks=pytest.mark.full)])
def test_a_fault_is_named_on_every_hard_case_too(name, tmp_path):
    """No set ends the judgement: also those whose numbers a wrong tracer cannot have."""
    display, source, (word,) = mutated(name)
    answers = answered(compiled(tmp_path, source), asked(parse_display(DISPLAYS[display]), "all", random=500))
    done = regressed(answers, "--json")
    assert (done.returncode, done.stderr) == (4, b"")
    found = json.loads(done.stdout)
    assert len(found["sets"]) == answers.count(b"# set ")
    assert word in found["sets"][-1]["fault"]
    assert (found["hash"], found["made"]) == (answers.split()[-1].decode(), "test")
    assert found["bounds"]["direction_urad"] == 2.0


@pytest.mark.parametrize("kept", [0, 1, 3])
def test_a_cut_stream_says_so_in_every_file(kept, tracer, tmp_path):
    """Empty; in its first set; in its third."""
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), "cell-edges", random=50))
    starts = [found.start() for found in re.finditer(rb"# set ", answers)]
    answers = answers[: answers.index(b"\n", starts[kept - 1]) + 1] if kept else b""
    as_json = ["--json"] if kept != 1 else []
    done = regressed(answers, *as_json, "--report", tmp_path / "page", "--junit", tmp_path / "j.xml")
    assert done.returncode == 2
    (line,) = done.stderr.decode().splitlines()
    assert ("is truncated" if kept else "is empty") in line
    page = (tmp_path / "page/errors.md").read_text()
    assert "**The stream ended early**" in page
    judged = max(0, kept - 1)
    assert ("**All rays are correct**, in 2 sets" if judged else "No rays were checked") in page
    assert len(list(suite_in(tmp_path / "j.xml"))) == judged + 1
    if not as_json:
        assert b"no rays were checked" in done.stdout
        return
    told = json.loads(done.stdout)
    assert (told["exit_code"], told["hash"], told["right"], len(told["sets"])) == (2, None, False, judged)
    assert told["ended"] == told["error"]
    assert told["error"] in line


def test_what_a_terminal_obeys_is_escaped_in_the_files(tracer, tmp_path):
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), random=50))
    _, first = line_of(answers, b"0 ")
    lines = answers.splitlines(keepends=True)
    lines[first] = b"\x1b[2J" + lines[first]
    done = regressed(b"".join(lines), "--junit", tmp_path / "j.xml")
    assert done.returncode == 2
    *_, last = suite_in(tmp_path / "j.xml")
    assert "\\x1b[2J0" in last.result[0].message


def test_two_faults_are_looked_for_behind_a_set_with_one(tmp_path):
    """The chief rays show one of the faults only; the search is kept for the random rays, which show both."""
    display, source, words = mutated("aperture halved", "x flipped")
    answers = answered(compiled(tmp_path, source), asked(parse_display(DISPLAYS[display]), random=500))
    found = json.loads(regressed(answers, "--json").stdout)["sets"][-1]["fault"]
    assert all(word in found for word in words)


def test_the_how_to_shows_what_the_command_prints():
    """But for the tracing: rays and sets of its command."""
    page = (TOP / "docs/how-to/regress.md").read_text()
    shown = re.search(r"^    (\d+) rays in (\d+) sets: right\n    coverage: (\d+) of (\d+) points met\n", page, re.M)
    display = load_display(TOP / "scenes/displays/paper-square.toml")
    sets = [len(one.pixels) for one in Stream(display, "all", "exact", 0, 24, 100_000).sets()]
    assert (int(shown[1]), int(shown[2])) == (sum(sets), len(sets))
    assert int(shown[3]) == int(shown[4]) == len(POINTS) == len(met_by(display))


def test_steps_between_cells():
    """Rows of hexagons lean to the right: (1, 1) is two steps away, (1, -1) one."""
    between = np.array([[1, 1], [1, -1], [2, -1], [-2, 0], [0, 0]], float)
    square, hexagons = (parse_display(DISPLAYS[name]) for name in ("plain", "hex"))
    assert cell_steps(square, between).tolist() == [1, 1, 2, 2, 0]
    assert cell_steps(hexagons, between).tolist() == [2, 1, 2, 2, 0]


def line_of(answers, start):
    lines = answers.splitlines(keepends=True)
    return lines, next(k for k, line in enumerate(lines) if line.startswith(start))


def test_bad_streams(tracer):
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), random=50))

    def said(old, new, count=1):
        assert old in answers
        with pytest.raises(InputError) as error:
            verdicts(answers.replace(old, new, count))
        assert "; " in str(error.value)
        return str(error.value)

    lines, first = line_of(answers, b"0 ")
    ray, after = lines[first], lines[first + 1]
    words = ray.split()
    assert "version 2, not 1" in said(b"stream 1", b"stream 2")
    assert "none of its " in said(b"# lippmann-stream", b"# other")
    assert f"line {first + 1}: has ray 1 where 0 is next" in said(ray + after, after + ray)
    assert f"line {first + 2}: has ray 0 where 1 is next" in said(ray, ray + ray)
    assert f"line {first + 1}: has ray 1 where 0 is next" in said(ray, b"")
    assert f"line {first + 2}: has ray none where 1 is next" in said(ray, ray + b"\n")
    last = lines[first + 47]
    assert "comes after 47 of the 48 rays of the set chief-ray" in said(last, b"")
    assert "beyond its 48" in said(last, last + last)
    changed = "questions or notes of the set chief-ray were changed"
    assert changed in said(ray, ray.replace(words[1], b"7.5", 1))
    assert changed in said(b"numbers decimal exact", b"numbers decimal thin")
    assert changed in said(b"# value gap 0.7", b"# value gap 0.8")
    assert changed in said(b"gap_mm = 0.7", b"gap_mm = 0.8")
    assert "chief-ray has no # numbers line" in said(b"# numbers decimal exact\n", b"")
    assert "begins another stream" in said(answers[-20:], answers[-20:] + answers)
    assert "ends a stream without a set" in said(answers[answers.index(b"# set") :], b"# end 0 " + b"0" * 64)
    assert "has 8 numbers after its question" in said(ray, ray.rsplit(None, 1)[0] + b"\n")
    assert "not finite" in said(ray, b" ".join([*words[:-1], b"nan"]) + b"\n")
    assert "is not a number" in said(ray, b" ".join([*words[:-1], b"x"]) + b"\n")
    assert "is not a number" in said(ray, b" ".join([*words[:-1], b"1_0"]) + b"\n")
    assert "not an integer" in said(ray, b" ".join([*words[:6], b"0.5", *words[7:]]) + b"\n")
    assert "only a status, which is not that of a lost ray" in said(ray, b" ".join(words[:6]) + b"\n")
    assert "is not text" in said(ray, b"\xff" + ray)
    assert "more than 4096 bytes" in said(ray, ray.rstrip() + b" " * 5000 + b"\n")
    assert "is not a valid # numbers line" in said(b"# numbers decimal exact", b"# numbers decimal perfect")
    assert "is not a valid # rays line" in said(b"# rays 48", b"# rays 999999999")
    assert "is not the name of a set" in said(b"# set chief-ray", b"# set \x1b[2J")
    assert "sets are missing" in said(answers[answers.index(b"# set random") : answers.index(b"# end")], b"")
    # What a simulator says before and after is passed over.
    greeting = b"Simulator 1.0, \xa9\n\n" + b"-" * 9000 + b"\n"
    assert len(verdicts(greeting + answers + b"$finish called\n")) == 2
    assert "is truncated in the set random/0, after 50 of its rays" in said(answers[answers.index(b"# end") :], b"")
    assert "gap_mm" in said(b"gap_mm = 0.7", b"gap_mm = -1.0")
    with pytest.raises(InputError, match="is empty"):
        verdicts(b"")


def test_words_that_are_too_long_and_notes_that_are_wrong():
    answers = in_words(asked(parse_display(DISPLAYS["hex"]), random=20, fraction_bits=16))
    lines, first = line_of(answers, b"3 ")
    for new, said in (
        (lines[first].rstrip() + b"0" * 40 + b"\n", "hexadecimal digits; give leading zeros too"),
        (lines[first].rstrip()[:-1] + b"\n", "hexadecimal digits; give leading zeros too"),
        (lines[first].rstrip()[:-1] + b"g\n", "hexadecimal digits"),
        (lines[first].rstrip()[:-2] + b"_0\n", "hexadecimal digits"),
        (lines[first].rsplit(None, 1)[0] + b"\n", "has 0 words after its question"),
    ):
        with pytest.raises(InputError, match=said):
            verdicts(answers.replace(lines[first], new, 1))
    with pytest.raises(InputError, match="no word length 99"):
        verdicts(answers.replace(b"words exact 16", b"words exact 99", 1))


def test_ctrl_c_keeps_the_verdicts(tracer):
    answers = answered(tracer, asked(parse_display(DISPLAYS["plain"]), random=50))
    wrong = re.sub(rb"^(0 \S+ \S+ \S+ \S+ \d) .*$", rb"\1 5 5 0 0 0 0 0 1", answers, count=1, flags=re.M)
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([*LIPPMANN, "regress", "--stream"], **pipes) as process:
        process.stdin.write(wrong[: wrong.index(b"# set random")])
        process.stdin.flush()
        assert b"1 of 48 rays wrong" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        out, said = process.communicate()
    assert process.returncode == 130
    assert b"48 rays in 1 set: 1 wrong" in out
    assert b"interrupted" in said


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("vectors --display DISPLAY --stream >&-", 3, "stdout is closed"),
        ("regress --stream <&-", 2, "stdin is closed"),
        ("vectors --display DISPLAY --stream --case tangent", 2, "has no rays from the panel"),
        ("vectors --display DISPLAY --stream --case nothing", 2, "unknown case"),
    ],
)
def test_no_stream(command, code, said):
    shell = f"{sys.executable} -m lippmann {command.replace('DISPLAY', 'scenes/displays/paper-square.toml')}"
    done = subprocess.run(["sh", "-c", shell], capture_output=True, cwd=TOP, check=False)
    assert (done.returncode, done.stdout) == (code, b"")
    assert said in done.stderr.decode()
    assert len(done.stderr.splitlines()) == 1


def test_options_that_do_not_go_together(tmp_path, refusal_of):
    display, folder = str(TOP / "scenes/displays/paper-square.toml"), str(tmp_path / "v")
    for arguments, said in (
        (["vectors", "--display", display], "no output; give a folder with -o, or --stream"),
        (["vectors", "--display", display, "--stream", "-o", folder], "leave out -o or --stream"),
        (["vectors", "--display", display, "--words", "-o", folder], "--words: needs --stream; add --stream"),
        (["regress", "--stream", "--rays", "x.npz"], "--rays: conflicts with --stream"),
        (["regress", "--stream", "--model", "exact"], "--model: conflicts with --stream"),
        (["regress", "--stream", "--fraction-bits", "18"], "--fraction-bits: conflicts with --stream"),
        (["regress", "--stream", "--report", ""], "--report': the name is empty; name a folder"),
        (["regress", "--stream", "--junit", ""], "--junit': the name is empty; name a file"),
        (["regress", "--stream", "--bounds", ""], "--bounds': the name is empty; name a file"),
        (["regress", "--rays", "x.npz"], "no rays to check; give --display and --rays, or --stream"),
        (["regress", "--stream", "--junit", str(tmp_path / "j.txt")], "j.txt"),
    ):
        assert said in refusal_of(*arguments)
    assert not Path(folder).exists()


SPELLINGS = (repr, "{:.17g}".format, "{:.25e}".format, "{:+.17g}".format, lambda x: f"{x:.17f}"[:300])


@pytest.mark.parametrize("count", [1, 200])
@pytest.mark.parametrize("spelling", range(len(SPELLINGS)))
def test_numbers_are_python_s_in_every_spelling(spelling, count):
    """With the signs of zeros."""
    random = np.random.default_rng([1126, spelling])
    columns = ASKED + ANSWERED
    values = np.frombuffer(random.bytes(8 * count * columns), np.float64)
    values = np.where(np.isfinite(values), values, -0.0).reshape(count, columns).copy()
    values[:, 0] = np.arange(count)
    values[:, ASKED : ASKED + 3] = random.integers(-5, 5, (count, 3))
    text = [[SPELLINGS[spelling](float(x)) for x in row] for row in values]
    expected = np.array([[float(word) for word in row] for row in text])
    for minus in ("-0", "-0.0", "1."):
        text[-1][-1], expected[-1, -1] = minus, float(minus)
        found = _complete_rows([f"{' '.join(row)}\n".encode() for row in text])
        np.testing.assert_array_equal(found, expected[:, 1:])
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected[:, 1:]))


@pytest.mark.parametrize("wrong", ["1,5", "[1", "null", "nan", "1e400", "0x1", "1_0", '"1"', "", "true"])
def test_what_is_no_number_is_looked_at(wrong):
    row = ["0"] * (ASKED + ANSWERED)
    assert _complete_rows([f"{' '.join(row)}\n".encode()]) is not None
    row[2] = wrong
    assert _complete_rows([f"{' '.join(row)}\n".encode()]) is None

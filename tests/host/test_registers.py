"""The registers: nothing made from their definition is stale, and RTL and host speak of the same words."""

import dataclasses
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration, configuration
from lippmann.fixed.raster import Raster
from lippmann.fixed.registers import (
    OPTICS_REGISTERS,
    Field,
    build_of,
    optics_writes,
    raster_writes,
    table_writes,
    write,
)
from lippmann.fixed.words import OFFSET_BITS, OFFSET_FRACTION, SLOPE_BITS, SLOPE_FRACTION
from lippmann.simulation.toolchain import repository
from optics_cases import display_of
from tools.generate_registers import generate

TOP = repository()


def test_what_is_committed_is_what_the_definition_gives(tmp_path):
    made = generate(TOP, tmp_path)
    assert len(made) == 13
    for path in made:
        assert (TOP / path).read_text() == (tmp_path / path).read_text(), f"{path} is stale: run make registers"
    kept = {path.name for path in (TOP / "rtl/registers").iterdir()}
    assert kept == {path.name for path in made if path.parts[0] == "rtl"} | {"lint.vlt"}


def test_missing_data_do_not_stop_the_generator(tmp_path):
    """A merge may leave the data files broken; `make registers` has to mend them."""
    shutil.copytree(TOP / "host/lippmann", tmp_path / "host/lippmann", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(TOP / "rtl", tmp_path / "rtl")
    for name in ("optics.json", "board.json"):
        (tmp_path / "host/lippmann/fixed/generated" / name).write_text("<<<<<<<")
    command = [sys.executable, "-m", "tools.generate_registers"]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONPATH": str(tmp_path / "host")})
    for name in ("optics.json", "board.json"):
        path = Path("host/lippmann/fixed/generated") / name
        assert (TOP / path).read_text() == (tmp_path / path).read_text()


@pytest.mark.parametrize(
    ("part", "instead", "message"),
    [
        ('desc = "Maximum number of further domes that a ray tries.";', "", "walk has no description"),
        ("addrmap optics_registers {", "addrmap optics_registers { nonsense;", r"registers\.rdl is invalid"),
    ],
)
def test_a_wrong_definition_is_refused(tmp_path, capsys, part, instead, message):
    text = (TOP / "rtl/registers.rdl").read_text()
    assert part in text
    (tmp_path / "rtl").mkdir()
    (tmp_path / "rtl/registers.rdl").write_text(text.replace(part, instead))
    with pytest.raises(InputError, match=message):
        generate(tmp_path, tmp_path)
    assert ("nonsense" in capsys.readouterr().err) == ("nonsense" in instead)


def package_fields():
    """Name: (bits, comment) of optics_config_t, read from the package's text."""
    text = (TOP / "rtl/optics/lipp_optics_pkg.sv").read_text()
    constants = {name: int(value) for name, value in re.findall(r"localparam int (\w+) = (\d+);", text)}
    body = re.search(r"typedef struct packed \{([^}]*)\} optics_config_t;", text).group(1)
    fields = {}
    for line in body.strip().splitlines():
        high, name, comment = re.fullmatch(r"\s*logic signed \[(.*):0\]\s+(\w+);(.*)", line).groups()
        fields[name] = (constants[high[:-2]] if high.endswith("-1") else int(high) + 1, comment)
    return fields


def optics_registers():
    """Name: (bits, fraction) of the words that the registers hold, two registers where a word needs them."""
    words = {}
    for name, register in OPTICS_REGISTERS.items():
        if not name.startswith("optics_"):
            continue
        (value,) = register.fields.values()
        base = name.removeprefix("optics_")
        if base.endswith("_low"):
            assert (value.low, value.width, value.signed) == (0, 32, False)
            words[base.removesuffix("_low")] = (32, "")
            continue
        assert value.signed
        whole = base.removesuffix("_high")
        below = words[whole][0] if base.endswith("_high") else 0
        if below:
            assert OPTICS_REGISTERS[f"optics_{whole}_low"].address == register.address - 4
        words[whole] = (below + value.width, value.fraction)
    return words


def test_registers_package_and_configuration_agree():
    package, registers = package_fields(), optics_registers()
    names = [field.name for field in dataclasses.fields(Configuration)]
    assert len(names) == 34
    assert list(package) == names
    assert list(registers) == names
    # The formats that the host's words have (lippmann.fixed.configuration).
    fraction = dict.fromkeys(names, "F")
    fraction.update(dict.fromkeys(("index_inverse", "exit_z", "cell_half"), "F + 1"), depth_rest="F + 3")
    fraction.update(dict.fromkeys(("converge_x", "converge_y"), "F + 2"), converge_share="F + 11")
    slopes = ("slope_x", "slope_y", "slope_aim_x", "slope_aim_y")
    fraction.update(dict.fromkeys(slopes, "F + E"))
    fraction.update(dict.fromkeys(("cell_half_y", "cell_rise"), "F + 1"), extent_i="", extent_j="")
    for name, (bits, text) in registers.items():
        assert package[name][0] == bits, name
        if "_from_" in name:
            assert (bits, text) == (SLOPE_BITS, str(SLOPE_FRACTION))
        elif name.endswith("_offset"):
            assert (bits, text) == (OFFSET_BITS, str(OFFSET_FRACTION))
        else:
            assert (bits, text) == (32, fraction[name]), name


def test_words_have_the_fraction_bits_that_the_registers_tell():
    f = 20
    display = display_of("hex", "viewer", pitch=0.8, radius=2.0, index=1.6, thickness=0.9, gap=1.0, offset=(0.3, -0.2))
    build = Build.of(display, "exact", f, aims=False)
    config = configuration(display, build, "exact")
    row = 0.8 * math.sqrt(0.75)
    known = {
        "x_from_u": 0.0625 / 0.8, "x_from_v": 0.0, "y_from_u": 0.0, "y_from_v": 0.0625 / row,
        "x_offset": -0.3 / 0.8, "y_offset": 0.2 / row, "slope_x": 0.8, "slope_y": row,
        "point_x": 0.0, "index": 1.6, "index_square": 2.56, "index_inverse": 0.625, "index_inverse_square": 0.390625,
        "depth": 0.55, "depth_rest": 1 - 0.55**2, "exit_z": 0.45, "cell_half": 0.2, "cell_pitch_x": 0.4,
        "cell_pitch_y": row / 2.0,
    }  # fmt: skip
    for name, (_, fraction) in optics_registers().items():
        if name in known:
            # E is 0 in this build.
            bits = sum({"F": f, "E": 0}.get(part) or int(part.replace("E", "0")) for part in fraction.split(" + "))
            value = math.ldexp(getattr(config, name), -bits)
            assert abs(value - known[name]) <= 2.0**-f, name


def test_a_configuration_is_written_and_read_back():
    names = [field.name for field in dataclasses.fields(Configuration)]
    widths = {name: bits for name, (bits, _) in optics_registers().items()}
    for sign in (1, -1):
        values = {name: sign * ((1 << (widths[name] - 2)) + 977 * k) for k, name in enumerate(names)}
        written = {w.address: w.word for w in optics_writes(Configuration(**values))}
        assert len(written) == 40
        assert all(0 <= word < 1 << 32 for word in written.values())
        for name, value in values.items():
            if widths[name] == 32:
                register = OPTICS_REGISTERS[f"optics_{name}"]
                assert register.values(written[register.address])["value"] == value
            else:
                low = written[OPTICS_REGISTERS[f"optics_{name}_low"].address]
                high = written[OPTICS_REGISTERS[f"optics_{name}_high"].address]
                assert high << 32 | low == value & ((1 << widths[name]) - 1)


def test_a_field_holds_every_value_within_its_limits():
    for field in (Field(3, 4), Field(3, 4, signed=True)):
        low, high = field.limits
        assert high - low == 15
        assert [field.value(field.bits(value)) for value in range(low, high + 1)] == list(range(low, high + 1))
        assert {field.bits(value) | field.mask for value in range(low, high + 1)} == {0b1111000}
        assert field.value(~field.mask) == 0, "bits of other fields"


def test_values_out_of_range_are_refused():
    assert write("raster_columns", first=3, last=16383).word == 3 | 16383 << 16
    assert write("raster_jitter", mode=2).word == 2 << 16 | 1, "samples keep their reset value"
    with pytest.raises(InputError, match=r"raster_columns, field first: 16384 is outside its range \[0, 16384\)"):
        write("raster_columns", first=16384)
    with pytest.raises(InputError, match="field value"):
        write("optics_depth", value=1 << 31)
    with pytest.raises(InputError, match="no field"):
        write("raster_columns", second=1)
    with pytest.raises(InputError, match=r"there is no register 'raster_colums'; see docs/generated/registers\.md"):
        write("raster_colums", first=1)
    with pytest.raises(InputError, match="do not fit"):
        table_writes([0] * 3, 62)


def test_the_most_samples_are_written_as_0():
    for samples, field in ((65536, 0), (65535, 65535), (1, 1)):
        words = dict(raster_writes(Raster(4, 3, (0, 3), (0, 2), samples, "lfsr")))
        jitter = OPTICS_REGISTERS["raster_jitter"]
        assert jitter.values(words[jitter.address]) == {"samples": field, "mode": 2, "table_first": 0}


def test_a_block_tells_its_build():
    words = {"identity": 0x4C495050, "version": 0x00030007, "build": 23 | 1 << 5 | 2 << 6 | 1 << 8 | 1 << 9 | 3 << 10}
    build = Build(23, "hex", "exact", viewer=True, aims=True, max_cell_steps=3)
    assert build_of(words) == build
    assert build_of({**words, "build": words["build"] | 1 << 13}) == dataclasses.replace(build, cross_cells=True)
    assert build_of({**words, "build": words["build"] | 1 << 14}) == dataclasses.replace(build, converge=True)
    assert build_of({**words, "build": words["build"] | 1 << 15}) == dataclasses.replace(build, shear=True)
    with pytest.raises(InputError, match="0x4C495051"):
        build_of({**words, "identity": 0x4C495051})
    for major in (0, 1, 2, 4):
        with pytest.raises(InputError, match=f"register map {major}, this host supports 3"):
            build_of({**words, "version": major << 16 | 7})
    with pytest.raises(InputError, match="field model: 3 is unknown to this host, which supports 0 to 2"):
        build_of({**words, "build": words["build"] | 3 << 6})
    with pytest.raises(InputError, match="register version, build was not read"):
        build_of({"identity": words["identity"]})

"""Every module elaborates alone without a warning, under several parameters; a bad parameter stops with its message."""

import re
import subprocess

import pytest
from click.testing import CliRunner
from lippmann.simulation.toolchain import PREFIX, needed, rtl_sources
from runner import TOP
from tools.lint import elaborated, folder_of_modules, lint, main

SOURCES = rtl_sources(TOP)
SOURCES_BY_NAME = {path.stem: path for path in SOURCES}
FOLDER_OF = folder_of_modules()
MODULES = sorted(FOLDER_OF)


def packed(*fields):
    """A word of fields (value, bits), the first one lowest, and its bits."""
    word = at = 0
    for value, bits in fields:
        assert 0 <= value < 1 << bits
        word, at = word | value << at, at + bits
    return word, at


def built(F=23, Grid=0, Model=2, Viewer=0, Aims=0, Walk=0, CrossCells=0, Converge=0, Shear=0):
    """The parameter `Build` of the pipeline and of what holds it, field by field from the lowest bit."""
    converged = ((CrossCells, 1), (Converge, 1), (Shear, 1))
    word, at = packed((F, 5), (Grid, 1), (Model, 2), (Viewer, 1), (Aims, 1), (Walk, 3), *converged)
    return {"Build": f"{at}'h{word:04x}"}


def drawn(layers=4, slots=5, width_bits=8, height=192, bilinear=0, samples_bits=0):
    """The parameter `Scene` of the drawing, field by field from the lowest bit."""
    word, at = packed((layers, 4), (slots, 4), (width_bits, 4), (height, 11), (bilinear, 1), (samples_bits, 2))
    return {"Scene": f"{at}'h{word:07x}"}


F_SETS = [{"F": f} for f in (14, 16, 18, 23)]
PRODUCTS = [
    {"Wa": a, "Wb": b, "Drop": d, "Square": s} for a, b, d, s in ((18, 18, 0, 0), (25, 25, 20, 1), (27, 25, 21, 0))
]
PANELS = [{"Width": w, "Height": h} for w, h in ((7, 5), (640, 480), (1920, 1080), (2400, 2400))]
GRID_SETS = [{"F": f, "Grid": g} for f in (14, 23) for g in (0, 1)]
SHEARED = [{**grid, "Shear": 1} for grid in GRID_SETS]
CELLS = [{"F": f, "CrossCells": 1} for f in (16, 23)]
RAYS = [
    built(F=14, Grid=1, Model=0),
    built(F=18, Grid=0, Model=1, Aims=1),
    built(F=23, Grid=0, Model=1),
    built(F=23, Grid=1, Model=2),
    built(F=16, Grid=0, Model=2, Aims=1, Walk=1),
    built(F=22, Grid=1, Model=2, Viewer=1, CrossCells=1),
    built(F=23, Grid=1, Model=0, Converge=1),
    built(F=16, Grid=0, Model=2, Viewer=1, Aims=1, Walk=1, Converge=1, CrossCells=1),
    built(F=23, Grid=1, Model=2, Walk=2, Converge=1),
    built(F=23, Grid=1, Model=0, Shear=1),
    built(F=18, Grid=1, Model=1, Aims=1, Shear=1),
    built(F=16, Grid=0, Model=2, Viewer=1, Walk=1, Converge=1, Shear=1, CrossCells=1),
    built(F=23, Grid=1, Model=2, Aims=1, Walk=2, Shear=1),
    built(F=23, Grid=1, Model=2, Viewer=1, Aims=1, Walk=2),
]
#: Timings of the SDRAM, in the order of the fields: grade -7E, and ones with a CAS latency and a tMRD.
GRADE_7E = (3, 15, 15, 37, 60, 66, 14, 2, 100, 64, 8192)


def timed(cas=3, mrd=2):
    """The parameter `Timing` of the SDRAM's controller, field by field from the highest bit."""
    fields = (cas, *GRADE_7E[1:7], mrd, *GRADE_7E[8:])
    return {"Timing": f"{16 * len(fields)}'h" + "".join(f"{field:04x}" for field in fields)}


FRAMES = [{"Width": w, "Height": h} for w, h in ((2, 1), (34, 5), (1280, 720), (1920, 1080))]
SCENES = [drawn(), drawn(1, 1, 5, 32, samples_bits=2), drawn(8, 15, 10, 254, bilinear=1, samples_bits=1)]


def share_sets(modules, sets):
    """The same sets of parameters for several modules."""
    return dict.fromkeys(modules.split(), sets)


#: Every module of rtl/common, rtl/math, rtl/optics, rtl/scene; those of other folders where their defaults are not all.
#: optics_block holds a ray_stream, and that a ray_pipeline, of the same parameters: each kind of ray is linted once.
PARAMETERS = {
    **share_sets("byte_square curve_table frame_gate mult18 sdram_arbiter", [{}]),
    **share_sets("axis_from_rays axis_to_rays exit_line lenslet_hex lenslet_square pixel_to_lattice", F_SETS),
    **share_sets("raster rsqrt", F_SETS),
    **share_sets("enter_dome enter_flat exit_dome exit_flat leave_dome leave_flat unit_slope", [*F_SETS, *CELLS]),
    **share_sets("block_store frame_check frame_store show_frame tile_table tile_writer", PANELS),
    # Parts of ray_pipeline, in which every kind of ray is linted.
    **share_sets("optics_block pixel_to_lens start_ray walk_domes", RAYS[-1:]),
    "config_range": RAYS[:1],
    **share_sets("fifo memory_1w1r", [{"Width": w, "AddressBits": b} for w, b in ((1, 2), (150, 9))]),
    **share_sets("word_join word_split", [{"Width": w, "Parts": n} for w, n in ((1, 2), (16, 3), (24, 2), (8, 5))]),
    **share_sets("axil_to_apb wishbone_to_apb", [{"AddressBits": b} for b in (3, 32)]),
    **share_sets("cut_product wide_product", PRODUCTS),
    **share_sets("pulse_sync reset_sync", [{"Stages": s} for s in (2, 4)]),
    "aim": GRID_SETS,
    "async_fifo": [{"Width": w, "AddressBits": b, "Stages": s} for w, b, s in ((1, 2, 2), (40, 9, 3))],
    "bit_sync": [{"Stages": s, "ResetValue": r} for s, r in ((2, 1), (5, 0))],
    "blend": [*F_SETS, *CELLS, {"F": 23, "Second": 0}, {"F": 14, "Wx": 18}, {"F": 23, "Wx": 27, "CrossCells": 1},
              {"F": 23, "Wx": 27, "Wa": 27}],
    "board": [
        {"ByteLink": 1, "HPositive": 0, "VPositive": 0, **built(Grid=1)},
        {**built(F=16), **drawn(2, 3, 5, 32, 1, 1)},
    ],
    "buttons_and_lamps": [{"HoldBits": 1, "IdleBits": 1}],
    "video_board": [{"Dvi": 0, **built(F=14, Model=0)}],
    "block_ring": [{"Width": w, "Cycles": c} for w, c in ((1, 5), (30, 33))],
    "config_bank": [{"Width": w} for w in (1, 1140)],
    "cell_step": [*GRID_SETS, *SHEARED, {"F": 23, "Grid": 1, "CrossCells": 1, "Shear": 1}],
    "converge": [*GRID_SETS, {"F": 23, "Grid": 1, "CrossCells": 1}],
    "delay": [
        {"Width": w, "Cycles": c, "Block": b}
        for w, c, b in ((1, 0, 1), (3, 1, 1), (8, 2, 1), (1, 5, 1), (9, 17, 1), (40, 40, 1), (40, 40, 0), (1, 18, 0))
    ],
    "dispatcher": [
        *PANELS, *({"Layers": a, "Slots": b, "Blocks": c} for a, b, c in ((1, 1, 2), (8, 15, 256)))
    ],
    "extent": [{"Grid": g} for g in (0, 1)],
    "flow_control": [{"Latency": c, "AddressBits": b, "Width": 9} for c, b in ((1, 4), (118, 7))],
    # Verilator takes a recursive top's inner instances for empty ones: the trees are seen to in `multiplier`.
    "low_product": [{"Low": n} for n in (1, 2)],
    "meet_dome": [
        {"F": f, "Upward": u, "CrossCells": c} for f, u, c in ((14, 0, 0), (16, 1, 1), (23, 1, 0), (23, 0, 1))
    ],
    "move_lenslet": [*GRID_SETS, *SHEARED],
    "small_product": [{"Wa": a, "Drop": d} for a, d in ((3, 0), (17, 8))],
    "gated_sum": [{"W": n} for n in (1, 37)],
    "digit_product": [{"W": w, "Digit": d, "Signed": s} for w in (3, 18) for d in (1, 2, 3, 4) for s in (0, 1)],
    "row_product": [{"W": w, "Low": n} for w, n in ((18, 1), (18, 4), (3, 7), (18, 10), (12, 14), (18, 16))],
    "row_multiplier": [
        {"Wa": a, "Wb": b, "Drop": d, "Square": s}
        for a, b, d, s in (
            (18, 18, 0, 0), (3, 16, 5, 0), (25, 25, 20, 1), (32, 12, 8, 0), (18, 20, 2, 0), (28, 25, 17, 0),
        )
    ],
    "layer_coordinate": [*F_SETS, {"F": 16, "Bilinear": 1}],
    "texel_memory": [{"Depth": d} for d in (2, 1024, 1536, 12288, 49152, 261120)],
    "texel_slot": [*SCENES, drawn(1, 1, 10, 255)],
    "texel_fetch": SCENES,
    "texel_blend": [{"Taps": n} for n in (1, 4)],
    "composite": [{"Layers": n} for n in (1, 2, 8)],
    "sample_mean": [{"SamplesBits": n} for n in (0, 1, 2)],
    "scene": [{"F": 23, **SCENES[1]}, {"F": 14, **SCENES[2]}],
    "multiplier": [
        {"Wa": a, "Wb": b, "Drop": d, "Square": s, "CrossCells": c}
        for a, b, d, s in (
            (18, 18, 0, 0), (12, 16, 5, 0), (25, 25, 20, 1), (27, 18, 9, 0), (18, 20, 2, 0), (27, 25, 21, 0),
        )
        for c in (0, 1)
    ],
    "packet_fifo": [{"AddressBits": b} for b in (12, 13, 14)],
    "quadratic": [{"F": f, "Root": r} for f in (14, 18, 23) for r in (0, 1)],
    "ray_stream": RAYS[-2:-1],
    "ray_pipeline": RAYS[:-2],
    "draw_frame": [{**panel, "SamplesBits": k % 3} for k, panel in enumerate(PANELS)],
    "register_access": [{"Layers": n} for n in (1, 8)],
    "register_bus": [{"Scene": 1}],
    "scene_block": [drawn(1, 1, 5, 32), drawn(8, 15, 10, 255, 0, 2)],
    "slot_loader": [{"Slots": a, "Blocks": b} for a, b in ((1, 2), (15, 256))],
    "request_reader": [*PANELS, {"Scene": 1}],
    "reply_builder": [{"HeadBytes": b} for b in (4, 5, 34)],
    "reply_writer": [{"Bytes": b} for b in (1, 2, 4, 63)],
    "ring": [{"Width": w, "Cycles": c} for w, c in ((1, 2), (30, 17), (30, 33))],
    "saturate": [{"From": a, "To": b, "Slack": c} for a, b, c in ((20, 18, 6), (18, 18, 17), (5, 1, 0))],
    "pixel_feed": [{"Pixels": n} for n in (1, 1000)],
    "scan_out": [{**panel, **grid, "ClocksPerPixel": n}
                 for panel, grid, n in zip(PANELS, GRID_SETS, (1, 2, 4, 1), strict=True)],
    "sdram_controller": [{"ClockHz": f, "PadClocks": n, **timed()} for f, n in ((50_000_000, 0), (142_857_142, 4))],
    "sdram_read_port": [{**frame, "Block": b, "AddressBits": a}
                        for frame, b, a in zip(FRAMES, (1, 96, 512, 96), (4, 5, 10, 11), strict=True)],
    "sdram_splitter": [{**frame, "Block": 96, "Budget": b, "MaxBudget": 400}
                       for frame, b in zip(FRAMES, (0, 400, 96, 1), strict=True)],
    "sdram_store": [*FRAMES, {"MemoryHz": 142_857_142, "PadClocks": 2, **timed(2, 3)}],
    "sdram_write_port": [{**frame, "Block": b, "AddressBits": a}
                         for frame, b, a in zip(FRAMES, (1, 12, 512, 96), (2, 2, 8, 9), strict=True)],
    "shear": [*F_SETS, *CELLS, {"F": 14, "Wx": 18}, {"F": 23, "Wx": 27, "CrossCells": 1}],
    "skid_buffer": [{"Width": w} for w in (1, 185)],
    "sqrt": [{"F": f, "Normalise": n} for f in (14, 23) for n in (0, 1)],
    "test_pattern": [*GRID_SETS, *F_SETS, *PANELS],
    "tmds_serialiser": [{"Channels": c} for c in (1, 4)],
}  # fmt: skip

#: Builds of the drawing that are not legal.
NO_SCENES = [
    drawn(layers=0), drawn(layers=9, slots=9), drawn(slots=3), drawn(width_bits=4), drawn(width_bits=11),
    drawn(height=0), drawn(height=1025), drawn(height=193), drawn(width_bits=10, height=256),
    drawn(width_bits=10, height=3, bilinear=1), drawn(samples_bits=3),
]  # fmt: skip

#: The rays that a board elaborates soonest, where its rays do not matter.
LIGHT = built(F=14, Model=0)


def each(modules, message, **values):
    """A row for every value of a parameter alone, in each of the modules: what it says."""
    return [
        (module, {name: value}, f"{module}: {message}")
        for module in modules.split()
        for name, several in values.items()
        for value in several
    ]


#: Limits of parameters as a message states them: "Width must be 1 or more and Cycles 5 or more", "F must be 14 to 23".
LIMITS = re.compile(r"((?:\w+(?:,? and |, ))*\w+) (?:must be )?(\d+) (?:to (\d+)\b(?! less)|or more)")


def stated_limits():
    """A row for each value just beyond a limit that a module's message states; a board's take more parameters."""
    for module, path in ((module, SOURCES_BY_NAME[f"{PREFIX}{module}"]) for module in MODULES if module != "board"):
        text = path.read_text()
        parameters = re.findall(r"^ *parameter [^=]*?(\w+) *=", text, re.M)
        for message in re.findall(r'\$fatal\(1,\s*"\w+: ([^"]+)"', text):
            for names, low, high in LIMITS.findall(message):
                values = [int(low) - 1, *([int(high) + 1] if high else [])]
                taken = [name for name in re.findall(r"\w+", names) if name in parameters]
                yield from each(module, message, **dict.fromkeys(taken, values))


#: Parameters that must stop elaboration, and the message of each: those that no number in a message tells by hand.
REFUSED = [
    # A row_product of no bits has no sum: that error comes first.
    *(row for row in stated_limits() if row[:2] != ("row_product", {"Low": 0})),
    *each("aim cell_step converge extent move_lenslet", "Grid must be GridSquare or GridHex", Grid=(-1, 2)),
    *(
        ("blend", {"F": 16, "Wx": x, "Wa": a}, "blend: Wx must be F + 2 to F + 4, and Wa F + 2 to Wx")
        for x, a in ((17, 17), (21, 18), (18, 19), (20, 17))
    ),
    *(("blend", {"F": 16, "Wy": y}, "blend: Wy must be Wk to F + 4") for y in (17, 21)),
    ("blend", {"F": 16, "Wk": 19, "Wy": 19}, "blend: Wk must be F + 2, or have extra_bits(F) more"),
    ("blend", {"F": 23, "Wk": 27, "Wy": 27}, "blend: Wk must be F + 2, or have extra_bits(F) more"),
    *(("shear", {"F": 16, "Wx": bits}, "shear: Wx must be F + 2 to F + 4") for bits in (17, 21)),
    *(
        (module, scene, f"{module}: Scene is not legal")
        for module in ("texel_slot", "texel_fetch")
        for scene in NO_SCENES[:: 1 if module == "texel_slot" else 4]
    ),
    *(("scene", scene, "scene: Scene must have 1 to 8 layers, and sizes as in") for scene in NO_SCENES[:2]),
    ("scene_block", drawn(layers=0), "scene_block: Scene must be a legal build"),
    *each("texel_blend", "Taps must be 1 or 4", Taps=(0, 2, 8)),
    *each("small_product", "Wa must be 3 to 17 and Drop 0 or 8", Drop=(-1, 7)),
    *each("row_multiplier", "Wa and Wb must be 3 to 32, and Drop less than their sum", Drop=(-1, 36)),
    *each("cut_product wide_product", "Wa and Wb must be 1 or more, 64 at most together, and", Wb=(47,), Drop=(36,)),
    *each("multiplier", "Wa and Wb must be 1 or more, and Drop less than their sum", Drop=(36,)),
    *(
        row
        for module in ("multiplier", "row_multiplier")
        for row in (
            (module, {"Wa": 20, "Wb": 19, "Drop": 9, "Square": 1}, f"{module}: Square takes words of one width"),
            (module, {"Wa": 20, "Wb": 20, "Drop": 3}, f"{module}: Drop must cut off the product of the lower parts"),
        )
    ),
    ("low_product", {"Low": 9, "Latency": 2}, "low_product: Low must be 1 to 17 and Latency no shorter than"),
    *each("sdram_splitter", "Width must be even, Width and Height 1 to 16383", Width=(7,)),
    ("sdram_splitter", {"Width": 4096, "Height": 1366}, "sdram_splitter: two frames must fit into the SDRAM's"),
    ("sdram_store", {"Width": 16382, "Height": 16383}, "sdram_splitter: two frames must fit into the SDRAM's"),
    ("sdram_store", {"Width": 641}, "sdram_splitter: Width must be even"),
    *each("sdram_splitter", "Block must be 1 to 512, and MaxBudget at least", MaxBudget=(95,), Budget=(193,)),
    ("sdram_splitter", {"Block": 513, "MaxBudget": 999}, "sdram_splitter: Block must be 1 to 512, and"),
    ("sdram_write_port", {"AddressBits": 3}, "sdram_write_port: 3 * 2^AddressBits must be Block or more"),
    *(
        ("sdram_controller", timed(*wrong), "sdram_controller: cas_clocks must be 2 or 3, and mrd_clocks 2 to 8")
        for wrong in ((1, 2), (4, 2), (3, 1), (3, 9))
    ),
    *each("sdram_controller", "ClockHz must be about 35 MHz to 400 MHz", ClockHz=(0, 1000000, 30000000, 500000000)),
    *each("flow_control", "Latency must be 1 or more, and at most 2^AddressBits - 10", Latency=(0, -1)),
    ("flow_control", {"Latency": 23, "AddressBits": 5}, "flow_control: Latency must be 1 or more, and at most 2^"),
    # Far off, where something else could fail before, or take its time.
    *each("blend lenslet_hex sqrt unit_slope", "F must be 14 to 23", F=(3,)),
    *each("block_ring", "Width must be 1 or more and Cycles 5 or more", Cycles=(1,)),
    *each("aim lenslet_hex meet_dome rsqrt quadratic", "F must be 14 to 23", F=(99,)),
    ("packet_fifo", {"AddressBits": 11}, "packet_fifo: 2^AddressBits must be MaxPacket + 4 or more"),
    ("quadratic", {"Root": 2}, "quadratic: Root must be RootReciprocal or RootSquare"),
    ("optics_block", built(F=24, Model=0), "ray_pipeline: Build.fraction_bits must be 14 to 23"),
    ("optics_block", built(F=0), "raster: F must be 14 to 23"),
    ("ray_stream", built(F=13), "ray_pipeline: Build.fraction_bits must be 14 to 23"),
    ("ray_stream", built(Model=1, Viewer=1), "ray_pipeline: Build.viewer must be 0 except for ModelExact"),
    *(
        ("ray_pipeline", build, f"ray_pipeline: Build.{message}")
        for message, builds in {
            "fraction_bits must be 14 to 23": (built(F=13, Model=0), built(F=24, Model=0)),
            "viewer must be 0 except for ModelExact": (built(Model=0, Viewer=1),),
            "model must be ModelPinhole, ModelParaxial or ModelExact": (built(Model=3),),
            "aims must be 0 for ModelPinhole, the chief ray": (built(Model=0, Aims=1),),
            "walk must be 0, or up to 4 if exact rays leave": (built(F=14, Walk=1), built(F=14, Walk=5, Aims=1)),
        }.items()
        for build in builds
    ),
    ("board", built(F=14, Model=1, Aims=1), "board: Build.aims must be 0: a board traces chief rays"),
    *(
        ("board", {**parameters, **LIGHT}, f"board: {message}")
        for message, several in {
            "Width and Height must be 1 to 16383": ({"Width": 16384}, {"Height": 0}),
            "porches must be 0 or more, and syncs and VFront 1": ({"HFront": -1}, {"VFront": 0}),
            "the panel must have fewer than 65536 tiles": ({"Width": 16383, "Height": 16383},),
            "ClockHz must be 1 or more": ({"ClockHz": -1},),
            "Scene must be a legal build or have 0 layers": (drawn(4, 3, 8, 192),),
        }.items()
        for parameters in several
    ),
    (
        "board",
        {"VSync": 1, "VBack": 0, "Width": 8, "Height": 8, "HBack": 0, **drawn(1, 1, 5, 32)},
        "board: blanking before the first pixel must last",
    ),
    ("video_board", {**drawn(samples_bits=1), **LIGHT}, "video_board: with Dvi = 1, Scene.samples_bits must be 0"),
    *each("draw_frame", "Width and Height must be 1 to", Width=(0, 16384), Height=(0, 16384)),
    *each("scan_out", "ClocksPerPixel must be a power of two", ClocksPerPixel=(0, 3)),
    *each("scan_out", "porches must be 0 or more", HFront=(-5,), HBack=(-60,), VBack=(-3,), HSync=(0,), VSync=(0,)),
    ("scan_out", {"Width": 4, "HFront": 1, "HSync": 1, "HBack": 1}, "scan_out: a line must be "),
    ("tile_writer", {"Width": 16383, "Height": 16383}, "tile_writer: the panel must have fewer than 65536 tiles"),
    ("saturate", {"From": 3, "To": 5}, "saturate: To must be 1 or more and From no less"),
    ("saturate", {"Slack": 18}, "saturate: Slack must be 0 or more and less than To"),
    *(
        ("unit_slope", {"F": f, "Extra": e}, "unit_slope: Extra must be 0 or extra_bits(F)")
        for f, e in ((16, 1), (23, 2))
    ),
]


def test_no_module_is_left_out():
    required = {module for module in MODULES if FOLDER_OF[module] in ("common", "math", "optics", "scene")}
    assert required <= set(PARAMETERS) <= set(MODULES)
    # The sources hold every refusal in so many words, and each is provoked below.
    said = {
        text for path in SOURCES for text in re.findall(r'\$fatal\(1,\s*"([^"]+)"', path.read_text())
    }  # fmt: skip
    assert said
    # Each module checks its own F and Grid, so that it names itself; these two are handed what was checked.
    for name in ("F", "Grid"):
        taking = {
            module
            for module in MODULES
            if FOLDER_OF[module] in ("math", "optics")
            and f"parameter int {name} " in SOURCES_BY_NAME[f"{PREFIX}{module}"].read_text()
        }
        refusing = {module for module, parameters, _ in REFUSED if name in parameters}
        assert taking - {"exit_dome", "exit_flat"} <= refusing
    left = {text for text in said if not any(text.startswith(PREFIX + message) for *_, message in REFUSED)}
    assert not left


def side_by_side(module, sets, folder, *options):
    """Elaborate a module with several sets of parameters at once, as instances i_0, i_1, ...; they share parts."""
    instances = [
        f"  {PREFIX}{module} #({', '.join(f'.{name}({value})' for name, value in parameters.items())}) i_{k} ();"
        for k, parameters in enumerate(sets)
    ]
    top, quiet = folder / "side_by_side.sv", folder / "quiet.vlt"
    top.write_text("\n".join(["`default_nettype none", "module side_by_side;", *instances, "endmodule", ""]))
    # Nothing is connected here.
    quiet.write_text(f'`verilator_config\nlint_off -rule PINMISSING -file "{top}"\n')
    files = [TOP / "rtl" / "registers" / "lint.vlt", quiet, *needed(f"{PREFIX}{module}", SOURCES), top]
    return elaborated("side_by_side", files, *options, parameters={}, timeout=60)


@pytest.mark.parametrize("module", PARAMETERS)
def test_lint_is_clean(module, tmp_path):
    """With the parameters that designs use; `make lint` takes the defaults."""
    done = side_by_side(module, PARAMETERS[module], tmp_path, "-Wall")
    assert done.returncode == 0, done.stderr
    assert not done.stderr.strip(), done.stderr


#: Checks of several limits in one condition: at every commit some of them, the others with the exhaustive tests. What
#: is handed on, too: optics_block's F goes through ray_stream, and tests of frames fail with a wrong Grid.
BEYOND = ({"F": 24}, {"F": 99}, {"Grid": 2}, {"Width": 16384}, {"Height": 0}, built(F=13))

#: Boards that are elaborated side by side, one for each message: Verilator gives a line's message once. The one of no
#: height, the last of its message, stops it early.
BOARDS = {message: parameters for module, parameters, message in REFUSED if module == "board"}


@pytest.mark.parametrize(
    ("module", "parameters", "message"),
    [
        pytest.param(
            *row,
            marks=pytest.mark.full if row[1] in BEYOND else (),
            id="-".join([row[0], *(f"{k}{v}" for k, v in row[1].items())]),
        )
        for row in REFUSED
        if row[1] not in BOARDS.values()
    ],
)
def test_bad_parameter_stops_elaboration(module, parameters, message):
    done = lint(module, parameters)
    assert done.returncode != 0
    assert PREFIX + message in done.stderr


def test_bad_parameters_stop_a_boards_elaboration(tmp_path):
    """Each one's message, from all boards side by side: the rays, which they share, take most of a second."""
    quiet = ("-Wno-lint", "-Wno-style", "--error-limit", "1000")
    said = side_by_side("board", BOARDS.values(), tmp_path, *quiet).stderr
    refusals = re.findall(r"^%\w+-USERFATAL: \S+ (.*)\n.* In instance 'side_by_side\.i_(\d+)'$", said, re.M)
    for k, (message, parameters) in enumerate(BOARDS.items()):
        assert any(text.startswith(PREFIX + message) and int(at) == k for text, at in refusals), f"{parameters}\n{said}"


def test_the_command_tells_of_each_module_that_is_not_clean(monkeypatch):
    """`python -m tools.lint`, which `make lint` runs; all modules themselves are seen to above."""

    def found(module):
        said = f"%Warning-WIDTH: {module}.sv" if module in ("aim", "ring") else ""
        return subprocess.CompletedProcess([], 1 if module == "ring" else 0, "", said)

    monkeypatch.setattr("tools.lint.lint", found)
    monkeypatch.setattr("tools.lint.fpga_boards", dict)
    result = CliRunner().invoke(main)
    assert result.exit_code == 1
    assert result.stderr.splitlines() == [
        "%Warning-WIDTH: aim.sv", "%Warning-WIDTH: ring.sv", "aim, ring: correct the warnings above",
    ]  # fmt: skip
    assert "-m tools.lint\n" in (TOP / "Makefile").read_text()

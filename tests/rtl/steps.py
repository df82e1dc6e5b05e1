"""The ports of every step of the ray for F fraction bits, and the bench that holds them all."""

import itertools
from collections.abc import Mapping

import pytest
from bench import Instance, Segment, stream
from lippmann.fixed.words import extra_bits

GRIDS = ("square", "hex")

#: Compiled at every commit: the widest and the compact configuration. The others cover each change of the formats:
#: the least F, words of one and of several low bits, a slope's fraction at its limit.
FRACTIONS = [pytest.param(f, marks=[] if f in (16, 23) else pytest.mark.full) for f in (14, 16, 18, 21, 22, 23)]


def steps(f: int) -> dict[str, Instance]:
    """Every step as an instance, by a short name."""
    near, point, far = f + 2, f + 3, f + 4
    lateral, axial = near + extra_bits(f), near + 3 * extra_bits(f)
    lattice, index = 12 + f, 12
    made: dict[str, Instance] = {}
    # The same words must come out of products whose cross terms are in cells.
    cells = {"CrossCells": 1} if f in (18, 22) else {}

    def add(name, module, inputs, outputs, latency, config=None, **parameters):
        latency = f"lipp_optics_pkg::{latency}" if "(" in latency else latency
        made[name] = Instance(module, inputs, outputs, latency, {"F": f, **parameters}, config or {})

    def each(names: str, bits: int) -> Mapping[str, int]:
        return dict.fromkeys(names.split(), bits)

    for root, number in (("reciprocal", 0), ("square", 1)):
        add(f"quadratic-{root}", "quadratic", {"x_i": f + 3}, {"y_o": f + 5}, "quadratic_latency()", Root=number)
    for k in range(4):
        add(f"rsqrt-{k}", "rsqrt", {"x_i": f + 3}, {"y_o": near + k}, "rsqrt_latency()", Extra=k)
    for normalise, k in itertools.product((0, 1), range(4)):
        latency = f"sqrt_latency(1'b{normalise})"
        add(
            f"sqrt-{normalise}-{k}", "sqrt", {"x_i": f + 3}, {"y_o": near + k}, latency, Normalise=normalise, Extra=k,
        )  # fmt: skip
    add(
        "pixel_to_lattice", "pixel_to_lattice", each("u_i v_i", 18), {**each("x_o y_o", lattice), "beyond_o": 1},
        "pixel_latency()",
        {**each("x_from_u_i x_from_v_i", 35), "x_offset_i": 52, **each("y_from_u_i y_from_v_i", 35), "y_offset_i": 52},
    )  # fmt: skip
    for grid in GRIDS:
        number = GRIDS.index(grid)
        local = {**each("i_o j_o", index), **each("x_o y_o", near)}
        add(
            f"lenslet_{grid}", f"lenslet_{grid}", each("x_i y_i", lattice), {**local, "beyond_o": 1},
            f"lenslet_latency({number})",
        )  # fmt: skip
        add(
            f"aim-{grid}", "aim", {**each("i_i j_i", index), **each("x_i y_i a_i b_i", near)},
            {**local, **each("a_o b_o", near), **each("stray_o beyond_o", 1)}, f"aim_latency({number})", Grid=number,
        )  # fmt: skip
        add(
            f"converge-{grid}", "converge", {**each("i_i j_i", index), **each("x_i y_i", near)},
            {**each("x_o y_o", far), "beyond_o": 1}, f"converge_latency({f})",
            each("share_i offset_x_i offset_y_i", f + 9), Grid=number, **cells,
        )  # fmt: skip
        for shear, of in ((0, grid), (1, f"{grid}-sheared")):
            add(
                f"cell_step-{of}", "cell_step", each("nx_i ny_i", near), {**each("di_o dj_o", 2), "inside_o": 1},
                f"cell_step_latency({number}, {f}, 1'b{shear})",
                {**each("half_i half_y_i shear_i", near), "rise_i": far}, Grid=number, Shear=shear, **cells,
            )  # fmt: skip
            add(
                f"move_lenslet-{of}", "move_lenslet", {**each("hx_i hy_i", point), **each("di_i dj_i", 2)},
                {**each("hx_o hy_o", point), "beyond_o": 1}, "2", each("cx_i cy_i rx_i", near), Grid=number,
                Shear=shear,
            )  # fmt: skip
    for second in (0, 1):
        add(
            f"blend-{second}", "blend", each("x_i a_i", near), {"y_o": near, "beyond_o": 1},
            f"blend_latency({f}, {near})", each("k_i l_i", near), Second=second, **cells,
        )  # fmt: skip
        add(
            f"blend-{second}-far", "blend", {"x_i": far, "a_i": near}, {"y_o": point, "beyond_o": 1},
            f"blend_latency({f}, {far})", each("k_i l_i", near), Second=second, Wx=far, Wy=point, **cells,
        )  # fmt: skip
    add(
        "blend-1-upright", "blend", each("x_i a_i", far), {"y_o": point, "beyond_o": 1}, f"blend_latency({f}, {far})",
        each("k_i l_i", near), Second=1, Wx=far, Wa=far, Wy=point, **cells,
    )  # fmt: skip
    for name, bits in (("shear", near), ("shear-far", far)):
        add(
            name, "shear", each("x_i y_i", bits), {"x_o": far, "beyond_o": 1}, f"shear_latency({f})",
            {"g_i": far}, Wx=bits, **cells,
        )  # fmt: skip
    for k in {0, extra_bits(f)}:
        for second in (0, 1):
            add(
                f"blend-{second}-slope-{k}", "blend", each("x_i a_i", far), {"y_o": near + k, "beyond_o": 1},
                f"blend_latency({f}, {far})", each("k_i l_i", near + k), Second=second, Wx=far, Wa=far, Wk=near + k,
                **cells,
            )  # fmt: skip
        add(
            f"unit_slope-{k}", "unit_slope", each("mx_i my_i", near + k),
            {**each("ex_o ey_o ez_o", near + k), "beyond_o": 1}, f"unit_latency({f})", Extra=k, **cells,
        )  # fmt: skip
    add(
        "enter_flat", "enter_flat", each("ex_i ey_i", lateral),
        {**each("tx_o ty_o", lateral), "dz_o": axial, "beyond_o": 1},
        f"enter_flat_latency({f})", {"index_inverse_i": near}, **cells,
    )  # fmt: skip
    for upward in (0, 1):
        add(
            f"meet_dome-{upward}", "meet_dome",
            {**each("hx_i hy_i", point), **each("dx_i dy_i", lateral), "dz_i": axial},
            {**each("nx_o ny_o nz_o cos_o", near), "s_o": far, **each("missed_o beyond_o", 1)},
            f"meet_dome_latency({f})", {"zc_i": far, "oz_i": f + 9}, Upward=upward, **cells,
        )  # fmt: skip
    add(
        "leave_dome", "leave_dome",
        {**each("nx_i ny_i nz_i cos_i", near), **each("ex_i ey_i", lateral), "dz_i": axial, "s_i": far},
        {**each("dx_o dy_o dz_o", near), **each("reflected_o beyond_o", 1)}, f"dome_latency({f})",
        {"index_i": point, "index_square_i": far}, **cells,
    )  # fmt: skip
    add(
        "enter_dome", "enter_dome", {**each("nx_i ny_i cos_i ex_i ey_i", near), "s_i": far},
        {**each("dx_o dy_o", near), "beyond_o": 1}, f"dome_latency({f})",
        {"index_inverse_i": near, "index_inverse_square_i": far}, **cells,
    )  # fmt: skip
    add(
        "leave_flat", "leave_flat", each("nx_i ny_i nz_i dx_i dy_i", near),
        {**each("x_o y_o", far), **each("dx_o dy_o dz_o", near), **each("reflected_o beyond_o", 1)},
        f"leave_flat_latency({f})",
        {"zc_i": far, "index_i": point, "index_square_i": far}, **cells,
    )  # fmt: skip
    return made


def stream_step(name: str, f: int, segments: list[Segment], seed: int) -> None:
    """Stream words through one step's RTL and compare all that comes out."""
    made = steps(f)
    stream(list(made.values()), [(made[name], segment) for segment in segments], f"steps-F{f}", seed)

"""Faults for the foreign design: each one wrong place of pinhole.sv, or of what stream_bench.sv configures it with.

`DESIGN_FAULTS` gives for each the edits (old text, new text), a regular expression of all that `lippmann regress` must
say is the fault, and where it shows: the display, of `DESIGN_DISPLAYS`, and the options of `lippmann vectors`. The last
set that is wrong counts: random rays, unless only the case's rays show the fault.
"""

from typing import NamedTuple

from faults import DISPLAYS


class DesignFault(NamedTuple):
    """A fault of the design, and what must be said of it."""

    edits: tuple[tuple[str, str], ...]
    said: str
    display: str = "plain"
    case: str = "chief-ray"


DESIGN_DISPLAYS = {
    "plain": DISPLAYS["plain"],
    "straight": DISPLAYS["plain"].replace("rotation_deg = 9.0", "rotation_deg = 0.0"),
    "deep": DISPLAYS["plain"].replace("gap_mm = 0.7", "gap_mm = 1.1"),
}

U, V = "wide_t'(u_i)", "wide_t'(v_i)"
X_OF, Y_OF = (f"{U} * wide_t'({axis}_from_u_i) + {V} * wide_t'({axis}_from_v_i)" for axis in "xy")
X_SWAPPED, Y_SWAPPED = (f"{V} * wide_t'({axis}_from_u_i) + {U} * wide_t'({axis}_from_v_i)" for axis in "xy")
I_OF, J_OF = "16'((x + Half) >>> 60)", "16'((y + Half) >>> 60)"
SLOPE_X, SLOPE_Y = "-(at_x * wide_t'(pitch_x_i)) >>> 50", "-(at_y * wide_t'(pitch_y_i)) >>> 50"
DX, DY = "(slope_x_q2 <<< Places) / length_q", "(slope_y_q2 <<< Places) / length_q"
DZ = "(128'sd1 <<< (50 + Places)) / length_q"
LENSLET = "{i_o, j_o} <= {i_q2, j_q2};"
DECLARED = "  wide_t length_q;\n"

#: One more register behind each output; the first two edits, behind the direction's x.
LATE = (
    (DECLARED, DECLARED + "  logic signed [Places+1:0] dx_r, dy_r, dz_r;\n  logic signed [15:0] i_r, j_r;\n"),
    ("dx_o <=", "dx_o <= dx_r;\n    dx_r <="),
    ("dy_o <=", "dy_o <= dy_r;\n    dy_r <="),
    ("dz_o <=", "dz_o <= dz_r;\n    dz_r <="),
    (LENSLET, "{i_o, j_o} <= {i_r, j_r};\n    {i_r, j_r} <= {i_q2, j_q2};"),
)
#: The slopes' scale, pitch / D, reaches the design 20 clocks late.
STALE = (
    (
        "  wide_t slope_x, slope_y,",
        "  logic signed [63:0] pitch_x_q[20], pitch_y_q[20];\n"
        "  always_ff @(posedge clk_i) begin\n    pitch_x_q[0] <= pitch_x_i;\n    pitch_y_q[0] <= pitch_y_i;\n"
        "    for (int k = 1; k < 20; k++) begin\n      pitch_x_q[k] <= pitch_x_q[k-1];\n"
        "      pitch_y_q[k] <= pitch_y_q[k-1];\n    end\n  end\n  wide_t slope_x, slope_y,",
    ),
    ("wide_t'(pitch_x_i)", "wide_t'(pitch_x_q[19])"),
    ("wide_t'(pitch_y_i)", "wide_t'(pitch_y_q[19])"),
)
#: Wrong distances D = gap + thickness / index: 128 / 127 of D; that of the index 1.4585; the focal length 1.2 / 0.52,
#: which is D of the set before. Chief rays do not tell which of D's three numbers is wrong.
DEPTH = r"gap_mm is 0\.71328\d for 0\.7|array\.thickness_mm is 1\.52019 for 1\.5|array\.index is 1\.4998\d for 1\.52"
GLASS = r"gap_mm is 0\.74161\d for 0\.7|array\.thickness_mm is 1\.56325 for 1\.5|array\.index is 1\.4585 for 1\.52"
BEFORE = r"gap_mm is 1\.3208\d for 1\.1|array\.thickness_mm is 1\.8356\d for 1\.5|array\.index is 1\.2420\d for 1\.52"

DESIGN_FAULTS = {
    "column and row swapped": DesignFault(((X_OF, X_SWAPPED), (Y_OF, Y_SWAPPED)), "column and row swapped"),
    "rows from the bottom": DesignFault(
        ((V, f"((128'sd400 <<< 20) - {V})"),), r"rows counted from the bottom \(y flipped\)"
    ),
    "half a pixel": DesignFault(
        ((U, f"({U} - (128'sd1 <<< 19))"), (V, f"({V} - (128'sd1 <<< 19))")),
        r"pixel's corner for its centre \(half a pixel\)",
    ),
    "whole pixels": DesignFault(
        ((U, f"({U} >>> 20 <<< 20)"), (V, f"({V} >>> 20 <<< 20)")), r"pixel coordinates rounded down.*"
    ),
    "lenslet one to the right": DesignFault(
        ((LENSLET, "{i_o, j_o} <= {i_q2 + 16'sd1, j_q2};"),), r"lenslet off by one: \(\+1, \+0\)"
    ),
    "lenslet one to the left": DesignFault(
        ((LENSLET, "{i_o, j_o} <= {i_q2 - 16'sd1, j_q2};"),), r"lenslet off by one: \(-1, \+0\)"
    ),
    "lenslet one up": DesignFault(
        ((LENSLET, "{i_o, j_o} <= {i_q2, j_q2 + 16'sd1};"),), r"lenslet off by one: \(\+0, \+1\)"
    ),
    "lenslet one down": DesignFault(
        ((LENSLET, "{i_o, j_o} <= {i_q2, j_q2 - 16'sd1};"),), r"lenslet off by one: \(\+0, -1\)"
    ),
    "neighbour's lenslet": DesignFault(((I_OF, f"{I_OF} + 16'sd1"),), r"neighbour's lenslet traced: \(\+1, \+0\)"),
    "lenslet rounded down": DesignFault(((I_OF, "16'(x >>> 60)"), (J_OF, "16'(y >>> 60)")), r"lenslet rounded down.*"),
    "tie rule": DesignFault(
        ((I_OF, "16'((x + Half - 128'sd1) >>> 60)"), (J_OF, "16'((y + Half - 128'sd1) >>> 60)")),
        r"cells closed on their other side \(tie rule\).*",
        case="cell-ties",
    ),
    "lenslet's axes swapped": DesignFault(((LENSLET, "{i_o, j_o} <= {j_q2, i_q2};"),), r"lenslet's axes swapped.*"),
    "slopes' sign": DesignFault(((SLOPE_X, SLOPE_X[1:]), (SLOPE_Y, SLOPE_Y[1:])), r"sign of the direction's x and y"),
    "x's slope's sign": DesignFault(((SLOPE_X, SLOPE_X[1:]),), r"sign of the direction's x\b(?! and y).*"),
    "a root of few steps": DesignFault(
        (("k >= 0", "k >= 34"),), r"direction not normalised: it is right but for its length"
    ),
    "wrong constant": DesignFault(
        (
            ("wide_t'(pitch_x_i)", "(wide_t'(pitch_x_i) - wide_t'(pitch_x_i >>> 7))"),
            ("wide_t'(pitch_y_i)", "(wide_t'(pitch_y_i) - wide_t'(pitch_y_i >>> 7))"),
        ),
        DEPTH,
    ),
    "wrong shift": DesignFault(
        ((SLOPE_X, SLOPE_X.replace("50", "49")), (SLOPE_Y, SLOPE_Y.replace("50", "49"))),
        r".*\bslopes?\b.*\b(doubled|twice|times 2)\b.*",
    ),
    "a constant added": DesignFault(
        ((DX, f"{DX} + 128'sd65536"),), r"a constant added to the direction: \+6\.03e-05 in x, \+9\.55e-06 in y"
    ),
    "short words": DesignFault(
        tuple((one, f"({one}) >>> 16 <<< 16") for one in (DX, DY, DZ)),
        r"direction truncated to 14 bits of fraction",
        "straight",
    ),
    "a stuck bit": DesignFault(
        ((DX, f"(({DX}) & ~(128'sd1 <<< 20))"),), r".*\bbit\b.*direction's x.*stuck at 0.*", "straight"
    ),
    "wrap for saturation": DesignFault(
        ((DZ, f"signed'((Places + 1)'({DZ}))"),),
        r"a component of the direction wrapped where it should saturate at 1",
        case="cell-ties",
    ),
    "outputs late": DesignFault(LATE, r"outputs late by 1: ray k has the values of ray k -1"),
    "lenslet early": DesignFault(
        ((LENSLET, "{i_o, j_o} <= {i_q, j_q};"),), r"(outputs|lenslet.*) early by 1: ray k has the values of ray k \+1"
    ),
    "direction's x late": DesignFault(LATE[:2], r".*direction's x\b(?! and y).* late by 1\b.*"),
    "stale register": DesignFault(
        STALE, rf"stale register: rays 0 to 19 are of an earlier configuration \(({BEFORE})\)", "deep", "gaps"
    ),
    # ---- of the bench ----
    "wrong status": DesignFault((("%s 0 %0d", "%s 4 %0d"),), r"wrong status code: 4 for 0 \(2000 rays\)"),
    "offset missing": DesignFault(
        (("offset_x = text.atoreal()", "offset_x = 0.0"), ("offset_y = text.atoreal()", "offset_y = 0.0")),
        r"offset_mm left out",
    ),
    "offset's axes swapped": DesignFault(
        (
            ('"offset_x": offset_x =', '"offset_x": offset_o ='),
            ('"offset_y": offset_y =', '"offset_y": offset_x ='),
            ("offset_o", "offset_y"),
        ),
        r"axes of offset_mm swapped",
    ),
    "rotation's sense": DesignFault((("turn = text.atoreal()", "turn = -text.atoreal()"),), r"sign of rotation_deg"),
    "wrong index": DesignFault((("index = text.atoreal()", "index = 1.4585"),), GLASS),
}

"""The bench of the parts that steps are made of, under many parameters."""

from bench import Instance, Segment, stream

#: Widths of both operands, places dropped, square: one low part, none, both, of one to nine bits; 16 and 23 fraction
#: bits' own products among them.
MULTIPLIERS = [
    (18, 18, 0, 0), (18, 18, 0, 1), (16, 12, 3, 0), (12, 18, 15, 0), (18, 18, 13, 1), (19, 18, 1, 0), (18, 19, 1, 0),
    (19, 19, 2, 0), (19, 19, 2, 1), (20, 21, 13, 0), (23, 18, 5, 0), (18, 23, 7, 0), (22, 22, 17, 1), (25, 25, 20, 0),
    (25, 25, 20, 1), (27, 25, 21, 0), (27, 27, 20, 1), (26, 26, 20, 1), (27, 27, 23, 0),
]  # fmt: skip
#: Widths of a and places dropped.
SMALL_PRODUCTS = [(17, 8), (17, 0), (16, 8), (9, 0), (3, 0), (3, 8)]
#: Multipliers that are made of rows, and those of words that only they take.
ROW_MULTIPLIERS = [p for p in MULTIPLIERS if min(p[:2]) >= 3]
ROW_MULTIPLIERS += [(28, 25, 17, 0), (32, 12, 8, 0), (32, 12, 15, 0), (12, 32, 8, 0), (32, 32, 28, 0), (32, 32, 32, 1)]
ROW_MULTIPLIERS += [(30, 21, 15, 0), (3, 3, 0, 0), (3, 32, 0, 0)]
#: Bits of the signed and of the unsigned word.
ROW_PRODUCTS = [(18, low) for low in range(1, 17)] + [(3, 5), (12, 14)]
#: Bits of the word, of the digit, signed.
DIGIT_PRODUCTS = [(w, digit, signed) for w in (3, 18) for digit in (1, 2, 3, 4) for signed in (0, 1)]
DELAYS = [(w, c) for c in (0, 1, 2, 3, 4, 16, 17, 18, 19, 20, 34, 35, 40) for w in (1, 7, 65)]
RINGS = [(9, c) for c in (2, 3, 4, 5, 8, 9, 10, 16, 17)] + [(1, 3), (70, 17)]
SATURATES = [(20, 18, 6), (19, 18, 17), (18, 18, 6), (36, 5, 2), (5, 1, 0), (3, 2, 0), (29, 25, 6)]


def multiplier(wa: int, wb: int, drop: int, square: int, cells: int) -> Instance:
    return Instance(
        "multiplier", {"a_i": wa, "b_i": wb}, {"p_o": wa + wb - drop}, f"lipp_math_pkg::mul_latency({wa}, {wb})",
        {"Wa": wa, "Wb": wb, "Drop": drop, "Square": square, "CrossCells": cells},
    )  # fmt: skip


def delay(module: str, width: int, cycles: int) -> Instance:
    return Instance(module, {"d_i": width}, {"q_o": width}, str(cycles), {"Width": width, "Cycles": cycles})


def rings(width: int, cycles: int) -> Instance:
    """A delay without block memory."""
    parameters = {"Width": width, "Cycles": cycles, "Block": 0}
    return Instance("delay", {"d_i": width}, {"q_o": width}, str(cycles), parameters)


def small_product(wa: int, drop: int) -> Instance:
    latency = "lipp_math_pkg::small_latency()"
    return Instance("small_product", {"a_i": wa, "b_i": 9}, {"p_o": wa + 9 - drop}, latency, {"Wa": wa, "Drop": drop})


def row_multiplier(wa: int, wb: int, drop: int, square: int) -> Instance:
    return Instance(
        "row_multiplier", {"a_i": wa, "b_i": wb}, {"p_o": wa + wb - drop}, f"lipp_math_pkg::row_latency({wa}, {wb})",
        {"Wa": wa, "Wb": wb, "Drop": drop, "Square": square},
    )  # fmt: skip


def row_product(w: int, low: int) -> Instance:
    return Instance("row_product", {"a_i": w, "low_i": low}, {"p_o": w + low}, "2", {"W": w, "Low": low})


def digit_product(w: int, digit: int, signed: int) -> Instance:
    parameters = {"W": w, "Digit": digit, "Signed": signed}
    return Instance("digit_product", {"a_i": w, "d_i": digit}, {"p_o": w + digit}, "0", parameters, clocked=False)


def saturate(width: int, to: int, slack: int) -> Instance:
    parameters = {"From": width, "To": to, "Slack": slack}
    return Instance("saturate", {"d_i": width}, {"q_o": to, "beyond_o": 1}, "1", parameters)


PARTS = [
    *(multiplier(*p, cells) for p in MULTIPLIERS for cells in (0, 1)),
    *(delay("delay", *p) for p in DELAYS),
    *(rings(w, c) for w, c in DELAYS if w != 1),
    *(small_product(*p) for p in SMALL_PRODUCTS),
    *(row_multiplier(*p) for p in ROW_MULTIPLIERS),
    *(row_product(*p) for p in ROW_PRODUCTS),
    *(digit_product(*p) for p in DIGIT_PRODUCTS),
    *(delay("ring", *p) for p in RINGS),
    *(saturate(*p) for p in SATURATES),
]


def stream_parts(batch: list[tuple[Instance, Segment]], seed: int) -> None:
    """Stream words through several of the parts, one after the other."""
    stream(PARTS, batch, "parts", seed)

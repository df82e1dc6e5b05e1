"""A receiver of DVI: symbols of ten bits, bit 0 first on the wire, back to bytes and control bits."""

#: Symbols without a pixel; they have more changes than any with one.
CONTROLS = {0x354: 256, 0x0AB: 257, 0x154: 258, 0x2AB: 259}


def decoded(symbol):
    """The byte of a symbol, or 256 and its two control bits."""
    if symbol in CONTROLS:
        return CONTROLS[symbol]
    bits = symbol & 0xFF
    if symbol & 0x200:
        bits ^= 0xFF
    differences = bits ^ (bits << 1 & 0xFF)
    if not symbol & 0x100:
        differences ^= 0xFE  # all but the first, which has none before it
    return differences

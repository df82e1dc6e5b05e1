"""DVI's symbols of ten bits, bit 0 first on the wire: to bytes and control bits, and from bytes."""

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


def by_the_flow_chart(byte, count):
    """The symbol and the next count of figure 3-5 of the standard; bit 0 of the symbol first in the list."""
    d = [byte >> k & 1 for k in range(8)]
    xnor = sum(d) > 4 or (sum(d) == 4 and d[0] == 0)
    q = [d[0]]
    for k in range(1, 8):
        q.append(1 - (q[-1] ^ d[k]) if xnor else q[-1] ^ d[k])
    q.append(0 if xnor else 1)
    ones, zeros = sum(q[:8]), 8 - sum(q[:8])
    flipped = [1 - bit for bit in q[:8]]
    if count == 0 or ones == zeros:
        out = (q[:8] if q[8] else flipped) + [q[8], 1 - q[8]]
        count += ones - zeros if q[8] else zeros - ones
    elif (count > 0 and ones > zeros) or (count < 0 and zeros > ones):
        out = [*flipped, q[8], 1]
        count += 2 * q[8] + zeros - ones
    else:
        out = [*q[:8], q[8], 0]
        count += -2 * (1 - q[8]) + ones - zeros
    return sum(bit << k for k, bit in enumerate(out)), count

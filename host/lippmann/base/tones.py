"""The measured curve between panel value and light: a table in a display file or in an image's metadata."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lippmann.errors import InputError

#: Pairs (panel value, light), both rising from 0 to 1; straight lines run between them.
Curve = tuple[tuple[float, float], ...]
#: A curve's name, a measured curve, or the text of a measured curve in an image's metadata.
Transfer = str | Curve

#: Most pairs of a curve: one for each level of 12 bits.
MAX_PAIRS = 4096


def curve_of(transfer: Transfer) -> npt.NDArray[np.float64] | None:
    """Return a measured curve, or its text, as an array (pairs, 2) of panel value and light; None for a name.

    Raises InputError when the text or the pairs are not a curve.
    """
    if not isinstance(transfer, str):
        return checked(transfer)
    if not transfer.startswith("["):
        return None
    try:
        return checked(json.loads(transfer))
    except (ValueError, RecursionError):
        raise InputError(f"transfer '{transfer[:20]}...' is not a curve of pairs; render the image again") from None


def checked(pairs: Sequence[Sequence[float]]) -> npt.NDArray[np.float64]:
    """Return the pairs of a curve as an array; raise InputError, with the remedy, when they do not rise from 0 to 1."""
    remedy = "give [panel value, light] pairs that rise from [0, 0] to [1, 1]"
    try:
        curve = np.array(pairs, np.float64)
    except (TypeError, ValueError):
        curve = np.empty(0)
    if curve.ndim != 2 or curve.shape[1] != 2 or not 2 <= len(curve) <= MAX_PAIRS:
        raise InputError(f"is not a curve of 2 to {MAX_PAIRS} pairs; {remedy}")
    # Written as not greater, so that NaN fails too.
    falls = np.flatnonzero(~(np.diff(curve, axis=0) > 0.0).all(axis=1))
    if len(falls):
        before, after = curve[falls[0]].tolist(), curve[falls[0] + 1].tolist()
        if (np.diff(curve, axis=0) < 0.0).all():
            remedy = f"turn the list round: {remedy}"
        raise InputError(f"the curve is not monotonic: {after} follows {before}; {remedy}")
    value, light = curve[0].tolist()
    if value or light:
        mend = f"begin with the panel value 0, not {value:g}" if value else f"subtract {light:g}, the light of black"
        raise InputError(f"the curve starts at {[value, light]}, not at [0, 0]; {mend}, and {remedy}")
    value, light = curve[-1].tolist()
    if [value, light] != [1.0, 1.0]:
        mend = f"divide the panel values by {value:g} and the light by {light:g}"
        raise InputError(f"the curve ends at {[value, light]}, not at [1, 1]; {mend}, and {remedy}")
    return curve


def transfer_text(transfer: Transfer) -> str:
    """Return a transfer curve as text for an image's metadata: its name, or its numbers."""
    return transfer if isinstance(transfer, str) else json.dumps(transfer)


def transfer_name(transfer: Transfer) -> str:
    """Return a transfer curve's name for messages. A measured curve's has its length and a checksum of its numbers."""
    text = transfer_text(transfer)
    if not text.startswith("["):
        return text
    return f"a curve of {text.count('[') - 1} points ({zlib.crc32(text.encode()):08x})"

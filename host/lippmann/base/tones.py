"""Converts linear light to quantised panel values and back by transfer curves."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.errors import InputError

Numbers = npt.NDArray[Any]
#: A measured, piecewise linear curve: pairs (panel value, light), rising from 0 to 1.
Curve = tuple[tuple[float, float], ...]
#: A transfer curve: a name, a measured curve, or a measured curve as metadata text.
Transfer = str | Curve

#: Rows in a band of an image file: a multiple of an EXR block's height, 16.
BAND_ROWS = 64
#: Maximum pairs in a measured curve: one for each level of 12 bits.
MAX_PAIRS = 4096


def curve_of(transfer: Transfer) -> npt.NDArray[np.float64] | None:
    """Return a measured curve as an array (pairs, 2), or None for a named curve.

    Raises InputError for an invalid curve.
    """
    if not isinstance(transfer, str):
        return _check_curve(transfer)
    if not transfer.startswith("["):
        if transfer not in ("srgb", "gamma2.2", "linear"):
            raise InputError(f"unknown transfer '{transfer}'; choose from srgb, gamma2.2, linear")
        return None
    try:
        return _check_curve(json.loads(transfer))
    except (ValueError, RecursionError):
        raise InputError(f"the transfer '{transfer[:20]}...' is not a list of pairs; render the image again") from None


def _check_curve(pairs: Sequence[Sequence[float]]) -> npt.NDArray[np.float64]:
    remedy = "give [panel value, light] pairs that rise from [0, 0] to [1, 1]"
    try:
        curve = np.array(pairs, np.float64)
    except (TypeError, ValueError):
        curve = np.empty(0)
    if curve.ndim != 2 or curve.shape[1] != 2 or not 2 <= len(curve) <= MAX_PAIRS:
        raise InputError(f"is not a curve of 2 to {MAX_PAIRS} pairs; {remedy}")
    # The negated comparison also finds NaN.
    falls = np.flatnonzero(~(np.diff(curve, axis=0) > 0.0).all(axis=1))
    if len(falls):
        before, after = curve[falls[0]].tolist(), curve[falls[0] + 1].tolist()
        if (np.diff(curve, axis=0) < 0.0).all():
            remedy = f"reverse the list: {remedy}"
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
    """Return a transfer curve as metadata text: name or numbers."""
    return transfer if isinstance(transfer, str) else json.dumps(transfer)


def transfer_name(transfer: Transfer) -> str:
    """Describe a transfer curve in messages by its name, or by length and checksum."""
    text = transfer_text(transfer)
    if not text.startswith("["):
        return text
    return f"a curve of {text.count('[') - 1} points ({zlib.crc32(text.encode()):08x})"


def encode(linear: Numbers, transfer: Transfer) -> npt.NDArray[np.float32]:
    """Convert linear light to panel values in [0, 1].

    `transfer` is "srgb" (IEC 61966-2-1), "gamma2.2", "linear" or a measured curve.
    """
    light = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    values: Numbers
    if (measured := curve_of(transfer)) is not None:
        values = np.interp(light, measured[:, 1], measured[:, 0])
    elif transfer == "srgb":
        values = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    else:
        values = light if transfer == "linear" else light ** (1.0 / 2.2)
    return values.astype(np.float32, copy=False)


def decode(values: Numbers, transfer: Transfer) -> npt.NDArray[np.float32]:
    """Convert panel values in [0, 1] to linear light, the inverse of `encode`."""
    v, light = np.asarray(values, np.float32), values
    if (measured := curve_of(transfer)) is not None:
        light = np.interp(v, measured[:, 0], measured[:, 1])
    elif transfer == "srgb":
        light = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    else:
        light = v if transfer == "linear" else v**2.2
    return light.astype(np.float32, copy=False)


def encoded_values(radiance: Numbers, transfer: Transfer, bits: int) -> npt.NDArray[np.unsignedinteger[Any]]:
    """Encode linear radiance; quantise it to 2^bits levels in the full range of uint8, or uint16 above 8 bits."""
    levels = (1 << bits) - 1
    kind = np.uint8 if bits <= 8 else np.uint16
    values = np.empty(radiance.shape, kind)
    for first in range(0, len(values), BAND_ROWS):
        rows = slice(first, first + BAND_ROWS)
        level = np.rint(encode(radiance[rows], transfer) * levels)
        # In single precision, levels of 9 to 15 bits would be rounded twice.
        values[rows] = np.rint(level * np.float64(np.iinfo(kind).max / levels))
    return values


def psnr_db(a: Numbers, b: Numbers, mask: npt.NDArray[np.bool_] | None = None) -> float:
    """Return the peak signal-to-noise ratio, dB, of two linear images after sRGB encoding."""
    difference = (encode(a, "srgb").astype(np.float64) - encode(b, "srgb").astype(np.float64)) ** 2
    mean = difference.mean() if mask is None else difference[mask].mean()
    return float("inf") if mean == 0.0 else float(-10.0 * np.log10(mean))

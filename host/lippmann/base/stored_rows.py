"""An image that stays in its file, of which some rows are read at a time: panels larger than memory."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.base.images import (
    BAND_ROWS,
    Radiance,
    broken,
    check_input,
    decode_rows,
    opened,
    openimageio,
    three_colours,
)
from lippmann.base.limits import check_expanded
from lippmann.base.stderr import silent_stderr
from lippmann.errors import input_error


class StoredRows:
    """Linear radiance (height, width, 3) float32 that stays in its file: only the rows that are asked for are read.

    It is indexed like an array, by rows first. What it returns cannot be written; `numpy.asarray` reads it whole.
    """

    dtype, ndim = np.dtype(np.float32), 3

    def __init__(
        self, path: str | Path, limit: tuple[int, int], accept: Callable[[Mapping[str, str]], None] | None = None
    ) -> None:
        """Open an image file; see `read_picture`, whose errors this raises too."""
        self._oiio, self._path = openimageio(), check_input(path)
        self._first, self._rows = 0, np.empty((0, limit[0], 3), np.float32)
        with self._quiet():
            self._open = contextlib.ExitStack()
            self._source, self.metadata = self._open.enter_context(opened(self._oiio, self._path, limit, accept))
        self.shape = (limit[1], limit[0], 3)
        self.size = 3 * limit[0] * limit[1]

    @contextlib.contextmanager
    def _quiet(self) -> Iterator[None]:
        try:
            with silent_stderr():
                yield
        except UnicodeDecodeError:  # OpenImageIO quotes a broken header
            raise input_error(str(self._path), "is broken", "render it again") from None

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any, /) -> Radiance:
        """Return a part; a row, or a range of rows, is all that is read of the file."""
        rows, *rest = index if isinstance(index, tuple) else (index,)
        if isinstance(rows, int | np.integer):
            row = range(self.shape[0])[rows]  # or IndexError
            return np.asarray(self._read(row, row + 1)[(0, *rest)], np.float32)
        if not isinstance(rows, slice) or rows.step not in (None, 1):
            return np.asarray(np.asarray(self)[index], np.float32)
        first, last, _ = rows.indices(self.shape[0])
        found = self._read(first, max(first, last))
        return np.asarray(found[(slice(None), *rest)], np.float32) if rest else found

    def _read(self, first: int, last: int) -> Radiance:
        """Return rows; those of the last call are not read again, so that reading goes forwards."""
        kept = self._rows[max(0, first - self._first) :] if first >= self._first else self._rows[:0]
        start = first + len(kept)
        parts = [kept[: last - first]]
        with self._quiet():
            for low in range(start, last, BAND_ROWS):
                high = min(low + BAND_ROWS, last)
                pixels = self._source.read_scanlines(
                    0, 0, low, high, 0, 0, self._source.spec().nchannels, self._oiio.FLOAT
                )
                if pixels is None:
                    raise broken(self._path, self._source)
                values = three_colours(pixels)
                decode_rows(self._path, values, self.metadata)
                parts.append(values)
        self._first, self._rows = first, np.concatenate(parts)
        self._rows.setflags(write=False)
        return self._rows

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        """Return all rows."""
        height, width, _ = self.shape
        check_expanded(str(self._path), f"{width} x {height} pixels", 2 * 12 * width * height, "take a smaller image")
        whole = self._read(0, height)
        self._rows = whole[:0]  # the caller's memory now, and not this object's too
        if copy is None:  # where the type asks for it
            return np.asarray(whole, dtype)
        return np.array(whole, dtype, copy=copy)

"""Limits of the files that are read: their size, and what they expand to, known before memory is taken for it."""

from __future__ import annotations

import io
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO
from xml.parsers import expat

import numpy as np

from lippmann.base.machine import free_memory_mb
from lippmann.base.tones import Numbers
from lippmann.errors import InputError, input_error, reason

#: Most bytes of a TOML file; a scene's XML; a table of pixels or words as text.
MAX_TOML_BYTES, MAX_XML_BYTES, MAX_TABLE_BYTES = 1 << 20, 1 << 26, 1 << 28
#: Most bytes of a bitstream: thrice that of the largest ECP5.
MAX_BITSTREAM_BYTES = 1 << 23
#: Most bytes of the header of an array's file: numpy itself takes no more.
MAX_HEADER_BYTES = 10_000
#: Most rays of a file, and of --pixels.
MAX_RAYS = 100_000_000
#: Deepest nest of an XML file's elements: Mitsuba takes some of the stack for each.
MAX_XML_DEPTH = 500
#: Bytes that are read at once: a read takes memory for all that it might get.
PART_BYTES = 1 << 20
#: Share of the free memory that a file may take.
SHARE = 0.8


def read_limited(path: Path, most: int, remedy: str) -> bytes:
    """Return a file's bytes; InputError when there are more than `most`. Endless devices and pipes are cut, too."""
    data = bytearray()
    with path.open("rb") as stream:
        while part := stream.read(min(PART_BYTES, most + 1 - len(data))):
            data += part
    if len(data) > most:
        raise input_error(str(path), f"is larger than {_size(most)}", remedy)
    return bytes(data)


def _size(count: int) -> str:
    return f"{count >> 20} MB" if count >> 20 else f"{count >> 10} KB"


def check_expanded(where: str, what: str, needed_bytes: int, remedy: str) -> None:
    """Raise InputError when a file's content needs more memory than is free."""
    limit = SHARE * free_memory_mb()
    if needed_bytes / 1e6 > limit:
        raise input_error(where, f"{what}: needs {needed_bytes / 1e6:.0f} MB, the limit is {limit:.0f} MB", remedy)


def load_arrays(
    path: Path, names: Collection[str] | None, remedy: str, bytes_a_ray: int = 0
) -> tuple[dict[str, Numbers], set[str]]:
    """Return arrays of numbers of an .npz file, those of `names` that it has, and all names in it.

    Without `names` it is an .npy file, whose array is called "". The arrays' headers are read first: `bytes_a_ray` is
    the memory that the caller takes for each of their rows. Raises InputError when the file is broken, has arrays of
    other things than real numbers or more than `MAX_RAYS` rows, or needs more memory than is free.
    """
    try:
        if names is None:
            with path.open("rb") as stream:
                _check_arrays(path, {"": _header(stream)}, remedy, bytes_a_ray)
                stream.seek(0)
                return {"": np.asarray(np.lib.format.read_array(stream, allow_pickle=False))}, {""}
        with zipfile.ZipFile(path) as file:
            there = {name.removesuffix(".npy"): name for name in file.namelist()}
            wanted = {name: there[name] for name in names if name in there}
            headers = {}
            for name, member in wanted.items():
                with file.open(member) as stream:
                    headers[name] = _header(stream)
            _check_arrays(path, headers, remedy, bytes_a_ray)
            arrays = {}
            for name, member in wanted.items():
                with file.open(member) as stream:
                    arrays[name] = np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
            return arrays, set(there)
    except InputError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise of any kind for broken files
        if isinstance(error, MemoryError | NotImplementedError | RuntimeError):  # of too much, ciphers, other codings
            error = ValueError(str(error) or "it is too large")
        known = ValueError | OSError | KeyError | EOFError | TypeError | zipfile.BadZipFile | zlib.error
        why = reason(error) if isinstance(error, known) else type(error).__name__
        raise input_error(str(path), f"cannot be read ({why})", remedy) from None


Header = tuple[tuple[int, ...], np.dtype[np.generic]]


def _header(stream: IO[bytes]) -> Header:
    """Return the shape and type in the header of an array's file."""
    head = io.BytesIO(stream.read(MAX_HEADER_BYTES))  # a file may claim 4 GB of header
    version = np.lib.format.read_magic(head)
    if version == (1, 0):
        shape, _, kind = np.lib.format.read_array_header_1_0(head)
    elif version == (2, 0):
        shape, _, kind = np.lib.format.read_array_header_2_0(head)
    else:
        raise ValueError(f"version {version[0]}.{version[1]} of numpy's format")
    return shape, kind


def _check_arrays(path: Path, headers: dict[str, Header], remedy: str, bytes_a_ray: int) -> None:
    """Refuse arrays that are not of real numbers, or are too large, by their headers."""
    rows = total = 0
    for name, (shape, kind) in headers.items():
        called = f"{name} is" if name else "is"
        if kind.hasobject:
            raise input_error(str(path), "cannot be read (it holds no array of numbers)", remedy)
        if kind.kind not in "biuf" or kind.itemsize > 16:
            raise input_error(str(path), f"{called} {kind}", "give real numbers")
        count = math.prod(shape)
        rows = max(rows, shape[0] if shape else 1, count // 16)
        total += count * kind.itemsize
    if rows > MAX_RAYS:
        raise input_error(str(path), f"holds {rows} rays", f"give at most {MAX_RAYS}")
    check_expanded(str(path), f"{rows} rays", total + rows * bytes_a_ray, "give fewer rays")


def png_chunks(path: Path) -> Iterator[tuple[bytes, int, bool]]:
    """Yield the kind of each chunk of a PNG, its bytes as it claims, and whether the file has them; none of others."""
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89PNG\r\n\x1a\n":
            return
        end = os.fstat(stream.fileno()).st_size
        while len(head := stream.read(8)) == 8:
            size, kind = struct.unpack(">I4s", head)
            yield kind, size, stream.tell() + size <= end
            stream.seek(size + 4, os.SEEK_CUR)


def png_is_complete(path: Path) -> bool:
    """Tell whether a PNG has its last chunk, and each before it."""
    for kind, _, complete in png_chunks(path):
        if kind == b"IEND" or not complete:
            return complete
    return False


def lines_of(text: str) -> Iterator[str]:
    """Yield a text's lines one by one, without a list of them all."""
    start = 0
    while start < len(text):
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        yield text[start:end].rstrip("\r")
        start = end + 1


def check_xml(path: Path, remedy: str) -> list[str]:
    """Refuse an XML file that is too large, or whose elements are nested too deeply; return the files it includes.

    Other parsers would run out of stack.
    """
    data = read_limited(path, MAX_XML_BYTES, remedy)
    depth, included = 0, list[str]()

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_XML_DEPTH:
            what = f"has elements more than {MAX_XML_DEPTH} deep (line {parser.CurrentLineNumber})"
            raise input_error(str(path), what, remedy)
        if name == "include" and "filename" in attributes:
            included.append(attributes["filename"])

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError) as error:  # the caller's parser says it better, unless it could be too deep
        if data.count(b"<") > MAX_XML_DEPTH:
            raise input_error(str(path), f"is not XML ({error})", remedy) from None
    return included

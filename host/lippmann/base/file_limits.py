"""Checks a file's size and, before allocation, the memory that its content needs."""

from __future__ import annotations

import io
import math
import os
import re
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

#: Maximum bytes of a TOML file, a scene's XML file and a text table.
MAX_TOML_BYTES, MAX_XML_BYTES, MAX_TABLE_BYTES = 1 << 20, 1 << 26, 1 << 28
#: Maximum bytes of an FPGA bitstream: three times that of the largest ECP5.
MAX_BITSTREAM_BYTES = 1 << 23
#: Maximum bytes of a numpy file's header; numpy has the same limit.
MAX_HEADER_BYTES = 10_000
#: Maximum rays in a file and in the option --pixels.
MAX_RAYS = 100_000_000
#: Maximum nesting depth of XML elements, because Mitsuba's parser is recursive.
MAX_XML_DEPTH = 500
PART_BYTES = 1 << 20
#: Maximum memory of a file's content, as a fraction of the free memory.
SHARE = 0.8


def read_limited(path: Path, max_bytes: int, remedy: str) -> bytes:
    """Return a file's bytes; raise InputError if a file or device supplies more than `max_bytes`."""
    data = bytearray()
    with path.open("rb") as stream:
        while part := stream.read(min(PART_BYTES, max_bytes + 1 - len(data))):
            data += part
    if len(data) > max_bytes:
        size = f"{max_bytes >> 20} MB" if max_bytes >> 20 else f"{max_bytes >> 10} KB"
        raise input_error(path, f"is larger than {size}", remedy)
    return bytes(data)


def check_expanded(where: str, what: str, needed_bytes: int, remedy: str) -> None:
    """Raise InputError if content needs more than the fraction `SHARE` of the free memory."""
    limit = SHARE * free_memory_mb()
    if (needed := needed_bytes / 1e6) > limit:
        raise input_error(where, f"{what}: needs {math.ceil(needed)} MB, the limit is {int(limit)} MB", remedy)


def load_arrays(
    path: Path, names: Collection[str] | None, remedy: str, bytes_a_ray: int = 0
) -> tuple[dict[str, Numbers], set[str]]:
    """Return a dict of the arrays `names` of an .npz file, and all array names of the file.

    If `names` is None, the file is an .npy file, and its array gets the name "".
    `bytes_a_ray` is the memory that the caller needs per row (ray), bytes. Raises
    InputError for a broken file, values that are not real numbers, more than `MAX_RAYS`
    rows, or too little free memory.
    """
    try:
        if names is None:
            with path.open("rb") as stream:
                _check_arrays(path, {"": _header(stream)}, remedy, bytes_a_ray)
                stream.seek(0)
                return {"": np.asarray(np.lib.format.read_array(stream, allow_pickle=False))}, {""}
        with zipfile.ZipFile(path) as file:
            members = {name.removesuffix(".npy"): name for name in file.namelist()}
            headers, arrays = dict[str, Header](), dict[str, Numbers]()
            for name in names:
                if name in members:
                    with file.open(members[name]) as stream:
                        headers[name] = _header(stream)
            _check_arrays(path, headers, remedy, bytes_a_ray)
            for name in headers:
                with file.open(members[name]) as stream:
                    arrays[name] = np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
            return arrays, set(members)
    except InputError:
        raise
    except Exception as error:  # broken files raise errors of many classes
        # These errors mean: too large, encrypted, or compressed by an unknown method.
        if isinstance(error, MemoryError | NotImplementedError | RuntimeError):
            error = ValueError(str(error) or "it is too large")
        usual = ValueError | OSError | KeyError | EOFError | TypeError | zipfile.BadZipFile | zlib.error
        why = reason(error) if isinstance(error, usual) else type(error).__name__
        raise input_error(path, f"cannot be read ({why})", remedy) from None


Header = tuple[tuple[int, ...], np.dtype[np.generic]]


def _header(stream: IO[bytes]) -> Header:
    head = io.BytesIO(stream.read(MAX_HEADER_BYTES))  # a broken file may declare a header of 4 GB
    version = np.lib.format.read_magic(head)
    if version == (1, 0):
        shape, _, kind = np.lib.format.read_array_header_1_0(head)
    elif version == (2, 0):
        shape, _, kind = np.lib.format.read_array_header_2_0(head)
    else:
        raise ValueError(f"unknown version {version[0]}.{version[1]} of numpy's format")
    return shape, kind


def _check_arrays(path: Path, headers: dict[str, Header], remedy: str, bytes_a_ray: int) -> None:
    rows = total = 0
    for name, (shape, kind) in headers.items():
        called = f"{name} is" if name else "is"
        if kind.hasobject:
            raise input_error(path, "cannot be read (it contains no array of numbers)", remedy)
        if kind.kind not in "biuf" or kind.itemsize > 16:
            raise input_error(path, f"{called} {kind}", "give real numbers")
        count = math.prod(shape)
        rows = max(rows, shape[0] if shape else 1, count // 16)
        total += count * kind.itemsize
    if rows > MAX_RAYS:
        raise input_error(path, f"contains {rows} rays", f"give at most {MAX_RAYS} rays per file")
    check_expanded(str(path), f"{rows} rays", total + rows * bytes_a_ray, "give fewer rays")


def png_chunks(path: Path) -> Iterator[tuple[bytes, int, bool]]:
    """Yield type, declared size and completeness of each chunk of a PNG; nothing for other files."""
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89PNG\r\n\x1a\n":
            return
        end = os.fstat(stream.fileno()).st_size
        while len(head := stream.read(8)) == 8:
            size, kind = struct.unpack(">I4s", head)
            yield kind, size, stream.tell() + size <= end
            stream.seek(size + 4, os.SEEK_CUR)


def png_is_complete(path: Path) -> bool:
    """Return whether a PNG file contains all chunks up to the end chunk."""
    for kind, _, complete in png_chunks(path):
        if kind == b"IEND" or not complete:
            return complete
    return False


def lines_of(text: str) -> Iterator[str]:
    """Yield the lines of a text without building a list."""
    return (line[0].rstrip("\r\n") for line in re.finditer(r"[^\n]*\n|[^\n]+", text))


def check_xml(path: Path, remedy: str) -> list[str]:
    """Raise InputError for a too large or too deep XML file; return the included files."""
    data = read_limited(path, MAX_XML_BYTES, remedy)
    depth, included = 0, list[str]()

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_XML_DEPTH:
            what = f"nests elements more than {MAX_XML_DEPTH} deep (line {parser.CurrentLineNumber})"
            raise input_error(path, what, remedy)
        if name == "include" and "filename" in attributes:
            included.append(attributes["filename"])

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError) as error:  # the caller's parser reports all faults except too deep nesting
        if data.count(b"<") > MAX_XML_DEPTH:
            raise input_error(path, f"is not XML ({error})", remedy) from None
    return included

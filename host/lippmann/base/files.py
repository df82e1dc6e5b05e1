"""Writes files and folders completely or not at all, even on a signal, full disk or power cut.

A file is written under a temporary name in the same folder, synced and renamed. The
temporary name identifies the process: later commands remove a killed process's files.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import importlib.util
import itertools
import os
import platform
import re
import shutil
import stat
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from lippmann.base import interrupts
from lippmann.errors import LippmannError, NoSpaceError, input_error

HAS_LOCKS = importlib.util.find_spec("fcntl") is not None
new_folders: list[Path] = []

#: Error numbers for a full disk, an exhausted quota, and a file above the size limit.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
#: Bytes of a test write; a disk that refuses them is full.
PROBE_BYTES = 1 << 20
#: Age at which partial files of another machine or container are removed, s.
FOREIGN_S = 86_400.0
#: Maximum length of a file's stem in a temporary name, bytes.
STEM_BYTES = 180
#: Flags of `os.open`: follow no link, and close the file in child processes.
OWN_FLAGS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
#: Counter that makes temporary names unique if two threads write the same file.
numbers = itertools.count()
#: Temporary name: stem, counter, machine hash, process, start time hash, suffix.
PARTIAL = re.compile(r"\..*\.([0-9a-f]{8})-([0-9]+)-([0-9a-f]{8})\.partial(\.[^.]*)?", re.DOTALL)


def owner() -> str:
    """Return the part of a temporary name that identifies this process."""
    return f"{_machine()}-{os.getpid()}-{_life(os.getpid())}"


@functools.cache
def _machine() -> str:
    container = ""
    with contextlib.suppress(OSError):
        container = str(os.stat("/proc/self/ns/pid").st_ino)
    return _short(f"{platform.node()}{container}".encode())


def _life(pid: int) -> str:
    """Hash a process's start time; return "" if it has ended, a constant if /proc is missing."""
    if not Path("/proc/self/stat").exists():
        return "0" * 8
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_bytes()
    except OSError:
        return ""
    return _short(boot + fields[19])  # start time, in ticks


def _short(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()[:8]


def partial_name(name: str) -> str:
    """Return a new temporary name for a file; the name keeps the file's suffix."""
    stem, suffix = os.path.splitext(name)
    stem = stem.encode(errors="surrogateescape")[:STEM_BYTES].decode(errors="ignore")
    return f".{stem}.{next(numbers)}.{owner()}.partial{suffix}"


def remove_stale(folder: Path) -> None:
    """Remove the partial files and folders that ended processes left in a folder."""
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            match = PARTIAL.fullmatch(entry.name)
            if match is None:
                continue
            machine, process, life, _ = match.groups()
            if machine == _machine():
                is_stale = _life(int(process)) != life
            else:
                is_stale = time.time() - entry.stat(follow_symlinks=False).st_mtime > FOREIGN_S
            if is_stale:
                _remove(Path(entry.path))


#: Runs `remove_stale` once for each absolute path.
remove_stale_once = functools.cache(remove_stale)


def _remove(path: Path) -> None:
    # Delay signals, because their exception would stop the removal.
    with interrupts.hold_signals():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif os.path.lexists(path):  # a read-only file system refuses unlink
            path.unlink(missing_ok=True)


def is_full(error: BaseException) -> bool:
    """Return whether a full disk caused an error."""
    if isinstance(error, RuntimeError):  # raised by Mitsuba
        return any(os.strerror(number) in str(error) for number in FULL)
    return isinstance(error, OSError) and error.errno in FULL


def no_space(where: object, why: str | None = None) -> NoSpaceError:
    """Return the error to raise for a full disk; `why` is the system's message."""
    what = f"cannot be written ({why or 'no space left on the device'})"
    return NoSpaceError.at(where, what, "free space or choose another place")


def on_full_disk(path: Path) -> str | None:
    """Append `PROBE_BYTES` bytes to a file; return the system's message if the disk is full."""
    try:
        with path.open("ab") as stream:
            stream.write(bytes(PROBE_BYTES))
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        return error.strerror if is_full(error) else None
    return None


def not_written(path: Path, why: OSError | str = "", partial: Path | None = None) -> LippmannError:
    """Return the error to raise for a failed write.

    If `why` has no errno, a write to `partial` tests whether the disk is full.
    """
    reason = why if isinstance(why, str) else why.strerror or str(why)
    if isinstance(why, OSError) and (why.errno is not None or partial is None):
        full = reason if is_full(why) else None
    else:
        full = on_full_disk(partial or path)
    if full is not None:
        return no_space(path, full)
    return input_error(path, f"cannot be written ({reason})", "free space or choose another place")


def sync(path: Path) -> None:
    """Wait until the disk has stored a file's content or a folder's list of files."""
    if os.name == "nt" and path.is_dir():  # Windows cannot open folders
        return
    handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some file systems cannot sync folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
            raise
    finally:
        os.close(handle)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Provide a temporary file name; rename the file to `path` on success, remove it on failure.

    Raises NoSpaceError for a full disk, InputError if the write fails otherwise.
    """
    remove_stale_once(path.parent.absolute())
    partial = path.with_name(partial_name(path.name))
    try:
        new_file(partial).close()
        yield partial
        if not partial.stat().st_size:
            raise OSError(errno.EIO, "nothing was written")
        moved(partial, path)
    except OSError as error:
        raise not_written(path, error, partial) from None
    finally:
        _remove(partial)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file completely or not at all (see `replacing`); text is encoded as UTF-8."""
    with replacing(path) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)


def new_file(path: Path) -> BinaryIO:
    """Create and open an empty file; remove an old file or link at its path."""
    _remove(path)
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | OWN_FLAGS, 0o666), "wb")


def user_id() -> int:
    """Return the user's ID, or 0 on a system without user IDs."""
    return os.getuid() if hasattr(os, "getuid") else 0


def own_text(path: Path) -> str:
    """Read a text file that belongs to this user.

    Raises OSError for a link, a pipe or another user's file.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | OWN_FLAGS)
    with os.fdopen(handle, encoding="utf-8", errors="replace") as stream:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != user_id():
            raise PermissionError(errno.EPERM, "not this user's regular file", str(path))
        return stream.read()


@contextlib.contextmanager
def partial_folder(target: Path) -> Iterator[Path]:
    """Provide a temporary folder beside `target`, removed at the block's end.

    Raises OSError.
    """
    remove_stale_once(target.parent.absolute())
    folder = target.with_name(partial_name(target.name))
    _remove(folder)
    try:
        folder.mkdir()
        yield folder
    finally:
        _remove(folder)


def moved(source: Path, target: Path) -> None:
    """Sync a finished file or folder to the disk, then rename it to `target`."""
    for below in sorted(source.rglob("*")) if source.is_dir() else ():
        if not below.is_symlink():
            sync(below)
    sync(source)
    os.replace(source, target)
    sync(target.parent)


def make_folder(folder: Path, remedy: str = "choose another folder") -> None:
    """Make a folder and its parents; `remove_empty` can remove them.

    Raises NoSpaceError or InputError if a folder cannot be made.
    """
    new_folders.extend(place for place in (*reversed(folder.parents), folder) if not place.exists())
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if is_full(error):
            raise no_space(folder, error.strerror) from None
        raise input_error(folder, f"cannot be made ({error.strerror})", remedy) from None


class FolderLock:
    """Locks a folder until `close` or the process's end, if the file system has locks."""

    def __init__(self, folder: Path, remedy: str) -> None:
        """Make the folder if missing, and lock it.

        Raises InputError if another command has the lock; see also `make_folder`.
        """
        self.close: Callable[[], object] = lambda: None
        make_folder(folder, remedy)
        if HAS_LOCKS:
            while (handle := _locked(folder, remedy)) is None:
                make_folder(folder, remedy)
            self.close = weakref.finalize(self, os.close, handle)


def _locked(folder: Path, remedy: str) -> int | None:
    import fcntl

    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        what = "is in use by another command"
        raise input_error(folder, what, f"wait until that command has ended, or {remedy}") from None
    except OSError:  # the file system has no locks
        return handle
    with contextlib.suppress(FileNotFoundError):
        if os.path.samestat(os.fstat(handle), folder.stat()):
            return handle
    os.close(handle)
    return None


def remove_empty() -> None:
    """Remove the folders that `make_folder` created and that are empty."""
    while new_folders:
        with contextlib.suppress(OSError):
            new_folders.pop().rmdir()


def private_path() -> Path:
    """Return the path of this user's private temporary folder."""
    return Path(tempfile.gettempdir()) / f"lippmann-{user_id()}"


def private_folder() -> Path:
    """Return this user's private folder for sockets and scratch files; create it if missing.

    Raises InputError if the folder belongs to another user or others have access.
    """
    folder = private_path()
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    shared = os.name != "nt" and (status.st_uid != user_id() or status.st_mode & 0o077)
    if not stat.S_ISDIR(status.st_mode) or shared:
        raise input_error(folder, "is not your private folder", "remove it, or set TMPDIR to your own folder")
    return folder


def listening() -> set[str]:
    """Return the paths of Unix sockets on which programs listen (only on Linux)."""
    table = Path("/proc/net/unix")
    rows = table.read_text(errors="replace").splitlines() if table.exists() else []
    return {row.split(maxsplit=7)[-1] for row in rows}  # a socket's path may contain spaces


def scratch_folder() -> contextlib.AbstractContextManager[Path]:
    """Provide an empty folder, whose short name has no spaces, until the block's end."""
    return partial_folder(private_folder() / "s")

"""Command `lippmann doctor`."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from typing import Any

from lippmann import __version__
from lippmann.base.machine import free_memory_mb, machine_name
from lippmann.base.variant import mitsuba, start_mitsuba
from lippmann.capturing.povray_export import POVRAY
from lippmann.cli.frame import make_command, option
from lippmann.cli.output import emit
from lippmann.errors import EXTRA_MODULES, DeviceError, LippmannError, MissingLibraryError, missing_library, to_install
from lippmann.simulation.toolchain import RTL_TOOLS

#: Error about a missing library for serial ports, if any.
NO_PORTS: MissingLibraryError | None = None
try:
    from lippmann.board.bitstreams import LOADER
    from lippmann.board.board_search import baud_of_board
    from lippmann.board.fpga_boards import board_of_port, fpga_boards
    from lippmann.board.port import SCHEMES, adapter_ports, port_info, port_trouble, ports
except ImportError as error:
    NO_PORTS = missing_library(error)
NO_ANSWER = "the port opens, but no board answers at any baud rate; check the board's power and the cable"


@make_command("doctor")
def command(
    port: str | None = option("Search for a board at this port, at all common baud rates.", metavar="URL"),
) -> int:
    """Check libraries, rendering, RTL tools and serial ports.

    Exit code 3: something required is missing. With --port, exit code 1: no board
    answers. Only simulation (`trace --engine rtl`, virtual boards), synthesis and
    proofs need RTL tools.

    Example: lippmann doctor
    """
    checks: list[dict[str, Any]] = []

    def check(name: str, good: bool, detail: str, needed: bool = True) -> None:
        checks.append({"check": name, "ok": good, "needed": needed, "detail": detail})

    check("python", sys.version_info >= (3, 11), sys.version.split()[0])
    for package, extra in _packages():
        try:
            check(package, True, metadata.version(package), needed=not extra)
        except metadata.PackageNotFoundError:
            check(package, False, f"not installed; {to_install(extra)}", needed=not extra)
    for device, needed in (("llvm", True), ("cuda", False)):
        try:
            start_mitsuba(device)
            mi = mitsuba()
            value = float((mi.Float(1.0, 2.0) + 1.0)[1])
            check(f"mitsuba on {device}", value == 3.0, mi.variant(), needed)
        except LippmannError as error:
            check(f"mitsuba on {device}", False, str(error), needed)
    check("memory", free_memory_mb() > 2000.0, f"{free_memory_mb():.0f} MB free")
    for tool in (*RTL_TOOLS, POVRAY) if NO_PORTS else (*RTL_TOOLS, LOADER, POVRAY):
        at = tool.find()
        check(tool.name, at is not None, f"{tool.purpose}; {at or f'missing: {tool.remedy}'}", needed=False)
    if NO_PORTS is None:
        _check_ports(check)
    code = 0 if all(c["ok"] for c in checks if c["needed"]) else MissingLibraryError.exit_code
    if port is not None:
        trouble = NO_PORTS or port_trouble(port)
        rate = None if trouble else baud_of_board(port)
        answer = str(trouble or NO_ANSWER)
        if rate is not None:
            answer = "a board answers" if port.startswith(SCHEMES) else f"a board at {rate} baud"
        check(port, rate is not None, answer)
        if rate is None:
            code = code or (trouble or DeviceError).exit_code

    lines = [f"lippmann {__version__} on {machine_name()}"]
    for c in checks:
        mark = "ok" if c["ok"] else ("MISSING" if c["needed"] else "none")
        lines.append(f"{mark:<8}{c['check']:<19} {c['detail']}")
    emit({"ok": not code, "version": __version__, "machine": machine_name(), "checks": checks}, lines)
    return code


def _check_ports(check: Callable[..., None]) -> None:
    try:
        fpga_boards()
    except LippmannError as error:  # a user's own board file is invalid
        check("board files", False, str(error), needed=False)
    adapters = adapter_ports()
    for url in ports():
        # Open only known adapters, as opening a port resets some devices.
        trouble = port_trouble(url) if url in adapters else None
        detail = "serial port, can be opened" if url in adapters else "serial port, not a known USB adapter: not opened"
        check(url, trouble is None, f"{_board_text(url)}{trouble or detail}", needed=False)


def _board_text(url: str) -> str:
    board, info = board_of_port(url), port_info(url)
    if board is None or info is None:
        return ""
    number = f", serial number {info.serial_number}" if info.serial_number else ""
    return f"{board.title}, {board.baud} baud{number}: "


def _packages() -> Iterator[tuple[str, str]]:
    yield "drjit", "render"  # Mitsuba requires drjit
    for line in metadata.requires("lippmann") or []:
        package, _, condition = line.partition(";")
        extra = "".join(re.findall(r'extra == "(\w+)"', condition))
        if extra in ("", *EXTRA_MODULES) and not package.startswith("lippmann["):
            yield re.split(r"[^\w.-]", package)[0], extra

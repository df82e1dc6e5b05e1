"""Commands `lippmann board`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from lippmann.board.bitstreams import program, read_bitfile
from lippmann.board.board import Board, check_rays
from lippmann.board.drawn_scene import LAYER_WORDS, LAYERS_BASE, SceneBoard
from lippmann.board.packets import SCENE_VERSION
from lippmann.board.session import REGISTERS, SCENE_BASE
from lippmann.cli.board_start import start_command, stop_command
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options import DISPLAY, vector
from lippmann.cli.options_port import FORCE_BOARD, OPEN_BOARD, OpenBoard
from lippmann.cli.output import emit
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, device_error, did_you_mean, input_error
from lippmann.fixed.registers import BOARD_REGISTERS, Field, Register

WORD = Field(0, 32)
#: Size of the scene's register block, bytes.
SCENE_BYTES = 0x400
LOOKS = {register.address for name, register in REGISTERS.items() if name.endswith("_look")}
LOOK_SLOT = REGISTERS["scene.layer_0_look"].fields["slot"]


@click.group("board")
def command() -> None:
    """Start a virtual board; control a real or virtual board.

    Example: lippmann board info
    """


command.add_command(start_command)
command.add_command(stop_command)


@make_command("program", command)
def program_command(
    file: Path = argument("FILE.bit"),
    board: str | None = option("Name of the board, if the bitstream names none.", metavar="NAME"),
    serial: str | None = option("Serial number of the board's USB adapter."),
    flash: bool = option("Write the bitstream to flash memory, which keeps it at power-off."),
    display_path: Path | None = option("Refuse a bitstream that is not for this display file."),
) -> None:
    """Load a bitstream into an FPGA board (openFPGALoader); --flash keeps it at power-off.

    Example: lippmann board program build/bitstream/ulx3s-vga-square.bit
    """
    header = read_bitfile(file)
    if display_path:
        display = load_display(display_path)
        if header.identity != display.identity:
            what = f"its display is {header.identity or 'unknown'}, but {display_path} is display {display.identity}"
            raise input_error(file, what, f"run make bitstream DISPLAY={display_path}")
    programmed = program(file, board, serial, flash)
    about = {name: getattr(header, name) for name in ("device", "display", "identity", "design")}
    result = {"file": file, "board": programmed.name, **about, "flash": flash}
    what = f"{header.display} (design {header.design})" if header.display else str(file)
    emit(result, f"{programmed.name}: {'its flash memory holds' if flash else 'runs'} {what}")


@make_command("info", command)
def info_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Print a board's display, panel, optics and error counters.

    Example: lippmann board info --port socket://127.0.0.1:4000
    """
    with open_board() as board:
        hello = board.info
        registers = {name: board.word(name) for name in BOARD_REGISTERS}
        counters = {name: count for name, count in registers.items() if name.startswith("counters")}
        result = {
            "port": board.line.url,
            "identity": f"{hello.identity:016x}",
            "panel": {"width": hello.width, "height": hello.height},
            "clock_hz": hello.clock_hz,
            "epoch": hello.epoch,
            "optics": vars(board.optics_build()),
            **({} if hello.version < SCENE_VERSION else {"scene": vars(SceneBoard(board).build)}),
            "shown_crc": f"{registers['shown_crc']:08x}",
            "frames": registers["frames"],
            "counters": {name.removeprefix("counters_"): count for name, count in counters.items()},
        }
    texts = {k: ", ".join(f"{n} {x}" for n, x in v.items()) if isinstance(v, dict) else v for k, v in result.items()}
    emit(result, (f"{key:<12}{text}" for key, text in texts.items()))


@make_command("setup", command)
def setup_command(display: Display = DISPLAY, force: bool = FORCE_BOARD, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Write a display's optics to a board, for rays and test patterns.

    Example: lippmann board setup --display scenes/displays/vga-square.toml
    """
    with open_board(None if force else display, "set it up") as board:
        result = {"port": board.line.url, "writes": board.write_optics(display)}
    emit(result, f"{result['port']}: optics of {display.name}", display)


@make_command("abort", command)
def abort_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Stop the frame that the board's optics trace, or cancel a pending frame start.

    While the optics trace, the board refuses other requests for the optics. The panel
    keeps its picture.

    Example: lippmann board abort
    """
    with open_board() as board:
        ran = board.frame_runs()  # the frame may end by itself
        board.abort()
        text = "the frame was stopped" if ran else "no frame ran"
        emit({"port": board.line.url, "aborted": ran}, f"{board.line.url}: {text}")


@make_command("reset", command)
def reset_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Reset a board to its state after power-up: black panel, no tiles, default registers.

    Example: lippmann board reset
    """
    with open_board() as board:
        board.reset()
        emit({"port": board.line.url, "reset": True}, f"{board.line.url}: reset")


@make_command("check", command)
def check_command(
    display: Display = DISPLAY,
    region: tuple[int, ...] | None = option(
        "Compare only the rays of this region of pixels.", kind=vector("LEFT,TOP,WIDTH,HEIGHT", int)
    ),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Compare the board's rays bit for bit with the integer twin's rays, by a CRC-32.

    Example: lippmann board check --display scenes/displays/vga-square.toml
    """
    panel = display.panel
    column, row, width, height = region or (0, 0, *panel.size_px)
    columns, rows = (column, column + width - 1), (row, row + height - 1)
    if not (0 <= column <= columns[1] < panel.width_px and 0 <= row <= rows[1] < panel.height_px):
        what = f"is not inside a panel of {panel.width_px} x {panel.height_px} pixels"
        raise input_error("--region", what, "give pixels: LEFT,TOP,WIDTH,HEIGHT")
    with open_board(display) as board:
        check, url = check_rays(board, display, columns, rows), board.line.url
    if not check.equal:
        what = f"the board's rays differ from the twin's (CRC-32 {check.board_crc:08x}, not {check.twin_crc:08x})"
        raise device_error(url, what, "update the board; compare single rays with lippmann trace --engine twin")
    result = {"port": url, "rays": check.rays, "crc": f"{check.board_crc:08x}", "equal": check.equal}
    emit(result, f"{url}: {check.rays} rays equal the twin's (CRC-32 {result['crc']})")


@make_command("read", command)
def read_command(
    register: str = argument(),
    count: int = argument(None, 1, kind=click.IntRange(1, 64)),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Read COUNT registers, starting at a register's name or address.

    Names of optics registers (address 0x200 on) begin with `optics.`, names of scene
    registers (0x400 on) with `scene.`.

    Example: lippmann board read display
    """
    target = _register(register)
    with open_board() as board:
        _check_scene(board, register, target.address, count)
        words = board.read(target.address, count)
    fields = {} if count > 1 else target.values(words[0])
    result = {"address": target.address, "words": words, "fields": fields}
    emit(result, (line for k, word in enumerate(words) for line in _lines(target.address + 4 * k, word)))


def _lines(address: int, word: int) -> Iterator[str]:
    name = next((name for name, register in REGISTERS.items() if register.address == address), "")
    yield f"0x{address:03X}  0x{word:08X}  {name}".rstrip()
    for field_name, field in (REGISTERS[name].fields if name else {}).items():
        meaning = dict(field.names).get(field.value(word))
        yield f"       {field_name} = {field.value(word)}" + (f" ({meaning})" if meaning else "")


@make_command("write", command)
def write_command(
    register: str = argument(),
    values: tuple[str, ...] = argument(kind=str, nargs=-1),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Write registers, by name or address.

    VALUES are words for REGISTER and the registers after it, or fields of REGISTER:
    FIELD=VALUE.

    Example: lippmann board write display pattern=4
    """
    target = _register(register)
    fields = target.fields
    by_field = any("=" in value for value in values)
    if by_field and not (fields and all("=" in value for value in values)):
        raise InputError(f"{' '.join(values)}: neither words nor fields of a named register; give words or FIELD=VALUE")
    if "write" not in target.access:
        raise input_error(register, "can only be read", "see docs/generated/board-registers.md")
    numbers = [] if by_field else [_number(value, value, WORD) for value in values]
    if fields and len(numbers) == 1:  # an address in a memory has no fields
        if numbers[0] & ~sum(field.mask for field in fields.values()):
            raise input_error(values[0], f"sets bits outside the fields of {register}", f"use {', '.join(fields)}")
        for name, field in fields.items():
            _check_named(values[0], name, field, field.value(numbers[0]))
    with open_board() as board:
        slots = _check_scene(board, register, target.address, len(values))
        if by_field:
            numbers = [_change_fields(register, fields, values, board.read(target.address)[0])]
        for address, word in enumerate(numbers, target.address // 4):
            if 4 * address in LOOKS and (slot := LOOK_SLOT.value(word)) >= slots:
                what = f"the board has no slot {slot}"
                raise input_error(" ".join(values), what, f"give a slot from 0 to {slots - 1}")
        board.write(target.address, numbers)
    words = " ".join(f"0x{number:08X}" for number in numbers)
    emit({"address": target.address, "words": numbers}, f"0x{target.address:03X}  {words}")


def _check_scene(board: Board, name: str, address: int, count: int) -> int:
    if not SCENE_BASE <= address < SCENE_BASE + SCENE_BYTES:
        return 0
    build = SceneBoard(board).build
    if address + 4 * count > LAYERS_BASE + 4 * LAYER_WORDS * build.layers:
        what = f"the board has {build.layers} layers, 0 to {build.layers - 1}"
        raise input_error(name, what, "see docs/generated/scene-registers.md")
    return build.slots_built


def _register(name: str) -> Register:
    if name in REGISTERS:
        return REGISTERS[name]
    try:
        return Register(int(name, 0))
    except ValueError:
        remedy = did_you_mean(name, REGISTERS) or "see docs/generated/board-registers.md"
        raise input_error(name, "no such register", remedy) from None


def _check_named(where: str, name: str, field: Field, value: int) -> None:
    if field.names and value not in dict(field.names):
        values = ", ".join(f"{number} {meaning}" for number, meaning in field.names)
        raise input_error(where, f"{name} {value} is not defined", f"choose from {values}")


def _number(where: str, text: str, field: Field) -> int:
    try:
        number = int(text, 0)
    except ValueError:
        raise input_error(where, "is not an integer", "give an integer such as 12 or 0x1F") from None
    _check_named(where, where.partition("=")[0], field, number)
    low, high = field.limits
    if not low <= number <= high:
        raise input_error(where, "is out of range", f"give {low} to {high}")
    return field.bits(number)


def _change_fields(register: str, fields: dict[str, Field], values: tuple[str, ...], word: int) -> int:
    names = [value.partition("=")[0] for value in values]
    if len(set(names)) < len(names):
        raise InputError(f"{' '.join(values)}: a field is named twice; name each field once")
    for name, value in zip(names, values, strict=True):
        if name not in fields:
            remedy = did_you_mean(name, fields) or f"choose from {', '.join(fields)}"
            raise input_error(value, f"{register} has no field {name}", remedy)
        field = fields[name]
        word = word & ~field.mask | _number(value, value.partition("=")[2], field)
    return word

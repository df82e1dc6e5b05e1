"""`lippmann board`: start a virtual board, query a board, and read and write its registers."""

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
from lippmann.cli.options_port import OPEN_BOARD, OpenBoard
from lippmann.cli.output import emit
from lippmann.display.description import Display, load_display
from lippmann.errors import InputError, device_error, did_you_mean, input_error
from lippmann.fixed.registers import BOARD_REGISTERS, Field, Register

#: A register's 32 bits.
WORD = Field(0, 32)
#: Bytes of the scene's addresses; addresses of the layers' looks, and the field with a layer's slot.
SCENE_BYTES = 0x400
LOOKS = {register.address for name, register in REGISTERS.items() if name.endswith("_look")}
LOOK_SLOT = REGISTERS["scene.layer_0_look"].fields["slot"]


@click.group("board")
def command() -> None:
    """Start a virtual board, or use a real or virtual one.

    Example: lippmann board start --display scenes/displays/paper-square.toml
    """


command.add_command(start_command)
command.add_command(stop_command)


@make_command("program", command)
def program_command(
    file: Path = argument("FILE.bit"),
    board: str | None = option("The board, for a bitstream that names none.", None, metavar="NAME"),
    serial: str | None = option("Serial number of the board's USB adapter, where there are two boards.", None),
    flash: bool = option("Write the board's flash memory: the FPGA loads it at each power-up.", False),
    display_path: Path | None = option("Refuse a bitstream that is for another display.", None),
) -> None:
    """Load a bitstream into an FPGA board by openFPGALoader.

    It stays until the board is switched off.

    Example: lippmann board program build/bitstream/ulx3s-vga-square.bit
    """
    header = read_bitfile(file)
    if display_path is not None:
        display = load_display(display_path)
        if header.identity != display.identity:
            what = f"the bitstream is for display {header.identity or 'unknown'}, {display_path} is {display.identity}"
            raise input_error(str(file), what, f"run make bitstream DISPLAY={display_path}")
    programmed = program(file, board, serial, flash)
    result = {
        "file": file,
        "board": programmed.name,
        "device": header.device,
        "display": header.display,
        "identity": header.identity,
        "design": header.design,
        "flash": flash,
    }
    what = f"{header.display} (design {header.design})" if header.display else str(file)
    emit(result, f"{programmed.name}: {'its flash memory holds' if flash else 'runs'} {what}")


@make_command("info", command)
def info_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Print a board's display, panel, optics and error counters.

    Example: lippmann board info --port socket://127.0.0.1:4000
    """
    with open_board() as board:
        hello = board.info
        registers = {name: board.read(register.address)[0] for name, register in BOARD_REGISTERS.items()}
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
            "counters": {
                name.removeprefix("counters_"): count
                for name, count in registers.items()
                if name.startswith("counters")
            },
        }
    texts = {k: ", ".join(f"{n} {x}" for n, x in v.items()) if isinstance(v, dict) else v for k, v in result.items()}
    emit(result, (f"{key:<12}{text}" for key, text in texts.items()))


@make_command("setup", command)
def setup_command(
    display: Display = DISPLAY,
    force: bool = option("Accept a board that drives another display.", False),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Write a display's optics to the board.

    The board needs them for its rays and its test patterns.

    Example: lippmann board setup --display scenes/displays/vga-square.toml --port socket://127.0.0.1:4000
    """
    with open_board(None if force else display, "set it up") as board:
        count = board.write_optics(display)
        url = board.line.url
    emit({"port": url, "writes": count}, f"{url}: optics of {display.name}", display)


@make_command("abort", command)
def abort_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """End the frame that a board's optics trace, and drop a start that waits.

    It prints whether there was one. Requests that need the optics are refused while a frame runs. The panel and its
    frame are not touched.

    Example: lippmann board abort --port socket://127.0.0.1:4000
    """
    with open_board() as board:
        ran = board.frame_runs()  # a moment before: it may still end by itself
        board.abort()
        text = "the frame was ended" if ran else "no frame ran"
        emit({"port": board.line.url, "aborted": ran}, f"{board.line.url}: {text}")


@make_command("reset", command)
def reset_command(*, open_board: OpenBoard = OPEN_BOARD) -> None:
    """Reset a board over its line, to its state after power-up.

    The panel turns black; the board forgets frames, tiles and registers.

    Example: lippmann board reset --port socket://127.0.0.1:4000
    """
    with open_board() as board:
        board.reset()
        emit({"port": board.line.url, "reset": True}, f"{board.line.url}: reset")


@make_command("check", command)
def check_command(
    display: Display = DISPLAY,
    region: tuple[int, ...] | None = option(
        "Pixels to compare; default: all.", None, vector("LEFT,TOP,WIDTH,HEIGHT", int)
    ),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Compare the board's rays with those of the integer twin.

    Every bit must be equal. The board returns only one CRC-32 for all rays, so a slow line is enough for a whole panel.

    Example: lippmann board check --display scenes/displays/vga-square.toml --port socket://127.0.0.1:4000
    """
    panel = display.panel
    left, top, width, height = region or (0, 0, panel.width_px, panel.height_px)
    if not (0 <= left <= left + width - 1 < panel.width_px and 0 <= top <= top + height - 1 < panel.height_px):
        what = f"is not inside a panel of {panel.width_px} x {panel.height_px} pixels"
        raise input_error("--region", what, "give pixels: LEFT,TOP,WIDTH,HEIGHT")
    with open_board(display) as board:
        check = check_rays(board, display, (left, left + width - 1), (top, top + height - 1))
        url = board.line.url
    if not check.equal:
        raise device_error(
            url,
            f"the board's rays differ from the twin's (CRC-32 {check.board_crc:08x}, not {check.twin_crc:08x})",
            "update the board; compare single rays with lippmann trace --engine twin",
        )
    result = {"port": url, "rays": check.rays, "crc": f"{check.board_crc:08x}", "equal": check.equal}
    emit(result, f"{url}: {check.rays} rays equal the twin's (CRC-32 {result['crc']})")


@make_command("read", command)
def read_command(
    register: str = argument(),
    count: int = argument(None, 1, kind=click.IntRange(1, 64)),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Read registers, by name or address.

    COUNT words are read. Names of the optics block begin with `optics.` (address 0x200), those of a board's scene with
    `scene.` (address 0x400).

    Example: lippmann board read display --port socket://127.0.0.1:4000
    """
    target = _register(register)
    with open_board() as board:
        _check_scene(board, register, target.address, count)
        words = board.read(target.address, count)
    fields = {} if count > 1 else target.values(words[0])
    result = {"address": target.address, "words": words, "fields": fields}
    emit(result, (line for k, word in enumerate(words) for line in _lines(target.address + 4 * k, word)))


def _lines(address: int, word: int) -> Iterator[str]:
    """Yield a register's address, word and name, and each field with its value and the value's meaning."""
    at_address = (name for name, register in REGISTERS.items() if register.address == address)
    name = next(at_address, "")
    yield f"0x{address:03X}  0x{word:08X}  {name}".rstrip()
    for field_name, field in (REGISTERS[name].fields if name else {}).items():
        value = field.value(word)
        meaning = dict(field.names).get(value)
        yield f"       {field_name} = {value}" + (f" ({meaning})" if meaning else "")


@make_command("write", command)
def write_command(
    register: str = argument(),
    values: tuple[str, ...] = argument(kind=str, nargs=-1),
    open_board: OpenBoard = OPEN_BOARD,
) -> None:
    """Write registers, by name or address.

    VALUES are words for this register and the next ones, or fields of this register: FIELD=VALUE.

    Example: lippmann board write display pattern=4 --port socket://127.0.0.1:4000
    """
    target = _register(register)
    fields = target.fields
    by_field = ["=" in value for value in values]
    if any(by_field) and not (all(by_field) and fields):
        raise InputError(f"{' '.join(values)}: give words, or FIELD=VALUE of a register name")
    if "write" not in target.access:
        raise input_error(register, "can only be read", "see docs/generated/board-registers.md")
    numbers = [] if any(by_field) else [_number(value, value, WORD) for value in values]
    if fields and len(numbers) == 1:  # a memory has no fields
        if numbers[0] & ~sum(field.mask for field in fields.values()):
            raise input_error(values[0], f"{register} has no field in some of these bits", f"use {', '.join(fields)}")
        for name, field in fields.items():
            _check_named(values[0], name, field, numbers[0])
    with open_board() as board:
        slots = _check_scene(board, register, target.address, len(values))
        if any(by_field):
            numbers = [_changed(register, fields, values, board.read(target.address)[0])]
        for address, word in enumerate(numbers, target.address // 4):
            if 4 * address in LOOKS and (slot := LOOK_SLOT.value(word)) >= slots:
                text = " ".join(values)
                raise input_error(text, f"the board has no slot {slot}", f"it has {slots}: give 0 to {slots - 1}")
        board.write(target.address, numbers)
    result = {"address": target.address, "words": numbers}
    emit(result, f"0x{target.address:03X}  {' '.join(f'0x{n:08X}' for n in numbers)}")


def _check_scene(board: Board, name: str, address: int, count: int) -> int:
    """Return a board's number of slots, 0 for registers other than the scene's; refuse those that it does not have.

    Raises DeviceError for a board that draws no scenes, InputError for a layer that it does not have.
    """
    if not SCENE_BASE <= address < SCENE_BASE + SCENE_BYTES:
        return 0
    build = SceneBoard(board).build
    if address + 4 * count > LAYERS_BASE + 4 * LAYER_WORDS * build.layers:
        what = f"the board has {build.layers} layers, 0 to {build.layers - 1}"
        raise input_error(name, what, "see docs/generated/scene-registers.md")
    return build.slots_built


def _register(name: str) -> Register:
    """Return a register by its name, or one without fields by its address."""
    if name in REGISTERS:
        return REGISTERS[name]
    try:
        return Register(int(name, 0))
    except ValueError:
        remedy = did_you_mean(name, REGISTERS) or "see docs/generated/board-registers.md"
        raise input_error(name, "no such register", remedy) from None


def _check_named(argument_text: str, name: str, field: Field, word: int) -> None:
    """Refuse a word with an undefined value in a field; `argument_text` is what the user wrote."""
    value = (word & field.mask) >> field.low
    if field.names and value not in dict(field.names):
        listed = ", ".join(f"{number} {meaning}" for number, meaning in field.names)
        raise input_error(argument_text, f"{name} {value} is not defined", f"choose from {listed}")


def _number(argument_text: str, text: str, field: Field) -> int:
    """Return the register word of a number in a field; `argument_text` is what the user wrote."""
    try:
        number = int(text, 0)
    except ValueError:
        raise input_error(argument_text, "is not an integer", "give one such as 12 or 0x1F") from None
    low, high = field.limits
    if not low <= number <= high:
        raise input_error(argument_text, "is out of range", f"give {low} to {high}")
    return field.bits(number)


def _changed(register: str, fields: dict[str, Field], values: tuple[str, ...], word: int) -> int:
    """Return a register's word with some of its fields changed."""
    names = [value.partition("=")[0] for value in values]
    if len(set(names)) < len(names):
        raise InputError(f"{' '.join(values)}: a field is named twice; name each once")
    for name, value in zip(names, values, strict=True):
        if name not in fields:
            remedy = did_you_mean(name, fields) or f"choose from {', '.join(fields)}"
            raise input_error(value, f"{register} has no field {name}", remedy)
        field = fields[name]
        word = word & ~field.mask | _number(value, value.partition("=")[2], field)
        _check_named(value, name, field, word)
    return word

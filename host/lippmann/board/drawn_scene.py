"""Control a scene that the board draws: load textures, write layer registers, show the scene."""

from __future__ import annotations

import struct
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from lippmann.base.progress_protocol import Progress
from lippmann.base.toml import documented, key
from lippmann.board.board import FRAME_SECONDS, QUERY_S, Board
from lippmann.board.packets import SCENE_VERSION, Kind, ReplyStatus
from lippmann.board.retries import END_SCENE, MAX_ROUNDS, UPDATE, Window, refusal
from lippmann.board.session import REGISTERS
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.fixed.scene_build import BLOCK_BYTES, CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import scene_words
from lippmann.fixed.scene_pipeline import LayerWords, SceneWords
from lippmann.layers.layers_and_pictures import check_for_display
from lippmann.layers.stack import LayerStack

#: Maximum unacknowledged bytes: one block on the line and one in the board.
BLOCKS_WINDOW_BYTES = 2 * (BLOCK_BYTES + 16)

BLOCK_REQUEST = struct.Struct("<BB")
BLOCKS_REQUEST = struct.Struct("<BBB")


@documented
@dataclass
class Loaded:
    """Counts of a transfer of textures into slots."""

    blocks: Annotated[int, key("blocks of the contents")] = 0
    skipped: Annotated[int, key("blocks that the board already had")] = 0
    sends: Annotated[int, key("BLOCK packets sent")] = 0
    wire_bytes: Annotated[int, key("bytes written to the line")] = 0
    seconds: Annotated[float, key("time from the first request until the board had all blocks, s")] = 0.0


@dataclass(frozen=True)
class SceneStatus:
    """Status of the scene; `waits` is True until written registers take effect."""

    is_shown: bool
    waits: bool
    slots: frozenset[int]  # slots in use
    frames: int
    underflows: int  # number of pixels not drawn in time


#: Register words per layer.
LAYER_WORDS = 8
#: Addresses of the first lattice and the first layer register.
_COMMON, LAYERS_BASE = REGISTERS["scene.lattice_xi"].address, REGISTERS["scene.layer_0_s0"].address


def _common_words(words: SceneWords) -> list[int]:
    lattice = (words.lattice_xi, words.lattice_xj, words.lattice_yj)
    return [*(word & 0xFFFFFFFF for word in lattice), *words.background]


class SceneBoard:
    """The scene of an open board; raises DeviceError if the board cannot draw scenes."""

    def __init__(self, board: Board) -> None:
        self.board = board
        if board.info.version < SCENE_VERSION:
            what = f"the board has protocol version {board.info.version} and draws no scenes"
            remedy = "use a board that draws (lippmann board start --layers 4), or stream a rendered image"
            raise board.error(what, remedy)
        register = REGISTERS["scene.identity"]
        major = REGISTERS["scene.version"].fields["major"]
        identity, version, word = board.read(register.address, 3)
        if identity != register.fields["letters"].reset or major.value(version) != major.reset:
            what = f"this host does not know the scene block 0x{identity:08X}, version {major.value(version)}"
            raise board.error(what, UPDATE)
        #: Build parameters of the board's scene block.
        self.build = SceneBuild.of_word(word)
        self._words: list[int] | None = None  # layer words that the board has, if known

    def crcs(self, slot: int) -> list[int]:
        """Return the CRC-32 of each block of a slot; 0 for an incomplete block."""
        count = 8 if slot == CURVE_SLOT else self.build.blocks
        crcs: list[int] = []
        for first in range(0, count, 255):
            size = min(255, count - first)
            body = self.board.ask(Kind.BLOCKS, BLOCKS_REQUEST.pack(slot, first, size), 2 + 4 * size)
            crcs += struct.unpack(f"<{size}I", body[2:])
        return crcs

    def load(
        self,
        contents: Mapping[int, bytes],
        progress: Progress | None = None,
        window_bytes: int = BLOCKS_WINDOW_BYTES,
        loaded: Loaded | None = None,
    ) -> Loaded:
        """Load textures into slots. Blocks that the board already has are not sent again.

        `contents` maps a slot to its bytes: texels row by row, then the palette
        (`slot_bytes`); slot 15 contains the panel's transfer curve. `progress` counts
        blocks. `loaded` receives the counts, even if the load fails. Raises InputError
        for contents of a wrong size, DeviceError if a slot is shown or no board
        answers.
        """
        # An item's low 8 bits are the block's number, its high bits the slot's.
        blocks = {
            slot << 8 | number: block
            for slot, content in contents.items()
            for number, block in enumerate(self._blocks(slot, content))
        }
        loaded = Loaded() if loaded is None else loaded
        loaded.blocks += len(blocks)
        begun, written = time.monotonic(), self.board.line.written

        def request(item: int) -> bytes:
            loaded.sends += 1
            return BLOCK_REQUEST.pack(*divmod(item, 256)) + blocks[item]

        def is_stored(_: int, body: bytes, status: ReplyStatus, reply: bytes) -> bool:
            if status != ReplyStatus.OK or reply != body[: BLOCK_REQUEST.size]:
                raise refusal(self.board.line.url, Kind.BLOCK, status, reply)
            return True

        try:
            for turn in range(MAX_ROUNDS):
                crcs = {slot << 8 | n: crc for slot in contents for n, crc in enumerate(self.crcs(slot))}
                missing = [item for item, data in blocks.items() if crcs[item] != zlib.crc32(data) or not crcs[item]]
                missing = missing if turn == 0 else [item for item in missing if zlib.crc32(blocks[item])]
                if turn == 0:
                    loaded.skipped += len(blocks) - len(missing)
                if not missing:
                    return loaded
                window = Window(self.board, Kind.BLOCK, window_bytes, request, is_stored)
                window.run(missing, len(blocks), progress)
        finally:
            loaded.wire_bytes += self.board.line.written - written
            loaded.seconds += time.monotonic() - begun
        what = f"the board's textures are still incomplete after {MAX_ROUNDS} attempts"
        raise self.board.error(what, "check the board's power; close other programs that use it")

    def _blocks(self, slot: int, content: bytes) -> list[bytes]:
        size = 8 * BLOCK_BYTES if slot == CURVE_SLOT else self.build.slot_bytes
        if not (0 <= slot < self.build.slots_built or slot == CURVE_SLOT):
            what = f"the board has no slot {slot}"
            raise InputError(f"{what}; give 0 to {self.build.slots_built - 1}, or {CURVE_SLOT} for the curve")
        if len(content) != size:
            raise InputError(f"slot {slot} takes {size} bytes, not {len(content)}; give contents of this size")
        return _cut(content)

    def holds(self, slot: int, content: bytes) -> bool:
        """Return whether a slot contains exactly these bytes."""
        return self.crcs(slot) == list(map(zlib.crc32, _cut(content)))

    def free_slots(self, contents: Sequence[bytes]) -> list[int]:
        """Return a slot for each texture: one that already contains it, or a writable slot.

        Raises DeviceError if too few slots are available.
        """
        busy = self.status().slots
        crcs = {slot: self.crcs(slot) for slot in range(self.build.slots_built)}
        requested = [list(map(zlib.crc32, _cut(content))) for content in contents]
        # Use shown slots with equal content first; then prefer slots with many equal blocks.
        slots: dict[int, int] = {}
        alike = sorted(
            (slot not in busy, -sum(a == b and a != 0 for a, b in zip(crcs[slot], one, strict=True)), slot, k)
            for slot in crcs
            for k, one in enumerate(requested)
            if slot not in busy or crcs[slot] == one
        )
        for _, _, slot, k in alike:
            if k not in slots and slot not in slots.values():
                slots[k] = slot
        if len(slots) < len(contents):
            what = f"{len(contents)} textures need slots, but the board shows {len(busy - {CURVE_SLOT})} of its "
            raise self.board.error(f"{what}{self.build.slots_built} slots", END_SCENE)
        return [slots[k] for k in range(len(contents))]

    def set_stack(self, display: Display, stack: LayerStack, slots: Sequence[int] | None = None) -> int:
        """Write the changed layer registers in one request; return the number of written words.

        The change takes effect at the next frame. The board's unused layers are hidden.
        Lattice and background do not change. The texture of layer k is in slot k, or in
        `slots[k]` if given. Raises InputError for layers at or behind the eyes, and for
        values out of range.
        """
        return self._write_layers(self._scene_words(display, stack, slots))

    def prepare(self, display: Display, stack: LayerStack, slots: Sequence[int] | None = None) -> None:
        """Write optics, lattice, background and layers; call it only while no scene is shown.

        Raises the errors of `set_stack`.
        """
        words = self._scene_words(display, stack, slots)
        self.board.write_optics(display)
        self.board.write(_COMMON, _common_words(words))
        self._words = None
        self._write_layers(words)

    def _write_layers(self, words: SceneWords) -> int:
        hidden = [LayerWords()] * (self.build.layers - len(words.layers))
        every = [word for layer in (*words.layers, *hidden) for word in layer.words]
        before = self._words or [-1] * len(every)
        changed = [k for k, (old, new) in enumerate(zip(before, every, strict=True)) if old != new]
        if not changed:
            return 0
        first, last = changed[0], changed[-1]
        # If the request fails, the board may or may not have executed it.
        self._words = None
        self.board.write(LAYERS_BASE + 4 * first, every[first : last + 1])
        self._words = every
        return last + 1 - first

    def holds_common(self, display: Display, stack: LayerStack) -> bool:
        """Return whether the board's lattice and background match a display and stack."""
        words = _common_words(scene_words(display, stack, self.build))
        return self.board.read(_COMMON, len(words)) == words

    def draw(self, scene: bool) -> None:
        """Show the scene, or the stored frame if `scene` is False; return when it is shown."""
        self.board.write(REGISTERS["scene.source"].address, [int(scene)])
        self.wait(scene)

    def wait(self, scene: bool | None = None) -> None:
        """Wait until written registers take effect, and the panel shows the scene or stored frame.

        If `scene` is None, wait only for registers. Raises DeviceError after `FRAME_SECONDS`.
        """
        until = time.monotonic() + FRAME_SECONDS
        while (status := self.status()).waits or scene not in (None, status.is_shown):
            if time.monotonic() > until:
                what = "the panel does not change to the " + ("stored frame" if scene is False else "scene")
                raise self.board.error(what, "check the board's clock and cable")
            time.sleep(QUERY_S)

    def status(self) -> SceneStatus:
        """Return the scene's status, with counts of frames and underflows."""
        register = REGISTERS["scene.status"]
        word, frames, underflows = self.board.read(register.address, 3)
        value = register.values(word)
        slots = frozenset(slot for slot in range(16) if value["slots"] >> slot & 1)
        return SceneStatus(bool(value["shown"]), bool(value["waits"]), slots, frames, underflows)

    def _scene_words(self, display: Display, stack: LayerStack, slots: Sequence[int] | None) -> SceneWords:
        check_for_display(stack, display)
        if len(stack.layers) > self.build.layers:
            what = f"{len(stack.layers)} layers do not fit the board, which draws {self.build.layers}"
            raise InputError(f"{what}; cut the scene again with lippmann layers --count {self.build.layers}")
        slots = range(len(stack.layers)) if slots is None else slots
        if len(slots) != len(stack.layers):
            raise InputError(f"{len(slots)} slots for {len(stack.layers)} layers; give each layer one slot")
        return scene_words(display, stack, self.build, tuple(slots))


def _cut(content: bytes) -> list[bytes]:
    return [content[at : at + BLOCK_BYTES] for at in range(0, len(content), BLOCK_BYTES)]

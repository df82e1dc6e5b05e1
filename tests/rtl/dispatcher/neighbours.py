"""All that is around the dispatcher: a monitor of its two streams that also plays its other neighbours."""

import random

import rules
from packets import Joined
from pins import Pins
from streams import Monitor


class Neighbours(Monitor):
    """Each neighbour takes a random time, up to `slow` clocks and its own least; what nobody says is noise."""

    def __init__(self, dut, epoch: int, slow: int):
        clock, dut = dut.clk_i, Pins(dut)
        put = Joined(dut.in_last_i, dut.in_data_i).put
        out = Joined(dut.out_last_o, dut.out_data_o)
        streams = (dut.in_valid_i, dut.in_ready_o, dut.out_valid_o, dut.out_ready_i)
        super().__init__(clock, *streams, out, put, through=True)
        self.dut, self.epoch, self.slow = dut, epoch, slow
        self.stale = self.tile_bad = 0
        #: The scene's words written while `update_o` was high, each time that it was.
        self.updates: list[list[tuple[int, int]]] = []
        self._updating = False
        #: What was done, in order.
        self.log: list[tuple] = []
        self._first = True  # byte of a request
        self._clearing: list[int] = []
        self._start()
        self.idle()

    def _start(self) -> None:
        """As after power-up."""
        self.registers, self.optics, self.drawing = rules.at_reset(), rules.Optics(), rules.Drawing()
        self._block = None
        self._asked_block = [0, 0, 0]
        self._bus = self._tile = self._present = self._ray = None
        self._signing = self._signed = False
        self._asked = [0, 0, 0]

    def idle(self) -> None:
        """Say nothing."""
        self.driven, dut = None, self.dut
        for handle in (
            dut.in_valid_i, dut.out_ready_i, dut.in_data_i, dut.in_last_i, dut.bus_done_i, dut.tile_ready_i,
            dut.tile_done_i, dut.table_busy_i, dut.present_done_i, dut.ray_ready_i, dut.exit_valid_i, dut.sign_done_i,
            dut.block_done_i, dut.blocks_busy_i, dut.drawn_i, dut.slots_i,
        ):  # fmt: skip
            handle.value = 0
        dut.epoch_i.value = self.epoch

    def wait(self, least: int) -> int:
        return least + random.choice([0, 0, random.randint(0, self.slow)])

    async def clock(self, word, take):
        self._resets()
        self._registers()
        self._tiles()
        self._frames()
        self._rays()
        self._scene()
        self.stale += int(self.dut.stale_o.value)
        self.tile_bad += int(self.dut.tile_bad_o.value)
        into = await super().clock(word, take)
        if into:
            if self._first and self.optics.next_request() and self._signing:
                self._signing, self._signed = False, True
            if self._first:
                self.drawing.next_request()
            self._first = bool(word & 0x100)
        return into

    def _resets(self) -> None:
        """All but the link is reset, and the table cleared."""
        dut = self.dut
        if dut.reset_o.value:
            if not self._clearing:
                assert (self._bus, self._tile, self._present, self._ray, self._block) == (None,) * 5
                self.log.append(("reset",))
            self._start()
            self.epoch = 0
            self.idle()
            self._clearing = [self.wait(2), self.wait(2)]
            dut.table_busy_i.value = dut.blocks_busy_i.value = 1
        elif self._clearing:
            self._clearing = [left - 1 for left in self._clearing]
            for left, handle in zip(self._clearing, (dut.table_busy_i, dut.blocks_busy_i), strict=True):
                handle.value = left > 0
            if max(self._clearing) <= 0:
                self._clearing = []

    def settled(self) -> None:
        dut = self.dut
        if self._tile and dut.tile_valid_o.value and dut.tile_ready_i.value:
            self._tile["data"].append(int(dut.tile_data_o.value))
            if dut.tile_last_o.value:
                self._tile["left"] = self.wait(2)

    def _registers(self) -> None:
        dut = self.dut
        dut.bus_done_i.value = 0
        dut.bus_word_i.noise(32)
        dut.bus_error_i.noise(1)
        if dut.bus_start_o.value:
            assert self._bus is None, "an access began before the one before it was answered"
            asked = (dut.bus_write_o, dut.bus_at_o, dut.bus_word_o)
            self._bus = [self.wait(2), *(int(handle.value) for handle in asked)]
        elif self._bus is not None:
            self._bus[0] -= 1
            if self._bus[0] == 0:
                _, write, at, word = self._bus
                self._bus = None
                dut.bus_done_i.value = 1
                if write:
                    dut.bus_error_i.value = not self._write(at, word)
                else:
                    dut.bus_error_i.value = not rules.can_read(at)
                    if rules.can_read(at):
                        dut.bus_word_i.value = self._read(at)

    def _read(self, at: int) -> int:
        return self.optics.status() if at == rules.STATUS else self.registers[at]

    def _write(self, at: int, word: int) -> bool:
        self.log.append(("write", at, word))
        if at == rules.CONTROL:
            if word & rules.ABORT:
                self._signing = False
            self.optics.control(word, self.registers[rules.WINDOW])
        elif rules.can_write(at):
            self.registers[at] = word
            if at == rules.SOURCE:
                self.optics.source = bool(word & 1)
            if at == rules.DRAW:
                self.drawing.write(word)
            if at >= 0x400:
                assert self._updating, "a word of the scene came without a word of warning"
                self.updates[-1].append((at, word))
        return rules.can_write(at)

    def _tiles(self) -> None:
        dut = self.dut
        dut.tile_done_i.value = 0
        dut.tile_ok_i.noise(1)
        if dut.tile_start_o.value:
            assert self._tile is None
            place = (int(dut.tile_o.value), int(dut.tile_coding_o.value))
            self._tile = {"place": place, "data": bytearray(), "left": None}
            if dut.tile_empty_o.value:
                self._tile["left"] = self.wait(2)
        elif self._tile and self._tile["left"] is not None:
            self._tile["left"] -= 1
            if self._tile["left"] == 0:
                told = (*self._tile["place"], bytes(self._tile["data"]))
                self._tile = None
                self.log.append(("tile", *told))
                dut.tile_done_i.value, dut.tile_ok_i.value = 1, rules.tile_is_good(*told)
        else:
            open_ = self._tile is not None and self._tile["left"] is None
            dut.tile_ready_i.value = open_ and (self.slow == 0 or random.random() < 0.7)
            return
        dut.tile_ready_i.value = 0

    def _scene(self) -> None:
        """Of the drawing whether it has the optics and slots; of the loader a block, read word by word."""
        dut = self.dut
        if not rules.LAYERS:
            assert not dut.update_o.value
            assert not dut.block_start_o.value
            return
        updating = bool(dut.update_o.value)
        if updating and not self._updating:
            self.updates.append([])
        elif self._updating and not updating and not self.updates[-1]:
            self.updates.pop()  # refused
        self._updating = updating
        dut.drawn_i.value = self.drawing.on
        dut.slots_i.value = rules.slots(self.registers[rules.LOOK], self.drawing.on)
        dut.blocks_crc_i.value = self._asked_block.pop(0)
        self._asked_block.append(rules.block_crc(int(dut.blocks_slot_o.value), int(dut.blocks_at_o.value)))
        dut.block_done_i.value = 0
        if dut.block_start_o.value:
            assert self._block is None
            self._block = {"place": (int(dut.block_slot_o.value), int(dut.block_o.value)), "words": [], "next": 0}
            self._words_at = [None, None]
        elif self._block:
            words = self._block["words"]
            # What stands there now was asked for two clocks ago.
            if self._words_at.pop(0) is not None:
                words.append(int(dut.block_word_o.value))
            asks = self._block["next"] < 256 and (self.slow == 0 or random.random() < 0.9)
            self._words_at.append(self._block["next"] if asks else None)
            self._block["next"] += asks
            if len(words) == 256:
                self._block.setdefault("left", self.wait(1))
                self._block["left"] -= 1
                if self._block["left"] == 0:
                    data = b"".join(word.to_bytes(4, "little") for word in words)
                    self.log.append(("block", *self._block["place"], data))
                    self._block = None
                    dut.block_done_i.value = 1
        at = None if self._block is None else self._words_at[-1]
        if at is None:
            dut.block_word_at_i.noise(8)
        else:
            dut.block_word_at_i.value = at

    def _frames(self) -> None:
        """Of the table an answer three clocks old; of the presenter a status, and an epoch with it."""
        dut = self.dut
        dut.table_crc_i.value = self._asked.pop(0)
        self._asked.append(rules.table_crc(bool(dut.table_front_o.value), int(dut.table_at_o.value)))
        dut.present_done_i.value = 0
        dut.present_status_i.noise(3)
        if dut.present_start_o.value:
            assert self._present is None
            self._present = [self.wait(1), int(dut.present_epoch_o.value), int(dut.present_crc_o.value)]
        elif self._present:
            self._present[0] -= 1
            if self._present[0] == 0:
                self.log.append(("present", *self._present[1:]))
                status = rules.presented(self._present[2])
                dut.present_done_i.value, dut.present_status_i.value = 1, status
                self.epoch = (self.epoch + (status == rules.OK)) % (1 << 16)
                dut.epoch_i.value = self.epoch
                self._present = None

    def _rays(self) -> None:
        dut = self.dut
        # Of the signature: its end goes a clock behind its start.
        dut.sign_done_i.value = self._signed
        if dut.sign_start_o.value:
            self._signing, self._signed = True, False
        frames = self.optics.frames
        if self._signed:
            dut.sign_rays_i.value, dut.sign_crc_i.value = rules.signature(frames)
        else:
            dut.sign_rays_i.value = rules.so_far(frames)
            dut.sign_crc_i.noise(32)
        assert not (dut.trace_o.value and dut.sign_o.value)
        if self.optics.running:
            assert not dut.trace_o.value, "rays of a frame go to a trace"
        # Of the pipeline: one ray at a time, of the list or of a frame.
        dut.exit_i.noise(288)
        if self.optics.running and not self.optics.stream:
            dut.exit_valid_i.value = random.getrandbits(1)
        elif self._ray is None:
            dut.exit_valid_i.value = 0
        ready = self._ray is None and (self.slow == 0 or random.random() < 0.5)
        dut.ray_ready_i.value = ready
        if dut.ray_valid_o.value and ready:
            assert self.optics.stream, "a ray came while the raster was the source"
            words = int(dut.ray_o.value)
            ray = tuple(words >> 32 * k & 0xFFFF_FFFF for k in range(4))
            self.log.append(("ray", *ray))
            self._ray = [self.wait(1), rules.exit_ray(ray)]
        elif self._ray:
            self._ray[0] -= 1
            if self._ray[0] <= 0:
                assert dut.trace_o.value, "traced rays go to the reply"
                dut.exit_valid_i.value = 1
                dut.exit_i.value = sum(word << 32 * k for k, word in enumerate(self._ray[1]))
                if dut.exit_ready_o.value:
                    self._ray = None

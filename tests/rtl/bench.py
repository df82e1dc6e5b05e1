"""One bench for several modules that never stall: a word in and a word out, each clock.

Compiling costs more than running, so all steps of one F share a bench. Each test picks its module with `select_i`,
holds that module's configuration, streams words, and compares what comes out `latency_o` clocks later, every bit of
it: a word that is a clock early or late is a wrong word. The registers around the modules take the simulator's order
of events out of the question, also where the latency is 0.
"""

import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from lippmann.simulation.toolchain import PREFIX
from runner import compiled, seed_options

Ints = npt.NDArray[np.int64]
Widths = Mapping[str, int]


@dataclass(frozen=True)
class Instance:
    """A module as built: its ports with their bits, and the latency that its package claims.

    `config` names the inputs that hold still while words stream, as registers do in a design.
    `clocked`: it has a clock.
    """

    module: str
    inputs: Widths
    outputs: Widths
    latency: str
    parameters: Mapping[str, int | str] = field(default_factory=dict)
    config: Widths = field(default_factory=dict)
    clocked: bool = True

    @property
    def name(self) -> str:
        return "_".join([self.module, *(f"{key}{value}".replace("'", "") for key, value in self.parameters.items())])


#: The C++ that drives the bench: cocotb takes longer to start than a step's words to stream.
MAIN = Path(__file__).with_name("stream_words.cpp")


class Segment(NamedTuple):
    """A configuration, words that stream through it, and what must come out."""

    config: Mapping[str, int]
    words: Mapping[str, Ints]
    expected: Mapping[str, Ints]


def wide(instances: Sequence[Instance], ports: str) -> int:
    """32-bit words of a port of the bench that holds any instance's ports of one kind: more than 64 bits."""
    return max(3, *(-(-sum(getattr(i, ports).values()) // 32) for i in instances))


def bench_text(instances: Sequence[Instance]) -> str:
    """The SystemVerilog of a bench around instances."""
    config, inputs, outputs = (32 * wide(instances, ports) for ports in ("config", "inputs", "outputs"))
    lines = [
        "module bench(",
        "  input  logic clk_i,",
        "  input  logic [7:0] select_i,",
        f"  input  logic [{config - 1}:0] config_i,",
        f"  input  logic [{inputs - 1}:0] word_i,",
        f"  output logic [{outputs - 1}:0] word_o,",
        "  output logic [31:0] latency_o",
        ");",
        f"  logic [{config - 1}:0] config_q;",
        f"  logic [{inputs - 1}:0] word_q;",
        "  always_ff @(posedge clk_i) begin",
        "    config_q <= config_i;",
        "    word_q <= word_i;",
        "  end",
        f"  logic [{outputs - 1}:0] out[{len(instances)}];",
        f"  int latency[{len(instances)}];",
        "  always_ff @(posedge clk_i) word_o <= out[select_i];",
        "  assign latency_o = latency[select_i];",
    ]
    for k, one in enumerate(instances):
        ports = [".clk_i"] * one.clocked
        for source, widths in (("word_q", one.inputs), ("config_q", one.config)):
            at = 0
            for port, bits in widths.items():
                ports.append(f".{port}({source}[{at}+:{bits}])")
                at += bits
        at = 0
        total = sum(one.outputs.values())
        lines.append(f"  logic [{total - 1}:0] out{k};")
        for port, bits in one.outputs.items():
            ports.append(f".{port}(out{k}[{at}+:{bits}])")
            at += bits
        values = ", ".join(f".{name}({value})" for name, value in one.parameters.items())
        lines.append(f"  assign out[{k}] = {outputs}'(out{k});")
        lines.append(f"  assign latency[{k}] = {one.latency};")
        lines.append(f"  {PREFIX}{one.module} #({values}) i_{k} ({', '.join(ports)});")
    return "\n".join([*lines, "endmodule", ""])


def pack(widths: Widths, words: Mapping[str, Ints | int]) -> list[int]:
    """Words of several ports as one, the first port lowest."""
    assert set(widths) == set(words), f"ports {sorted(widths)}, words {sorted(words)}"
    total: npt.NDArray[np.object_] = np.zeros(1, object)
    at = 0
    for port, bits in widths.items():
        word = np.asarray(words[port]).astype(object)
        total = total + ((word & ((1 << bits) - 1)) << at)
        at += bits
    return [int(w) for w in total]


def stream(instances: Sequence[Instance], batch: Sequence[tuple[Instance, Segment]], bench: str, seed: int) -> None:
    """Compile a bench, stream segments of words through instances of it, and compare each word that comes out."""
    program = compiled("bench", bench=bench_text(instances), name=bench, main=MAIN)
    plan, expected = [], []
    for select, (config, words, outputs) in batch:
        put = _in_32_bits(pack(select.inputs, words), wide(instances, "inputs"))
        expected.append(_in_32_bits(pack(select.outputs, outputs), wide(instances, "outputs")))
        assert len(put) == len(expected[-1]) > 0
        settings = _in_32_bits(pack(select.config, config), wide(instances, "config"))
        plan += [np.array([list(instances).index(select), len(put)], "<u4"), settings, put]
    assert plan
    given = b"".join(part.tobytes() for part in plan)
    done = subprocess.run([program, *seed_options(seed)], input=given, capture_output=True, check=False)
    assert done.returncode == 0, f"seed {seed}: {(done.stdout + done.stderr).decode(errors='replace')}"
    words_out = np.frombuffer(done.stdout, "<u4").reshape(-1, wide(instances, "outputs"))
    assert len(words_out) == sum(map(len, expected))
    ends = np.cumsum([len(wanted) for wanted in expected])
    for (select, segment), wanted, got in zip(batch, expected, np.split(words_out, ends[:-1]), strict=True):
        wrong = np.flatnonzero((got != wanted).any(axis=1))
        assert not len(wrong), (
            f"{select.name}, config {segment.config}, word {wrong[0]} and {len(wrong) - 1} more, seed {seed}:\n"
            f"RTL  {unpack(select.outputs, got[wrong[0]])}\ntwin {unpack(select.outputs, wanted[wrong[0]])}"
        )


def _in_32_bits(words: Sequence[int], count: int) -> npt.NDArray[np.uint32]:
    """Words as `count` words of 32 bits each, the lowest first."""
    return np.frombuffer(b"".join(word.to_bytes(4 * count, "little") for word in words), "<u4").reshape(-1, count)


def unpack(widths: Widths, words: npt.NDArray[np.uint32]) -> dict[str, int]:
    """The signed numbers of the ports in a word, given as 32-bit words."""
    word = int.from_bytes(words.tobytes(), "little")
    values = {}
    for port, bits in widths.items():
        value = word & ((1 << bits) - 1)
        values[port] = value - (1 << bits) if value >> (bits - 1) and bits > 1 else value
        word >>= bits
    return values

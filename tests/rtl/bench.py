"""One bench for several modules that never stall: a word in and a word out, each clock.

Compiling costs more than running, so all steps of one F share a bench. Each test picks its module with `select_i`,
holds that module's configuration, streams words, and compares what comes out `latency_o` clocks later, every bit of
it: a word that is a clock early or late is a wrong word. The registers around the modules take the simulator's order
of events out of the question, also where the latency is 0.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from runner import compiled, simulate

Ints = npt.NDArray[np.int64]
Widths = Mapping[str, int]


@dataclass(frozen=True)
class Instance:
    """A module as built: its ports with their bits, and the latency that its package claims.

    `config` names the inputs that hold still while words stream, as registers do in a design.
    """

    module: str
    inputs: Widths
    outputs: Widths
    latency: str
    parameters: Mapping[str, int] = field(default_factory=dict)
    config: Widths = field(default_factory=dict)

    @property
    def name(self) -> str:
        return "_".join([self.module, *(f"{key}{value}" for key, value in self.parameters.items())])


class Segment(NamedTuple):
    """A configuration, words that stream through it, and what must come out."""

    config: Mapping[str, int]
    words: Mapping[str, Ints]
    expected: Mapping[str, Ints]


def bench_text(instances: Sequence[Instance]) -> str:
    """The SystemVerilog of a bench around instances."""

    def wide(ports: str) -> int:
        return max([1, *(sum(getattr(i, ports).values()) for i in instances)])

    lines = [
        "module bench(",
        "  input  logic clk_i,",
        "  input  logic [7:0] select_i,",
        f"  input  logic [{wide('config') - 1}:0] config_i,",
        f"  input  logic [{wide('inputs') - 1}:0] word_i,",
        f"  output logic [{wide('outputs') - 1}:0] word_o,",
        "  output logic [31:0] latency_o",
        ");",
        f"  logic [{wide('config') - 1}:0] config_q;",
        f"  logic [{wide('inputs') - 1}:0] word_q;",
        "  always_ff @(posedge clk_i) begin",
        "    config_q <= config_i;",
        "    word_q <= word_i;",
        "  end",
        f"  logic [{wide('outputs') - 1}:0] out[{len(instances)}];",
        f"  int latency[{len(instances)}];",
        "  always_ff @(posedge clk_i) word_o <= out[select_i];",
        "  assign latency_o = latency[select_i];",
    ]
    for k, one in enumerate(instances):
        ports = [".clk_i"]
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
        lines.append(f"  assign out[{k}] = {wide('outputs')}'(out{k});")
        lines.append(f"  assign latency[{k}] = {one.latency};")
        lines.append(f"  {one.module} #({values}) i_{k} ({', '.join(ports)});")
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


def stream(
    instances: Sequence[Instance],
    batch: Sequence[tuple[Instance, Segment]],
    bench: str,
    seed: int,
) -> None:
    """Compile a bench and stream segments of words through instances of it."""
    program = compiled("bench", bench=bench_text(instances), name=bench)
    plan = []
    for select, (config, words, expected) in batch:
        packed, wanted = pack(select.inputs, words), pack(select.outputs, expected)
        assert len(packed) == len(wanted) > 0
        plan.append(
            {
                "name": select.name,
                "select": list(instances).index(select),
                "inputs": dict(select.inputs),
                "outputs": dict(select.outputs),
                "config": f"{pack(select.config, config)[0]:x}" if select.config else "0",
                "words": [f"{w:x}" for w in packed],
                "expected": [f"{w:x}" for w in wanted],
            }
        )
    assert plan
    with tempfile.NamedTemporaryFile("w", dir=program.parent, prefix="plan-", suffix=".json") as file:
        json.dump(plan, file)
        file.flush()
        simulate(program, "bench", "stream_words", seed, {"LIPPMANN_PLAN": file.name})


def unpack(widths: Widths, word: int) -> dict[str, int]:
    """The signed numbers of a packed word's ports."""
    values = {}
    for port, bits in widths.items():
        value = word & ((1 << bits) - 1)
        values[port] = value - (1 << bits) if value >> (bits - 1) and bits > 1 else value
        word >>= bits
    return values

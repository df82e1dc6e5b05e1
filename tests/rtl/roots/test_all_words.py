"""Every input word of the roots through the RTL, equal to the twin; its error: tests/host/test_fixed_roots.py."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from lippmann.fixed.words import rsqrt, sqrt
from lippmann.simulation.compilation import cached_file, verilated
from lippmann.simulation.toolchain import needed, rtl_sources
from runner import BUILD, TOP

CHUNK = 1 << 22


def bench(module: str, latency: str, parameters: str) -> str:
    return f"""
module root_bench #(parameter int F = 23) (
  input  logic         clk_i,
  input  logic [F+2:0] x_i,
  output logic [F+1:0] y_o,
  output int           latency_o
);
  assign latency_o = lipp_math_pkg::{latency};
  lipp_{module} #(.F(F){parameters}) i_root (.clk_i, .x_i, .y_o);
endmodule
"""


def library(name: str, text: str, f: int) -> ctypes.CDLL:
    sources, main = needed(text, rtl_sources(TOP)), Path(__file__).with_name("sweep.cpp")

    def make(path: Path) -> None:
        beside = path.with_name("root_bench.sv")
        beside.write_text(text)
        verilated(path, "root_bench", [*sources, beside], [main], {"F": f}, options=["-Wno-fatal"])

    path = cached_file(BUILD / f"all-{name}-F{f}", [*sources, main, text, str(f)], make, ".so")
    made = ctypes.CDLL(str(path))
    made.lippmann_sweep.argtypes = [ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p]
    return made


def compare(made, low, high, twin) -> int:
    compared = 0
    for start in range(low, high, CHUNK):
        stop = min(start + CHUNK, high)
        out = np.full(stop - start, -1, np.int32)
        made.lippmann_sweep(start, stop, out.ctypes.data)
        x = np.arange(start, stop, dtype=np.int64)
        wrong = np.flatnonzero(out != twin(x))
        assert not len(wrong), f"word {x[wrong[0]]}: RTL {out[wrong[0]]}, twin {twin(x[wrong[:1]])[0]}"
        compared += len(out)
    return compared


@pytest.mark.parametrize(
    "f", [pytest.param(f, marks=[] if f == 16 else pytest.mark.full) for f in (14, 16, 18, 21, 22, 23)]
)
def test_rsqrt(f):
    made = library("rsqrt", bench("rsqrt", "rsqrt_latency()", ""), f)
    assert compare(made, 1 << (f + 1), 1 << (f + 3), lambda x: rsqrt(x, f)) == 3 << (f + 1)


@pytest.mark.full
@pytest.mark.parametrize("f", [14, 16, 18, 21, 22, 23])
def test_sqrt(f):
    made = library("sqrt", bench("sqrt", "sqrt_latency(1'b1)", ", .Normalise(1'b1)"), f)
    assert compare(made, 0, 1 << (f + 3), lambda x: sqrt(x, f)) == 1 << (f + 3)

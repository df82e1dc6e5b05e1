"""Every input word of the roots through the RTL, equal to the twin; its error: tests/host/test_fixed_roots.py."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest
from lippmann.fixed.rsqrt import rsqrt
from lippmann.fixed.sqrt import sqrt
from lippmann.sim.tools import MAKE_FLAGS, optics_sources, verilator_environment
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
  assign latency_o = optics_pkg::{latency};
  {module} #(.F(F){parameters}) i_root (.clk_i, .x_i, .y_o);
endmodule
"""


def library(name: str, text: str, f: int) -> ctypes.CDLL:
    folder = BUILD / f"all-{name}-F{f}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "root_bench.sv").write_text(text)
    command = [
        "verilator", "--cc", "--build", "-Mdir", str(folder), "-O3", "--top-module", "root_bench",
        "--lib-create", "root",
        f"-GF={f}", "-Wno-fatal", "-CFLAGS", "-fPIC -std=gnu++17",
        *(word for flag in MAKE_FLAGS for word in ("-MAKEFLAGS", flag)), "-MAKEFLAGS", "OPT_FAST=-O3",
        *map(str, optics_sources(TOP)), str(folder / "root_bench.sv"), str(Path(__file__).with_name("sweep.cpp")),
    ]  # fmt: skip
    done = subprocess.run(command, env=verilator_environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    made = ctypes.CDLL(str(folder / "libroot.so"))
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

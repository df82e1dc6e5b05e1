"""uart_tx, against the times at which each bit is due."""

from runner import run_cocotb


def test_uart_tx():
    run_cocotb("uart_tx")

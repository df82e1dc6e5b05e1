"""uart_tx, against the times at which each bit is due."""

from runner import compiled, seed, simulate


def test_uart_tx():
    program = compiled("uart_tx")
    simulate(program, "uart_tx", "cocotb_uart_tx", seed())

"""uart_rx, against a line that is timed in picoseconds."""

from runner import compiled, seed, simulate


def test_uart_rx():
    program = compiled("uart_rx")
    simulate(program, "uart_rx", "cocotb_uart_rx", seed())

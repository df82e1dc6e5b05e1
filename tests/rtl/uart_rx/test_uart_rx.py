"""uart_rx, against a line that is timed in picoseconds."""

from runner import compiled, seed, simulate


def test_uart_rx():
    folder = compiled("uart_rx", folders=("link",))
    simulate(folder, "uart_rx", "cocotb_uart_rx", seed())

"""The program `lippmann`, also as `python -m lippmann`: Ctrl-C and SIGTERM end it with one line, at any moment."""

from __future__ import annotations

import sys

from lippmann import interrupts


def main() -> None:
    """Load the command line and run it."""
    interrupts.install()
    try:
        from lippmann.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("lippmann: interrupted; nothing half-written is left", file=sys.stderr)
        sys.exit(interrupts.exit_code())


if __name__ == "__main__":
    main()

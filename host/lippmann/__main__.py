"""The program `lippmann`, also as `python -m lippmann`: Ctrl-C ends it with one line, while it is loaded too."""

from __future__ import annotations

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from lippmann.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("lippmann: interrupted; nothing half-written is left", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()

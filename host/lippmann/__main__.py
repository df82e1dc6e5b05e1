"""The program `lippmann`, also as `python -m lippmann`: Ctrl-C and SIGTERM end it with one line, at any moment."""

from __future__ import annotations

import atexit
import sys
import threading

from lippmann.base import interrupts


def main(arguments: list[str] | None = None) -> None:
    """Load the command line, run it, and exit with the code of its outcome."""
    interrupts.install()
    try:
        from lippmann.cli import run

        code = run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print("lippmann: interrupted; nothing half-written is left", file=sys.stderr)
        code = interrupts.exit_code()
    if interrupts.received:
        # Libraries that were interrupted while they loaded may crash when Python takes them down.
        interrupts.leave(code)
    interrupts.ignore()  # the work is done
    sys.exit(code)


def program() -> None:
    """Run `main`, then end the process at once: Python would first take down all libraries, which takes a while."""
    try:
        main()
    except SystemExit as end:
        # Threads that still run, debuggers and profilers need Python's own end.
        watched = sys.gettrace() is not None or sys.getprofile() is not None
        if isinstance(end.code, int) and threading.active_count() == 1 and not watched:
            atexit._run_exitfuncs()  # temporary folders go, too
            interrupts.leave(end.code)
        raise


if __name__ == "__main__":
    main()

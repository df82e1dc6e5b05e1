"""Entry point of `lippmann`; after Ctrl-C or SIGTERM, it prints one line and exits."""

from __future__ import annotations

import atexit
import sys
import threading

from lippmann.base import interrupts


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    interrupts.install()
    try:
        from lippmann.cli import run

        code = run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print("lippmann: interrupted; nothing half-written is left", file=sys.stderr)
        code = interrupts.exit_code()
    if interrupts.received:
        # A library may crash at Python's shutdown if its loading was interrupted.
        interrupts.leave(code)
    interrupts.ignore()
    sys.exit(code)


def program() -> None:
    """Run `main`, then exit without the slow unloading of libraries."""
    try:
        main()
    except SystemExit as end:
        # Running threads, debuggers and profilers need Python's normal shutdown.
        has_tracer = sys.gettrace() is not None or sys.getprofile() is not None
        if isinstance(end.code, int) and threading.active_count() == 1 and not has_tracer:
            atexit._run_exitfuncs()  # removes temporary folders
            interrupts.leave(end.code)
        raise


if __name__ == "__main__":
    main()

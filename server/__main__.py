"""The program behind `fingertwin`: Ctrl-C ends it with one line from its first import on."""

from __future__ import annotations

import signal

from server.leaving import INTERRUPTED_CODE, end, leave


def main() -> None:
    """Run the command line."""
    handled = signal.getsignal(signal.SIGINT)
    heeded = callable(handled)
    if heeded:
        signal.signal(signal.SIGINT, lambda number, frame: leave())
    from server.cli import main as run

    if heeded:
        signal.signal(signal.SIGINT, handled)
    try:
        run()
    except SystemExit as ended:
        if ended.code == INTERRUPTED_CODE:
            end()
        raise


if __name__ == "__main__":
    main()

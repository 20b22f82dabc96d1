"""The `relnav` command, and `python -m relnav`: answers signals from the first moment, then loads the command line."""

import os
import signal


def main() -> None:
    """Entry point of the `relnav` command."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, _end)
    from relnav.cli import main as run

    run()


def _end(number: int, frame: object) -> None:  # noqa: ARG001  (the signature of a signal's handler)
    """While the command line is still being loaded: nothing is open, and Python's own way would be a traceback."""
    os.write(2, f"relnav: {'interrupted' if number == signal.SIGINT else 'terminated'}; nothing was written\n".encode())
    os._exit(128 + number)


if __name__ == "__main__":
    main()

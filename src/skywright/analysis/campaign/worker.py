"""A local worker process: `python -m skywright.analysis.campaign.worker FD`.

Takes tasks from a connection and answers with rows (or what jobs return), or with why a task cannot
be read, until the other end is gone. A fresh interpreter, not a fork: threads of the parent (numba,
BLAS, a notebook) do not survive a fork.
"""

import gc
import signal
import sys
from multiprocessing.connection import Connection


def main() -> None:
    """Serve the connection whose file descriptor is the first argument."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    gc.set_threshold(50_000)  # as in cli/group.py
    connection = Connection(int(sys.argv[1]))
    from skywright.core.find import explain

    while True:
        try:
            answer: object = connection.recv().fly()
        except (EOFError, OSError):
            return  # the parent is gone, or has no more work
        except (Exception, SystemExit) as error:  # a file of the user's is gone, or wrong
            answer = explain(error)
        try:
            connection.send(answer)
        except (BrokenPipeError, ConnectionResetError):
            return


if __name__ == "__main__":
    main()

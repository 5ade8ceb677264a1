"""A local worker process (forks.py).

Receives tasks from a connection and sends their rows (or results of jobs), or the reason why a task
cannot be read, until the other end closes.
"""

from multiprocessing.connection import Connection

from skywright.core.find import explain


def serve(file: int) -> None:
    """Serve the connection with the file descriptor `file`."""
    connection = Connection(file)
    while True:
        try:
            answer: object = connection.recv().fly()
        except (EOFError, OSError):
            return  # the parent has ended or has no more work
        except (Exception, SystemExit) as error:  # a user's file is missing or wrong
            answer = explain(error)
        try:
            connection.send(answer)
        except (BrokenPipeError, ConnectionResetError):
            return

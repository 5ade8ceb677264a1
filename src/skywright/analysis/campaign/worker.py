"""A local worker process (forks.py).

Takes tasks from a connection and answers with rows (or what jobs return), or with why a task cannot
be read, until the other end is gone.
"""

from multiprocessing.connection import Connection

from skywright.core.find import explain


def serve(file: int) -> None:
    """Serve the connection with this file descriptor."""
    connection = Connection(file)
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

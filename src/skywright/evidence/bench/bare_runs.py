"""A process that flies a list of runs in a loop: what `workers` is compared with.

It is forked like a worker, but receives all its runs at once and sends nothing until the last one
has ended.
"""

from multiprocessing.connection import Connection


def serve(file: int) -> None:
    """Fly the tasks from the connection with the file descriptor `file`; send their rows."""
    connection = Connection(file)
    connection.send([task.fly() for task in connection.recv()])

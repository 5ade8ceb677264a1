"""Run on a Ray cluster (optional extra `cluster`): `--ray local` or an address.

The rows equal those of the local executor, because a run depends on its description and seed only.
A run whose worker dies is repeated on another worker, with the same number of attempts as locally.
All machines of a cluster need the same version of this program. Another version is an error,
because its rows would differ.
"""

import importlib.util
import logging
import os
import socket
from collections.abc import Generator, Iterator
from typing import Any

from skywright.analysis.campaign.forks import ONE_THREAD
from skywright.analysis.campaign.local import ATTEMPTS, choose_workers, count_cores
from skywright.analysis.campaign.runner import Flyable
from skywright.analysis.campaign.spec import DRAWING
from skywright.errors import InputError
from skywright.run.source_hash import collect_code_versions

AHEAD = 2
"""Runs submitted per core, so that no core idles."""


PATIENCE_S = 10.0
"""Timeout (s) of the connection to a cluster."""


def check_address(address: str) -> None:
    """Raise InputError if Ray is not installed or if nothing listens at the address."""
    if importlib.util.find_spec("ray") is None:
        raise InputError(
            "--ray needs Ray, which is not installed: pip install 'skywright[cluster]'"
        )
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if address in ("local", "auto"):
        return
    valid = "valid: local, or HOST:PORT as `ray start --head` prints it"
    if not colon or not port.isdecimal():
        raise InputError(f"--ray {address!r}: is not an address; {valid}")
    try:  # without this check, Ray retries for more than a minute
        socket.create_connection((host, int(port)), timeout=PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"--ray {address}: no cluster found ({error}); {valid}") from None


def check_workers(address: str, workers: int | None) -> int | None:
    """Return the number of workers to start Ray with. Raises InputError on an invalid number."""
    check_address(address)
    if workers is None:
        return None
    if address != "local":
        raise InputError("--workers: not valid with --ray ADDRESS, where the cluster decides")
    if not 1 <= workers <= count_cores():
        return choose_workers(workers, 1)  # raises
    return workers


def connect(address: str, workers: int | None) -> bool:
    """Start Ray on this machine (`local`) or join the cluster at `address`.

    Return True if the caller has to disconnect. If the program is already connected to Ray, that
    connection is used and stays open. Raises InputError if the connection fails.
    """
    os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # sends no usage data
    import ray

    if ray.is_initialized():
        return False
    options: dict[str, Any] = {
        "logging_level": logging.ERROR,
        "log_to_driver": False,
        "runtime_env": {"env_vars": ONE_THREAD},
    }
    try:
        if address == "local":
            ray.init("local", num_cpus=workers, include_dashboard=False, **options)
        else:
            ray.init(address, **options)
    except Exception as error:  # Ray raises a different exception for each kind of wrong address
        reason = " ".join(str(error).split())
        raise InputError(f"--ray {address}: cannot be joined ({reason})") from None
    return True


def disconnect() -> None:
    """Leave the cluster; a local one is shut down."""
    import ray

    ray.shutdown()


def count_cluster_cores() -> int:
    """Return the number of cores of the connected cluster."""
    import ray

    return max(int(ray.cluster_resources().get("CPU", 1)), 1)


def fly_if_same(task: Flyable, versions: dict[str, str]) -> Any:
    """Fly one run, or return the versions of this machine if they differ from the campaign's."""
    mine = collect_code_versions(*DRAWING)
    return task.fly() if mine == versions else mine


def fly_cluster(tasks: Iterator[Flyable]) -> Generator[Any, None, None]:
    """Fly tasks (or jobs) on the connected cluster; yield the rows in the order in which they
    finish.

    Closing the iterator cancels the runs in flight.
    """
    import ray
    from ray.exceptions import RayError

    versions = collect_code_versions(*DRAWING)
    remote = ray.remote(num_cpus=1, max_retries=0)(fly_if_same)
    flying: dict[Any, tuple[Flyable, int]] = {}
    again: list[tuple[Flyable, int]] = []
    exhausted = False
    try:
        while True:
            while len(flying) < AHEAD * count_cluster_cores() and not (exhausted and not again):
                if again:
                    task, attempt = again.pop()
                else:
                    following = next(tasks, None)
                    if following is None:
                        exhausted = True
                        continue
                    task, attempt = following, 1
                flying[remote.remote(task, versions)] = (task, attempt)
            if not flying:
                return
            ready, _ = ray.wait(list(flying), num_returns=1)
            for reference in ready:
                task, attempt = flying.pop(reference)
                try:
                    row = ray.get(reference)
                except RayError as error:
                    if attempt < ATTEMPTS:
                        again.append((task, attempt + 1))
                        continue
                    kind = type(error).__name__
                    reason = f"the worker process died {attempt} times ({kind})"
                    row = task.fail("crashed", reason)
                if isinstance(row, dict):  # versions
                    other = {k: row.get(k) for k in versions if row.get(k) != versions[k]}
                    raise InputError(
                        f"--ray: a machine of the cluster runs other versions: {other}; here "
                        f"{ {k: versions[k] for k in other} }: rows would not be comparable"
                    )
                yield row._replace(attempts=attempt)
    finally:
        for reference in flying:
            ray.cancel(reference, force=True)

"""Common parts of commands: options, output, and checks of output files."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from skywright.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])


def layers(command: F) -> F:
    """Add the options that choose and change the layers of a description."""
    for option in (
        click.option("--seed", type=click.IntRange(min=0), help="Seed of every random draw."),
        click.option(
            "--set", "sets", multiple=True, metavar="KEY=VALUE",
            help="Change any value, e.g. world.pipe.diameter_m=0.3. May be repeated.",
        ),
        click.option("--world", metavar="W", help="World instead of the mission's: name or file."),
        click.option("--robot", metavar="R", help="Robot instead of the mission's: name or file."),
    ):  # fmt: skip
        command = option(command)
    return command


as_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object only.")


def live_options(command: F) -> F:
    """Add the options that publish a flight to ROS 2 and Foxglove."""
    for option in (
        click.option(
            "--await", "wait_s", type=click.FloatRange(0.0, 3600.0), default=0.0, metavar="SECONDS",
            help="Wait up to SECONDS for the first subscriber of --ros2 or --foxglove.",
        ),
        click.option(
            "--foxglove", is_flag=False, flag_value=8765, type=click.IntRange(0, 65535),
            metavar="[PORT]",
            help="Publish the flight to Foxglove on this computer.  [default port: 8765]",
        ),
        click.option(
            "--ros2-distro", metavar="NAME",
            help="humble, jazzy, kilted or lyrical.  [default: jazzy]",
        ),
        click.option(
            "--ros2", is_flag=False, flag_value="tcp/127.0.0.1:7447", metavar="[ENDPOINT]",
            help="Publish the flight to ROS 2 (rmw_zenoh) and take UAL's commands.  "
            "[default endpoint: tcp/127.0.0.1:7447]",
        ),
    ):  # fmt: skip
        command = option(command)
    return command


def build_live(options: dict[str, Any]) -> Any:
    """Return the values of `live_options` for skywright.run."""
    from skywright.links.broadcast.options import Live

    return Live(
        options["ros2"], options["ros2_distro"], options["foxglove"], options["wait_s"]
    )  # fmt: skip


def _trust(context: click.Context, option: click.Parameter, given: bool) -> None:
    if given:
        from skywright.core.trust import trust_all

        trust_all()


trust_option = click.option(
    "--trust", is_flag=True, expose_value=False, callback=_trust,
    help="Execute code from a run directory (SECURITY.md).",
)  # fmt: skip


def print_json(value: Any) -> None:
    """Print one JSON object; NaN raises an error, because no command may print it."""
    click.echo(json.dumps(value, indent=2, allow_nan=False))


def check_writable(path: Path, formats: tuple[str, ...] = (".png", ".svg")) -> Path:
    """Raise an error for an output file that cannot be written, before the work begins."""
    if path.suffix.lower() not in formats:
        raise InputError(f"{path}: unknown format; valid: {', '.join(formats)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with path.open("ab"):
            pass
        if new:
            path.unlink()  # a later failure leaves no empty file
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def check_folder(path: Path) -> Path:
    """Raise an error for a folder that cannot be written, before the work begins; it is not
    created."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise InputError(f"{path}: cannot create the folder: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: {there} is not writable")
    return path


def report_unfinished(directory: Path, outcome: str, reason: str) -> None:
    """Print a line on stderr if a run has no complete recording."""
    from skywright.run.directory import UNFINISHED

    if outcome in UNFINISHED:
        click.echo(f"{directory}: {outcome}: {reason}", err=True)

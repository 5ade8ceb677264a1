"""The ground station: `serve`."""

from pathlib import Path
from typing import Any

import click

from skywright.cli.options import build_live, live_options, trust_option


@click.command()
@trust_option
@click.argument("target", metavar="[MISSION | RUN]", required=False)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port.  [default: a free one]"
)
@click.option(
    "--host", default="127.0.0.1", show_default=True,
    help="Address to listen on; another one than this computer's needs a certificate.",
)  # fmt: skip
@click.option("--name", "names", multiple=True, help="Host name by which browsers reach it.")
@click.option("--certificate", type=click.Path(path_type=Path), help="Certificate (PEM).")
@click.option("--key", type=click.Path(path_type=Path), help="Private key (PEM).")
@click.option("--unencrypted", is_flag=True, help="Accept other computers without a certificate.")
@click.option(
    "--runs", type=click.Path(path_type=Path, file_okay=False), default=Path("runs"),
    show_default=True, help="Folder of the runs and the logbook.",
)  # fmt: skip
@live_options
@click.option("--no-open", is_flag=True, help="Open no browser.")
def serve(
    target: str | None, port: int, host: str, names: tuple[str, ...], certificate: Path | None,
    key: Path | None, unencrypted: bool, runs: Path, no_open: bool, **live: Any,
) -> None:  # fmt: skip
    """Open the ground station in the browser.

    A page chooses, starts, watches and controls missions. With MISSION it proposes that one; with
    a finished run's directory it replays the run. --ros2 and --foxglove publish every flight.
    """
    from skywright.ground.serve import serve as run
    from skywright.ground.server import Address

    address = Address(host, port, names, certificate, key, unencrypted)
    asked = build_live(live)
    options = asked.check().list_arguments() if asked.wanted else ()
    run(target, address, runs, open_browser=False if no_open else None, options=options)

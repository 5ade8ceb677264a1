"""The ground station, or a robot that speaks MAVLink: `serve`."""

import math
from pathlib import Path
from typing import Any

import click

from skywright.cli.options import build_live, live_options, trust_option
from skywright.errors import InputError


@click.command()
@trust_option
@click.argument("target", metavar="[MISSION | RUN | ROBOT]", required=False)
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
@click.option(
    "--backend", "backends", multiple=True, metavar="NAME",
    help="Offer this back end in the page, as of `run --backend`: mavlink:URL, px4?OPTIONS; "
    "repeatable.  [always offered: physics, kinematic, px4]",
)  # fmt: skip
@live_options
@click.option("--no-open", is_flag=True, help="Open no browser.")
@click.option(
    "--mavlink", multiple=True, metavar="URL",
    help="Simulate ROBOT, which speaks MAVLink as PX4 does, instead of the page: "
    "udpin:[HOST:]PORT, udpout:[HOST:]PORT, tcp:[HOST:]PORT, serial:DEVICE[:BAUD]; repeatable.",
)  # fmt: skip
@click.option("--world", help="World (name or file) of --mavlink.  [default: open]")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Set any value, with --mavlink; repeatable.",
)  # fmt: skip
@click.option("--seed", type=int, help="Seed of noise and plant, with --mavlink.")
@click.option(
    "--duration", type=click.FloatRange(0.0, 1e6, min_open=True),
    help="Simulated time (s) after which --mavlink ends.  [default: until Ctrl-C]",
)  # fmt: skip
def serve(
    target: str | None, port: int, host: str, names: tuple[str, ...], certificate: Path | None,
    key: Path | None, unencrypted: bool, runs: Path, backends: tuple[str, ...], no_open: bool,
    mavlink: tuple[str, ...], world: str | None, sets: tuple[str, ...], seed: int | None,
    duration: float | None, **live: Any,
) -> None:  # fmt: skip
    """Open the ground station, or simulate a MAVLink vehicle.

    The station is a page in the browser that starts, watches and controls missions. With MISSION
    it proposes that one; with the directory of a finished run it replays the run. --ros2 and
    --foxglove publish every flight. With ROBOT and --mavlink no page is opened: QGroundControl,
    MAVSDK and `skywright run --backend mavlink:URL` fly the robot.
    """
    asked = build_live(live)
    if mavlink:
        if backends:
            raise InputError("--backend is not valid with --mavlink; leave one of them out")
        if asked.wanted:
            raise InputError("--ros2 and --foxglove are not valid with --mavlink; leave them out")
        _serve_mavlink(target, mavlink, world, sets, seed, duration)
        return
    given = {"world": world, "set": sets, "seed": seed is not None, "duration": duration}
    for name, value in given.items():
        if value:
            raise InputError(f"--{name} requires --mavlink URL")
    from skywright.description.loader import list_missions
    from skywright.description.robot.loader import list_robots
    from skywright.ground.serve import serve as run
    from skywright.ground.server import Address

    robots, missions = ({e.name for e in found} for found in (list_robots(), list_missions()))
    if target in robots - missions and not Path(target).exists():
        raise InputError(
            f"{target!r} is a robot: `skywright serve {target} --mavlink URL` lets it speak "
            "MAVLink; valid without --mavlink: a mission or a run's directory"
        )

    address = Address(host, port, names, certificate, key, unencrypted)
    options = asked.check().list_arguments() if asked.wanted else ()
    shown = False if no_open else None
    run(target, address, runs, open_browser=shown, options=options, backends=backends)


def _serve_mavlink(
    robot: str | None, texts: tuple[str, ...], world: str | None, sets: tuple[str, ...],
    seed: int | None, duration: float | None,
) -> None:  # fmt: skip
    import skywright
    from skywright.links.mavlink.endpoint import parse_url

    if robot is None:
        raise InputError("--mavlink requires a ROBOT: skywright serve hexarotor --mavlink URL")
    if duration is not None and not math.isfinite(duration):
        raise InputError(f"--duration {duration}: a finite number is needed")
    urls = [parse_url(text) for text in texts]
    description = skywright.load("waypoints", robot=robot, world=world, sets=sets, seed=seed)
    from skywright.links.mavlink.serve import serve_robot

    served = serve_robot(
        description, urls, duration_s=duration or math.inf, say=lambda s: click.echo(s, err=True)
    )
    for line in served.dropped:
        click.echo(line, err=True)
    click.echo(
        f"served {served.seconds:.1f} s, at most {served.late_s:.2f} s behind the wall clock; "
        f"{served.reason}"
    )

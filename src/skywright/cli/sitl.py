"""An autopilot flies a simulated robot: `sitl`."""

import math
import shlex
from pathlib import Path

import click

from skywright.cli.options import as_json_option, print_json, trust_option
from skywright.errors import InputError


def _parse_speed(context: click.Context, option: click.Parameter, text: str) -> float:
    if text == "max":
        return math.inf
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 0.01 <= factor <= 1000.0:
        raise InputError(f"--speed {text[:40]!r}; valid: 0.01 to 1000, or max")
    return factor


@click.command()
@trust_option
@click.argument("robot")
@click.option(
    "--autopilot", type=click.Choice(["px4"]), default="px4", show_default=True,
    help="Which one flies it.",
)  # fmt: skip
@click.option("--world", help="World (name or file).  [default: open]")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE", help="Set any value; repeatable."
)
@click.option("--seed", type=int, help="Seed of noise and plant.")
@click.option(
    "--params", metavar="FORMAT", type=click.Choice(["file", "env", "script"]),
    help="Print the robot as the autopilot's parameters and end: file (.params), env (shell), "
    "script (px4-rc.params).",
)  # fmt: skip
@click.option(
    "--port", type=click.IntRange(0, 65535), default=4560, show_default=True,
    help="TCP port that PX4 connects to; instance N takes 4560 + N.",
)  # fmt: skip
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--telemetry", type=click.IntRange(0, 65535), default=13280, show_default=True,
    help="UDP port on which PX4's estimate and set-points are heard; 0: none.",
)  # fmt: skip
@click.option(
    "--speed", default="1", show_default=True, callback=_parse_speed, metavar="FACTOR",
    help="Factor of real time, or max.",
)  # fmt: skip
@click.option(
    "--wait", type=click.FloatRange(0.0, 86400.0), default=120.0, show_default=True,
    help="Time (s) for PX4 to connect, or to come back.",
)  # fmt: skip
@click.option(
    "--patience", type=click.FloatRange(0.1, 86400.0), default=30.0, show_default=True,
    help="Time (s) that an answer of PX4 is waited for.",
)  # fmt: skip
@click.option(
    "--duration", type=click.FloatRange(0.0, 1e6, min_open=True),
    help="Simulated time (s) after which it ends.  [default: until Ctrl-C]",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Run directory.")
@as_json_option
def sitl(
    robot: str, autopilot: str, world: str | None, sets: tuple[str, ...], seed: int | None,
    params: str | None, port: int, host: str, telemetry: int, speed: float, wait: float,
    patience: float, duration: float | None, out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Let an autopilot fly ROBOT in software in the loop.

    Skywright is the autopilot's simulator: it sends the sensors and takes the motors' commands.
    The run directory holds the truth, the autopilot's estimate and its set-points.
    """
    for name, value in {"wait": wait, "patience": patience, "duration": duration}.items():
        if value is not None and not math.isfinite(value):
            raise InputError(f"--{name} {value}: a finite number is needed")
    if not host.strip():
        raise InputError("--host '': an address is needed, such as 127.0.0.1")
    import skywright

    description = skywright.load("waypoints", robot=robot, world=world, sets=sets, seed=seed)
    if params is not None:
        from skywright.links.px4.parameters import FORMATS, list_parameters

        name, where = description.robot.name, description.world.name
        comment = f"{name} in {where}, by skywright sitl --params {params}"
        listed = list_parameters(description.robot, description.world)
        click.echo(FORMATS[params](listed, comment), nl=False)
        return 0
    from skywright.links.px4.flight import Options, fly_px4

    options = Options(
        host, port, telemetry, speed, wait, patience, duration or math.inf, out,
        shlex.join(["skywright", *click.get_current_context().obj]),
    )  # fmt: skip
    result = fly_px4(description, options, lambda text: click.echo(text, err=True))
    if as_json:
        found = {**result._asdict(), "directory": str(result.directory)}
        print_json(found)
        return result.exit_code
    for line in result.refused:
        click.echo(line, err=True)
    for name, value in result.metrics.items():
        click.echo(f"{name:36} {value:.4g}")
    click.echo(f"{result.outcome}: {result.reason}; {result.real_time_factor:.2f} x real time")
    click.echo(str(result.directory))
    return result.exit_code

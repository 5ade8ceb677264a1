"""Simulation in the loop with an autopilot: `sitl`."""

import math
import shlex
from pathlib import Path
from typing import Any

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
    "--autopilot", type=click.Choice(["px4", "betaflight"]), default="px4", show_default=True,
    help="Autopilot that flies the robot.",
)  # fmt: skip
@click.option(
    "--mission", default="waypoints", show_default=True,
    help="Mission of start and seed; betaflight also flies its way-points.",
)  # fmt: skip
@click.option("--world", help="World (name or file).  [default: open]")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE", help="Set any value; repeatable."
)
@click.option("--seed", type=int, help="Seed of noise and plant.")
@click.option(
    "--params", metavar="FORMAT", type=click.Choice(["file", "env", "script", "cli"]),
    help="Print the robot as the autopilot's parameters and end. px4: file (.params), env (shell), "
    "script (px4-rc.params); betaflight: cli (lines for its command line).",
)  # fmt: skip
@click.option(
    "--port", type=click.IntRange(0, 65535), default=4560, show_default=True,
    help="TCP port that PX4 connects to; instance N takes 4560 + N.",
)  # fmt: skip
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--binary", type=click.Path(path_type=Path),
    help="Betaflight's SITL program, started by Skywright.  [default: you start it]",
)  # fmt: skip
@click.option(
    "--telemetry", type=click.IntRange(0, 65535), default=13280, show_default=True,
    help="UDP port for PX4's estimate and set-points; 0: none.",
)  # fmt: skip
@click.option(
    "--speed", default="1", show_default=True, callback=_parse_speed, metavar="FACTOR",
    help="Factor of real time, or max.",
)  # fmt: skip
@click.option(
    "--wait", type=click.FloatRange(0.0, 86400.0), default=120.0, show_default=True,
    help="Time (s) for PX4 to connect, or to reconnect.",
)  # fmt: skip
@click.option(
    "--patience", type=click.FloatRange(0.1, 86400.0),
    help="Longest wait (s) for an answer of the autopilot.  [default: 30 px4, 2 betaflight]",
)  # fmt: skip
@click.option(
    "--duration", type=click.FloatRange(0.0, 1e6, min_open=True),
    help="Simulated time (s) of the flight.  [default: until Ctrl-C]",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Run directory.")
@as_json_option
def sitl(
    robot: str, autopilot: str, mission: str, world: str | None, sets: tuple[str, ...],
    seed: int | None, params: str | None, port: int, host: str, binary: Path | None,
    telemetry: int, speed: float, wait: float, patience: float | None, duration: float | None,
    out: Path | None, as_json: bool,
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
    _check_options(autopilot, params, binary)
    import skywright

    description = skywright.load(mission, robot=robot, world=world, sets=sets, seed=seed)
    if params is not None:
        click.echo(_format_parameters(description, params), nl=False)
        return 0
    command = shlex.join(["skywright", *click.get_current_context().obj])

    def tell(text: str) -> None:
        click.echo(text, err=True)

    if autopilot == "betaflight":
        from skywright.links.betaflight import flight as betaflight

        result = betaflight.fly_betaflight(
            description,
            betaflight.Options(
                binary, wait, patience or 2.0, duration or math.inf, out, command, host
            ),
            tell,
        )
    else:
        from skywright.links.px4.flight import Options, fly_px4

        options = Options(
            host, port, telemetry, speed, wait, patience or 30.0, duration or math.inf, out, command
        )
        result = fly_px4(description, options, tell)
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


def _check_options(autopilot: str, params: str | None, binary: Path | None) -> None:
    """Raise InputError for options of another autopilot."""
    given = click.get_current_context().get_parameter_source
    if autopilot == "px4":
        if binary is not None:
            raise InputError("--binary: PX4 is started by you; valid with --autopilot betaflight")
        if params == "cli":
            raise InputError("--params cli; valid for px4: file, env, script")
        return
    if params not in (None, "cli"):
        raise InputError(f"--params {params}; valid for betaflight: cli")
    for name, why in {
        "speed": "Betaflight runs in real time only",
        "port": "Betaflight's ports are fixed",
        "telemetry": "Betaflight sends its state to a fixed port",
    }.items():
        if given(name) == click.core.ParameterSource.COMMANDLINE:
            raise InputError(f"--{name}: {why}; leave it out")


def _format_parameters(description: Any, params: str) -> str:
    """Return the parameters of the robot for the autopilot."""
    robot, world = description.robot, description.world
    comment = f"{robot.name} in {world.name}, by skywright sitl --params {params}"
    if params == "cli":
        from skywright.links.betaflight.airframe import build_airframe, format_commands

        return format_commands(build_airframe(robot, world), comment)
    from skywright.links.px4.parameters import FORMATS, list_parameters

    return FORMATS[params](list_parameters(robot, world), comment)

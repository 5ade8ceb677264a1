"""Commands for devices: `servos`."""

import time

import click

from skywright.errors import InputError


@click.command()
@click.argument("port", metavar="serial:PORT[:BAUD]", required=False)
@click.option(
    "--emulate", metavar="ROBOT",
    help="Serve the robot's servos on a pseudo-terminal, until Ctrl-C.",
)  # fmt: skip
@click.option("--last", type=click.IntRange(0, 253), default=32, show_default=True,
              help="Largest servo id to query.")  # fmt: skip
def servos(port: str | None, emulate: str | None, last: int) -> int:
    """List the servos on a bus, with positions, supply and errors."""
    if (port is None) == (emulate is None):
        raise InputError("servos: give serial:PORT, or --emulate ROBOT")
    from skywright.links.servo_bus.arms import describe_servos
    from skywright.links.servo_bus.bus import open_bus

    if emulate is not None:
        return _emulate(emulate)
    assert port is not None
    bus = open_bus(port, "servos")
    try:
        lines = describe_servos(bus, range(last + 1))
    except OSError as error:
        raise InputError(f"{port}: the serial port has failed: {error}") from None
    finally:
        bus.close()
    if not lines:
        raise InputError(f"{port}: no servo with an id from 0 to {last} answers")
    click.echo("\n".join(lines))
    return 0


def _emulate(name: str) -> int:
    from skywright.description.robot.loader import load_robot
    from skywright.links.servo_bus.arms import build_emulator

    emulator = build_emulator(load_robot(name, [])[0])
    emulator.start()
    click.echo(f"serial:{emulator.path}")
    try:
        while True:
            time.sleep(0.2)
    except KeyboardInterrupt:
        return 0
    finally:
        emulator.stop()

"""The command line: the only module that connects all packages.

Heavy modules are imported inside the commands, so that `skywright --help` answers at once. Exit
codes: 0 all requirements met, 1 a requirement failed, no plan exists or the run was interrupted, 2
the input is wrong and nothing was started, 3 the simulation failed.
"""

import click

from skywright.cli import (
    compare,
    data,
    describe,
    devices,
    evidence,
    fly,
    importing,
    live,
    pod,
    records,
    runs,
    serve,
    sitl,
)
from skywright.cli.group import Group


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    no_args_is_help=True,
)
@click.version_option(package_name="skywright", message="skywright %(version)s")
def main() -> None:
    """Simulate, plan, control and fly multirotors with arms that touch things.

    \b
    skywright run pipe-weld-scan         fly an inspection and map a weld
    skywright list robots                list the built-in robots
    skywright new robot my-robot         write a template of a robot
    """


for command in (
    fly.run, fly.plan, fly.campaign, evidence.reproduce, evidence.bench, describe.capability,
    compare.compare, describe.list_, describe.show, data.weld, pod.pod, data.locate, data.identify,
    records.records_, data.gateway, fly.replay, serve.serve, sitl.sitl, devices.servos, live.play,
    live.receive, runs.report, runs.export, describe.new, importing.import_, describe.check,
):  # fmt: skip
    main.add_command(command)

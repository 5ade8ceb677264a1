"""The command that imports robots from files of other tools."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skywright.cli.options import as_json_option, check_folder, print_json

if TYPE_CHECKING:
    from skywright.models.importing.importer import Imported
    from skywright.models.importing.values import Question


@click.command("import")
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--arm", metavar="FILE", type=click.Path(path_type=Path),
    help="File of an arm, which is welded to the robot.",
)  # fmt: skip
@click.option(
    "--mount", metavar="X,Y,Z[,R,P,Y]",
    help="Place (m) and roll, pitch, yaw (deg) of the arm's root.  [default: 0,0,0]",
)  # fmt: skip
@click.option(
    "--body", metavar="NAME", help="Body that flies.  [default: the free body with rotors]"
)
@click.option("--tip", metavar="NAME", help="Link or site at the tip.  [default: end of the arm]")
@click.option(
    "--weld", multiple=True, metavar="JOINT", help="Freeze a joint; '*': all. May be repeated."
)
@click.option(
    "--rotor", "rotors", multiple=True, metavar="X,Y,Z,ccw|cw[,AX,AY,AZ]",
    help="Rotor (m); replaces all rotors of the file. May be repeated.",
)  # fmt: skip
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Set a missing key of the robot file, or change one. May be repeated.",
)  # fmt: skip
@click.option(
    "--assume", is_flag=True, help="Use assumed values, marked as such, for missing ones."
)
@click.option("--no-meshes", is_flag=True, help="Leave out what the robot looks like.")
@click.option(
    "--out", metavar="NAME", type=click.Path(path_type=Path),
    help="Folder of the robot file.  [default: the name of FILE]",
)  # fmt: skip
@as_json_option
def import_(
    file: Path, arm: Path | None, mount: str | None, body: str | None, tip: str | None,
    weld: tuple[str, ...], rotors: tuple[str, ...], sets: tuple[str, ...], assume: bool,
    no_meshes: bool, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Write a robot file for a robot described in MJCF, URDF or SDF.

    On a terminal, the command prompts for values that FILE lacks; otherwise give them by --set. The
    robot file is compared with MuJoCo's model of FILE before it is written.
    """
    from skywright.core.keys import parse_assignment
    from skywright.core.toml_files import parse_value
    from skywright.models.importing.importer import Request, import_robot

    folder = check_folder(out or Path(file.stem))
    answers = {key: parse_value(text) for key, text in map(parse_assignment, sets)}
    request = Request(
        file, arm, mount, body, tip, weld, rotors, folder.name, answers, assume, not no_meshes
    )  # fmt: skip
    by_hand = sys.stdin.isatty() and not assume and not as_json
    made = import_robot(request, folder, _ask if by_hand else None)
    if as_json:
        print_json(_describe(made))
        return
    for line in made.notes:
        click.echo(line)
    what, worst = made.deviations.worst()
    sources = ", ".join(f"{n} {kind}" for kind, n in sorted(made.counts.items()))
    click.echo(
        f"{made.rotors} rotors from {made.rotor_origin}; {len(made.joints)} joints; "
        f"{made.meshes} meshes"
    )
    click.echo(f"numbers: {sources}")
    postures = made.deviations.postures
    click.echo(f"largest deviation from MuJoCo at {postures} postures: {worst:.1e} ({what})")
    click.echo(f"{made.path}")
    check = shlex.join(["skywright", "check", str(folder)])
    fly = shlex.join(["skywright", "run", "waypoints", "--robot", str(made.path)])
    click.echo(f"next: {check}, {fly}")


def _describe(made: Imported) -> dict[str, Any]:
    return made._asdict() | {"path": str(made.path), "deviations": made.deviations._asdict()}


def _ask(question: Question, check: Callable[[Any], None]) -> Any:
    """Prompt on the terminal until the answer is valid; the guess is the default."""
    from skywright.core.toml_files import parse_value
    from skywright.errors import InputError

    def read(text: str) -> Any:
        value = parse_value(text)
        try:
            check(value)
        except InputError as error:
            raise click.UsageError(str(error).removeprefix("--set: ")) from None
        return value

    return click.prompt(question.text, default=str(question.guess), value_proc=read)

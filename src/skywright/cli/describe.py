"""Commands about robots, worlds and missions: list, show, check, capability, templates."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skywright.cli.options import as_json_option, check_writable, print_json, trust_option
from skywright.core.catalog import Entry
from skywright.core.find import GROUPS, list_offers
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.description.lookup import Subject


@click.command()
@click.argument("robot")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE", help="Change a value of the robot."
)
@click.option(
    "--posture", type=click.Choice(["extended", "folded", "worst"]),
    help="Posture of the arm.  [default: extended]",
)  # fmt: skip
@click.option("--bare", is_flag=True, help="Platform without arm and docking gear.")
@click.option("--sweep", type=click.Choice(["tilt"]), help="Limits against the rotor tilt.")
@click.option("--docked", is_flag=True, help="Press force while docked.")
@click.option("--slope", type=float, metavar="DEG", help="Docked: slope of the surface.")
@click.option(
    "--slope-toward", type=float, metavar="DEG",
    help="Docked: direction in which it rises, 0 ahead, 90 left.  [default: worst]",
)  # fmt: skip
@click.option("--wind", type=float, metavar="MPS", help="Steady wind speed.")
@click.option(
    "--wind-toward",
    type=float,
    metavar="DEG",
    help="Direction the wind blows to.  [default: worst]",
)
@click.option(
    "--contact", metavar="X,Y",
    help="Docked: contact point, m ahead and left of the centre.  [default: working posture]",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Picture (.png or .svg).")
@as_json_option
def capability(
    robot: str, sets: tuple[str, ...], posture: str | None, bare: bool, sweep: str | None,
    docked: bool, out: Path | None, as_json: bool, **condition: Any,
) -> None:  # fmt: skip
    """Compute what ROBOT can do: force, tilt, wind, payload, power."""
    from skywright.core.keys import parse_assignment
    from skywright.description.robot.loader import load_robot
    from skywright.models.docked_map import parse_condition
    from skywright.models.sweep import strip_robot
    from skywright.reports import capability_views as views

    given = {name: value for name, value in condition.items() if value is not None}
    free = {"wind", "wind_toward"} if "wind" in given and not sweep else set()
    bound = given.keys() - free
    if bound and not docked:
        flag = next(name for name in given if name in bound).replace("_", "-")
        if sweep:
            raise InputError(f"--{flag} and --sweep exclude each other")
        other = "--wind" if flag == "wind-toward" else "--docked"
        raise InputError(f"--{flag} applies to {other} only: give both")
    if docked and (sweep or posture):
        raise InputError(f"--docked and --{'sweep' if sweep else 'posture'} exclude each other")
    asked = parse_condition(**given)
    spec, _ = load_robot(robot, [parse_assignment(text) for text in sets])
    if bare:
        spec = strip_robot(spec)
    if docked:
        view = views.view_docked(spec, asked)
    elif sweep:
        view = views.view_sweep(spec, posture or "extended")
    else:
        view = views.view_limits(spec, posture or "extended", asked)
    if out is not None or not as_json:
        picture = check_writable(out or Path(f"capability-{view.name}.png"))
        view.write_figure(picture)
    if as_json:
        print_json(view.to_json())
    else:
        view.print(picture)


PARTS = {f"{group.replace('_', '-')}s": group for group in GROUPS}
"""Words of `skywright list` -> the group of kinds."""


@click.command(name="list")
@click.argument(
    "kind",
    type=click.Choice(["robots", "worlds", "missions", "claims", *PARTS]),
    metavar="[robots|worlds|missions|claims|laws|sensors|...]",
    required=False,
)
@as_json_option
def list_(kind: str | None, as_json: bool) -> None:
    """List robots, worlds, missions, claims, or components.

    Components are laws, arms-laws, sensors, actuators, estimators, effects, faults, rules, things
    and kinds (of missions), built in or installed. Without an argument: all names.
    """
    from skywright.description.loader import list_missions
    from skywright.description.robot.loader import list_robots
    from skywright.description.world.loader import list_worlds

    listings = {"robots": list_robots, "worlds": list_worlds, "missions": list_missions}
    found = {name: call() for name, call in listings.items() if kind in (None, name)}
    if kind in (None, "claims"):  # imported only on request, because their specs are heavy
        from skywright.evidence.reproduce.load import list_claims

        found["claims"] = list_claims()
    if kind is not None and kind in PARTS:
        found[kind] = _list_parts(PARTS[kind])
    if as_json:
        print_json({name: [e._asdict() for e in entries] for name, entries in found.items()})
        return
    if kind is None:
        _print_names(found)
        return
    if not found[kind]:
        click.echo(f"no {kind} are built in or installed")
    width = max((len(e.name) for e in found[kind]), default=0)
    for entry in found[kind]:
        click.echo(f"{entry.name:{width}}  {entry.description}")


def _list_parts(group: str) -> list[Entry]:
    """Return the kinds of a group: what a built-in one is, and the package of another one.

    The sources are read and not imported: the laws would load numba, installed packages run code.
    """
    out = []
    for name, offers in sorted(list_offers(group).items()):
        said = [_read_summary(group, name) if o.point is None else o.place for o in offers]
        out.append(Entry(name, ", ".join(said)))
    return out


def _read_summary(group: str, name: str) -> str:
    """Return the first line that documents a built-in kind: of its file, or of a mission's
    class."""
    spec = importlib.util.find_spec(f"{GROUPS[group].package}.{name.replace('-', '_')}")
    assert spec is not None and spec.origin is not None
    tree: ast.Module | ast.ClassDef = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    if group == "kind":
        tree = next(node for node in tree.body if isinstance(node, ast.ClassDef))
    return (ast.get_docstring(tree) or "").partition("\n")[0]


def _print_names(found: dict[str, list[Entry]]) -> None:
    """Print names by kind; for claims, which are many, the papers."""
    for kind, entries in found.items():
        names = [e.name for e in entries]
        if kind == "claims":
            papers = dict.fromkeys(name.partition("/")[0] for name in names)
            names = [f"{sum(n.startswith(p + '/') for n in names)} of {p}" for p in papers]
        text = click.wrap_text(", ".join(names), 88, f"{kind:10}", " " * 10)
        click.echo(text)
    click.echo(f"{'parts':10}{', '.join(PARTS)}")
    click.echo("skywright list WORD describes each of a group")
    click.echo("skywright show NAME describes a robot, a world or a mission")


@click.command()
@trust_option
@click.argument("name", metavar="ROBOT|WORLD|MISSION")
@click.option("--out", type=click.Path(path_type=Path), help="Draw a picture (.png or .svg).")
@click.option("--urdf", type=click.Path(path_type=Path), help="Write the robot as URDF.")
@as_json_option
def show(name: str, out: Path | None, urdf: Path | None, as_json: bool) -> None:
    """Print a summary of a robot, world or mission.

    --out also draws a picture; --urdf also writes the robot, or the robot of the mission.
    """
    from skywright.description.lookup import find_any
    from skywright.reports.summary import build_summary

    subject, picture = find_any(name), None if out is None else check_writable(out)
    if urdf is not None:
        _write_urdf(subject, urdf)
    summary = build_summary(subject)._replace(urdf=None if urdf is None else str(urdf))
    if picture is not None:
        from skywright.reports.show import write_show_figure

        write_show_figure(subject, picture)
        summary = summary._replace(picture=str(picture))
    if as_json:
        print_json(summary.to_json())
    else:
        from skywright.reports.terminal import print_summary

        print_summary(summary)


def _write_urdf(subject: Subject, path: Path) -> None:
    from skywright.models.urdf import build_urdf

    mission = subject.description
    robot = subject.robot if mission is None else mission.robot
    if robot is None:
        raise InputError(
            f"--urdf: {subject.label!r} is a {subject.kind}; give a robot, or a mission with one"
        )
    text = build_urdf(robot)
    check_writable(path, (".urdf", ".xml")).write_text(text, encoding="utf-8")


@click.command(no_args_is_help=True)
@click.argument("what", metavar="WHAT")
@click.argument("name")
def new(what: str, name: str) -> None:
    """Write a commented template of a robot, mission, law or part.

    The files are written into the folder NAME. They are commented and fly without changes. WHAT
    is one of robot, world, mission, kind, law, estimator, sensor, actuator, effect, thing, fault
    and rule.
    """
    from skywright.description.template import write_template

    folder = Path(name)
    for file in write_template(what, folder):
        click.echo(str(file))
    click.echo(f"next: skywright check {folder}, skywright show {folder}, skywright run {folder}")


@click.command()
@trust_option
@click.argument("file", metavar="FILE|FOLDER")
@as_json_option
def check(file: str, as_json: bool) -> int:
    """List all errors of a robot, world or mission.

    It also lists the assumed values of the file, counts those of other files, and states whether
    the robot can lift its weight. In a folder, it checks robot.toml, world.toml and mission.toml.
    """
    from skywright.run.check import check_file

    report = check_file(file)
    if as_json:
        print_json(report._asdict())
        return 0 if report.valid else 2
    for line in report.problems:
        click.echo(line, err=True)
    if report.valid:
        click.echo(f"{report.label}: a valid {report.kind}")
    else:
        count = len(report.problems)
        click.echo(f"{report.label}: {count} problem{'s' if count != 1 else ''}", err=True)
    for line in report.notes:
        click.echo(line)
    return 0 if report.valid else 2

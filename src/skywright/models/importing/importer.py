"""Import of another tool's robot file: writes a robot file and compares it with the source."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from skywright.core.catalog import Found
from skywright.core.keys import apply_assignments
from skywright.core.spec import Source
from skywright.description.dump import write_literal
from skywright.description.robot.loader import load_robot, load_robot_layers
from skywright.description.robot.spec import Robot
from skywright.errors import InputError, SkywrightError
from skywright.models.allocation import build_allocator
from skywright.models.capability import check_can_fly
from skywright.models.importing.assumed import mark_assumed
from skywright.models.importing.chain import find_chain, freeze
from skywright.models.importing.comparing import TOLERANCE, Deviations, compare
from skywright.models.importing.fingers import find_held
from skywright.models.importing.limits import note_limits, read_limits
from skywright.models.importing.mounting import ARM, mount_arm
from skywright.models.importing.moving import check_loops, check_rotors
from skywright.models.importing.opening import compile_spec, hear_mujoco, open_file
from skywright.models.importing.rotors import find_rotors, parse_rotor
from skywright.models.importing.tables import Tables, build_tables
from skywright.models.importing.trees import check_mass, choose_arm, choose_platform
from skywright.models.importing.values import Question, Value
from skywright.models.importing.visuals import build_meshes
from skywright.models.rotors import build_rotors

MOST_LAG = 0.05
"""s of the rotors: up to it two imported robots met all requirements of `waypoints`; at 0.08 s
each of them lost control at take-off."""


class Request(NamedTuple):
    """Input of an import and its options."""

    file: Path
    arm: Path | None = None
    mount: str | None = None  # m, and roll, pitch, yaw in deg, of the arm's root in B
    body: str | None = None
    tip: str | None = None
    weld: tuple[str, ...] = ()  # joints to freeze; "*": all
    rotors: tuple[str, ...] = ()
    name: str | None = None
    answers: Mapping[str, Any] = {}  # dotted key -> value
    assume: bool = False  # accept guesses for missing values
    meshes: bool = True  # import the visual meshes


Ask = Callable[[Question, Callable[[Any], None]], Any]


class Imported(NamedTuple):
    """A robot file that agrees with its model."""

    path: Path
    kind: str
    counts: dict[str, int]  # numbers by source
    rotors: int
    rotor_origin: str
    joints: list[str]
    tip: str
    gripper: bool
    meshes: int  # tables of meshes
    deviations: Deviations
    notes: list[str]


def import_robot(request: Request, folder: Path, ask: Ask | None = None) -> Imported:
    """Write FOLDER/robot.toml for a file of another tool.

    `ask` returns values that neither the file nor `request.answers` contain; it receives a check
    that raises InputError for an invalid answer. Without it, and without `request.assume`, this
    raises InputError with the missing keys. It also raises InputError if the file cannot be read,
    if it does not describe a multirotor that a robot file can describe, or if the robot file
    deviates from MuJoCo's model of the file by more than 1e-6. In these cases nothing is written.
    """
    if folder.exists():
        raise InputError(f"{folder}: exists; remove it, or give another --out")
    if request.mount is not None and request.arm is None:
        raise InputError(f"--mount {request.mount}: only with --arm FILE")
    heard: list[str] = []
    with hear_mujoco(heard):
        made = _import(request, folder, ask)
    return made._replace(notes=[*dict.fromkeys(heard), *made.notes])


def _import(request: Request, folder: Path, ask: Ask | None) -> Imported:
    opened = open_file(request.file)
    arm = None if request.arm is None else open_file(request.arm)
    trees = [choose_platform(opened, request.body)]
    if arm is not None:
        trees.append(choose_arm(arm))
        mount_arm(opened, trees[0].body, arm, trees[1].body, request.mount or "0,0,0")
    model = compile_spec(request.file, opened.spec)
    root = int(trees[0].body.id)
    check_mass(opened, model, root, trees)
    locked, assumed = dict(opened.locked), dict(opened.assumed)
    if arm is not None:
        locked |= {ARM + name: at for name, at in arm.locked.items()}
        assumed |= {ARM + name: what for name, what in arm.assumed.items()}
    locked |= find_held(model, root)
    given = [parse_rotor(text) for text in request.rotors]
    where = f"{request.file}" if request.arm is None else f"{request.file} with {request.arm}"
    with _name_file(where):
        data = freeze(model, root, locked)
    rotors = find_rotors(opened, model, data, root, given)
    spun = check_rotors(request.file, model, data, rotors.rotors, {*locked, *request.weld})
    turning = {rotor.joint for rotor in rotors.rotors if rotor.joint}
    spun -= turning
    turning |= spun
    origin = request.file.name + ("" if request.arm is None else f" and {request.arm.name}")
    limits = read_limits(opened, "", model) | ({} if arm is None else read_limits(arm, ARM, model))
    name = request.name or folder.name
    label, weld = f"{origin} ({opened.kind})", set(request.weld)
    with _name_file(where):
        chain = find_chain(model, data, root, turning, locked, weld, request.tip)
        tables = build_tables(name, label, chain, rotors, limits)
    loops = check_loops(request.file, model, root, chain.joints)

    def rebuild(other: mujoco.MjModel) -> Tables:
        data = freeze(other, root, locked)
        found = find_rotors(opened, other, data, root, given)
        moved = find_chain(other, data, root, turning, locked, weld, request.tip)
        return build_tables(name, label, moved, found, limits)

    tables = mark_assumed(tables, model, assumed, rebuild)
    notes = [*opened.notes, *([] if arm is None else arm.notes), *rotors.notes, *chain.frozen]
    if spun:
        notes.append(f"joint {', '.join(sorted(spun))} is frozen: it turns a propeller only")
    notes += loops
    files = [(opened, ""), *([] if arm is None else [(arm, ARM)])]
    notes += note_limits(files, chain, limits)
    notes.append("contacts: capsules along the links, a hub and propeller discs")
    if request.meshes:
        looks, left_out = build_meshes(
            files, model, data, chain, tables.frames, ["platform", *tables.links]
        )
        tables.values.update(looks)
        notes += left_out
    scratch = Path(tempfile.mkdtemp())
    try:
        draft = _Draft(scratch / "robot.toml", f"{request.file} as {folder / 'robot.toml'}", origin)
        _answer(draft, tables, request, ask)
        robot, sources = draft.load()
        deviations = compare(model, root, chain, robot)
        what, worst = deviations.worst()
        if not worst <= TOLERANCE:
            raise InputError(
                f"{request.file}: the robot file deviates from MuJoCo's model of the file by "
                f"{worst:.2g} in {what} (at most {TOLERANCE:g}); --set may have changed it"
            )
        notes += _find_weakness(robot)
        folder.mkdir(parents=True)
        shutil.copyfile(draft.file, folder / "robot.toml")
    finally:
        shutil.rmtree(scratch)
    counts: dict[str, int] = {}
    for key, source in sources.items():
        if not key.startswith("robot.meshes."):
            counts[source.kind] = counts.get(source.kind, 0) + 1
    joints = [part.joint for part in chain.parts[1:]]
    return Imported(
        folder / "robot.toml", opened.kind, counts, len(rotors.rotors), rotors.origin, joints,
        chain.tip_name, chain.gripper is not None, len(robot.meshes), deviations, notes,
    )  # fmt: skip


@contextmanager
def _name_file(where: str) -> Iterator[None]:
    """Put the files (`where`) in front of errors about their joints and links."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _find_weakness(robot: Robot) -> list[str]:
    """Return why a robot that agrees with its file does not fly; empty if nothing is known."""
    notes, lag = [], robot.rotors.time_constant_s
    try:
        build_allocator(build_rotors(robot.rotors))
        check_can_fly(robot)
    except SkywrightError as error:
        notes.append(f"does not fly as the file describes it: {error}")
    if lag > MOST_LAG:
        notes.append(
            f"flights lose control: the rotors lag by {lag:g} s (robot.rotors.time_constant_s), "
            f"and the gains of an imported robot are sufficient up to {MOST_LAG:g} s"
        )
    return notes


class _Draft:
    """The robot file in construction, in a temporary folder."""

    def __init__(self, file: Path, label: str, origin: str) -> None:
        self.file, self.label, self.origin = file, label, origin
        self.values: dict[str, Value] = {}

    def load(self) -> tuple[Robot, dict[str, Source]]:
        """Read the file in the usual way; raises InputError."""
        self.file.write_text(write_toml(self.values, self.origin), encoding="utf-8")
        return load_robot(self.file, label=self.label)

    def check(self, key: str, answer: Any) -> None:
        """Raise InputError for an answer that the robot file cannot contain."""
        load_robot(self.file, [(key, answer)], label=self.label)

    def set(self, answers: Mapping[str, Any], label: str) -> None:
        """Set answers, lists and tables included; raises InputError for an invalid one."""
        given = list(answers.items())
        load_robot(self.file, given, label=self.label)
        tree = load_robot_layers(Found(self.file, self.label))[0].tree
        layer = apply_assignments(tree, given, {"robot": Robot})
        for key, value in _flatten(layer.tree):
            self.values[key] = Value(value, "asked", label)
        self.load()


def _flatten(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _answer(draft: _Draft, tables: Tables, request: Request, ask: Ask | None) -> None:
    """Complete the draft with the file's values, the answers, the guesses; raises InputError."""
    guesses = {
        q.key: Value(q.guess, "assumed", f"no source: {q.text}", q.range) for q in tables.questions
    }
    draft.values = tables.values | guesses
    draft.load()
    for key in request.answers:
        if not key.startswith("robot."):
            raise InputError(f"--set {key}: valid: keys of the robot file, robot...")
    draft.set(request.answers, "--set")
    missing = [q for q in tables.questions if q.key not in request.answers]
    if missing and ask is None and not request.assume:
        wanted = "; ".join(f"--set {q.key}=... ({q.text})" for q in missing)
        raise InputError(f"{request.file} lacks values: give {wanted}, or --assume")
    for question in missing:
        if ask is None:
            break
        answer = ask(question, partial(draft.check, question.key))
        if answer != question.guess:
            draft.set({question.key: answer}, question.text)
    lag = draft.load()[0].rotors.time_constant_s
    if "robot.control.attitude_bandwidth_rad_s" not in draft.values:
        fast = round(min(max(0.3 / max(lag, 1e-4), 3.0), 12.0), 2)
        draft.values["robot.control.attitude_bandwidth_rad_s"] = Value(
            fast, "derived", "0.3 over the lag of the rotors, 3 to 12 rad/s"
        )
        draft.values.setdefault(
            "robot.control.position_bandwidth_rad_s",
            Value(round(fast / 4.5, 2), "derived", "the attitude loop's over 4.5"),
        )


def write_toml(values: Mapping[str, Value], origin: str) -> str:
    """Return the text of a robot file: one table per part, sources beside the numbers."""
    tables: dict[str, list[str]] = {}
    for key, value in values.items():
        table, _, leaf = key.rpartition(".")
        tables.setdefault(table, []).append(f"{leaf} = {_write_value(value)}")
    head = [f"# Imported from {write_literal(origin)[1:-1]} by `skywright import`."]
    head.append("# source: imported (the file), asked (an answer), assumed (a guess), derived")
    first = sorted(
        tables,
        key=lambda t: (t != "robot", t.startswith("robot.arm"), t.startswith("robot.meshes")),
    )
    return (
        "\n".join(head)
        + "".join(f"\n\n[{table}]\n" + "\n".join(tables[table]) for table in first)
        + "\n"
    )


def _write_value(value: Value) -> str:
    if value.source in ("",):
        return write_literal(value.value)
    parts = [f"value = {write_literal(value.value)}", f'source = "{value.source}"']
    if value.range is not None:
        numbers = value.value if isinstance(value.value, Sequence) else [value.value]
        low, high = min(value.range[0], *numbers), max(value.range[1], *numbers)
        parts.append(f"range = [{float(low)!r}, {float(high)!r}]")
    return "{ " + ", ".join([*parts, f"note = {write_literal(value.note)}"]) + " }"

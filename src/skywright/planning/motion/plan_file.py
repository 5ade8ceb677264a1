"""The plan file: a table of rows (CSV) and its description (TOML), two files of one name.

NAME.csv has a header and one row per reference: `t_s`; the platform's `x_m, y_m, z_m, yaw_rad`,
their rates `vx_mps ... yaw_rate_rad_s` and accelerations `ax_mps2 ...`; for every joint `NAME_rad`,
`NAME_rad_s`. NAME.toml names robot, world and seed, the joints in order, and the planner's metrics,
and for a world with random structures also their `scenario_seed` and `difficulty`.
Other tools may write such files; they are checked when loaded.
"""

import csv
import math
import os
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from skywright.core.arrays import Array
from skywright.core.bounded import LARGEST_TABLE, LARGEST_TOML, parse_toml, read_text
from skywright.errors import InputError

POSE = ("x_m", "y_m", "z_m", "yaw_rad")
RATE = ("vx_mps", "vy_mps", "vz_mps", "yaw_rate_rad_s")
ACCELERATION = ("ax_mps2", "ay_mps2", "az_mps2", "yaw_acceleration_rad_s2")
FORMAT = 1
STEP_TOLERANCE = 0.25
"""Largest difference between a step in position and its adjacent rates, relative to the step; also
of a step in a rate and its adjacent accelerations."""
ACCELERATION_TOLERANCE = 0.5
"""m/s^2 and rad/s^2, largest error of an acceleration: tools that plan slow motions may write 0."""


class PlanFile(NamedTuple):
    """A plan in the form that the vehicle layer uses."""

    robot: str
    world: str
    seed: int
    joints: tuple[str, ...]
    t: Array  # (m,) s
    pose: Array  # (m, 4) x, y, z m, yaw rad
    rate: Array  # (m, 4)
    acceleration: Array  # (m, 4)
    q: Array  # (m, nj) rad
    qd: Array  # (m, nj) rad/s
    metrics: dict[str, float]  # e.g. plan.cost, plan.lower_bound, plan.first_solution_s
    scenario_seed: int | None = None  # of the world's random structures; None: its own
    difficulty: float = 0.5  # of the random structures


def list_columns(joints: Sequence[str]) -> list[str]:
    """Return the names of the columns for a robot's joints."""
    angles = [f"{name}_rad" for name in joints]
    rates = [f"{name}_rad_s" for name in joints]
    return ["t_s", *POSE, *RATE, *ACCELERATION, *angles, *rates]


def name_files(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Return the names NAME.csv and NAME.toml of a plan file, given either of them or NAME.

    Raises InputError if the path has no name, such as "." or "/".
    """
    base = Path(path)
    if base.name in ("", ".."):
        raise InputError(
            f"{os.fspath(path)!r} names no plan file; valid: NAME, NAME.csv or NAME.toml, with a "
            "folder before it if needed"
        )
    if base.suffix in (".csv", ".toml"):
        base = base.with_name(base.stem)
    return base.with_name(base.name + ".csv"), base.with_name(base.name + ".toml")


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Raise InputError if writing the plan file `path` would replace a file that is no plan.

    Files that cannot be read count as such.
    """
    table, head = name_files(path)
    for file in (table, head):
        if not file.exists():
            continue
        if not file.is_file():
            kind = "folder" if file.is_dir() else "device or pipe"
            raise InputError(f"{file}: is a {kind}; give another name")
        try:
            with file.open("rb") as stream:
                text = stream.read(LARGEST_TOML).decode(errors="replace")
        except OSError as error:
            raise InputError(
                f"{file}: already exists and cannot be read ({error.strerror or error}); give "
                "another name"
            ) from None
        try:
            if file == table:
                is_plan = text.startswith(",".join(("t_s", *POSE)))
            else:
                is_plan = isinstance(parse_toml(text, str(file)).get("plan"), dict)
        except InputError:
            is_plan = False
        if not is_plan:
            raise InputError(
                f"{file}: already exists and is not part of a plan file; give another name or "
                "remove it"
            )


def write_plan_file(path: str | os.PathLike[str], plan: PlanFile) -> tuple[Path, Path]:
    """Write a plan as `name_files(path)`; both files appear only when complete.

    Raises InputError if that would replace a file that is no plan.
    """
    files = name_files(path)
    check_replaceable(path)
    table = np.column_stack([plan.t, plan.pose, plan.rate, plan.acceleration, plan.q, plan.qd])
    head = {
        "format": FORMAT, "robot": plan.robot, "world": plan.world, "seed": plan.seed,
        "joints": list(plan.joints), "rows": len(plan.t), "duration_s": float(plan.t[-1]),
    }  # fmt: skip
    if plan.scenario_seed is not None:
        head |= {"scenario_seed": plan.scenario_seed, "difficulty": plan.difficulty}
    head["metrics"] = plan.metrics
    parts = [f.with_name(f.name + ".partial") for f in files]
    try:
        with parts[0].open("w", newline="", encoding="utf-8") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(list_columns(plan.joints))
            writer.writerows([[f"{x:.9g}" for x in row] for row in table])
        parts[1].write_text(tomli_w.dumps({"plan": head}), encoding="utf-8")
        for part, file in zip(parts, files, strict=True):
            part.replace(file)
    finally:
        for part in parts:  # left by an error, such as a full disk
            part.unlink(missing_ok=True)
    return files


def load_plan_file(
    path: str | os.PathLike[str], robot: str | None = None, joints: Sequence[str] | None = None
) -> PlanFile:
    """Load a plan file (by either name); with `robot` and `joints`, only one of theirs.

    Raises InputError that names the file, row and column of the error.
    """
    table_file, head_file = name_files(path)
    head = _read_head(head_file)
    names = tuple(head["joints"])
    if robot is not None and head["robot"] != robot:
        raise InputError(f"{head_file}: the plan is for robot {head['robot']!r}, not {robot!r}")
    if joints is not None and names != tuple(joints):
        raise InputError(
            f"{head_file}: plan.joints are {', '.join(names) or 'none'}; the robot "
            f"has {', '.join(joints) or 'none'}"
        )
    table = _read_table(table_file, list_columns(names))
    if len(table) != head["rows"]:
        raise InputError(
            f"{table_file}: {len(table)} rows, but plan.rows is "
            f"{head['rows']}: the file is truncated or belongs to another plan"
        )
    n, at = len(names), 13
    plan = PlanFile(
        head["robot"], head["world"], head["seed"], names, table[:, 0], table[:, 1:5],
        table[:, 5:9], table[:, 9:13], table[:, at : at + n], table[:, at + n :],
        head["metrics"], head.get("scenario_seed"), head.get("difficulty", 0.5),
    )  # fmt: skip
    _check_motion(table_file, plan)
    return plan


_HEAD: dict[str, tuple[type, ...]] = {
    "format": (int,), "robot": (str,), "world": (str,), "seed": (int,), "joints": (list,),
    "rows": (int,), "duration_s": (float, int), "metrics": (dict,),
}  # fmt: skip
_OPTIONAL: dict[str, tuple[type, ...]] = {"scenario_seed": (int,), "difficulty": (float, int)}
_NEEDED = {
    int: "a whole number", float: "a number", str: "a text", list: "a list", dict: "a table",
}  # fmt: skip
_RANGES = {"scenario_seed": 2**64 - 1, "difficulty": 1}


def _read_head(path: Path) -> dict[str, Any]:
    tree = parse_toml(_read(path, LARGEST_TOML), str(path))
    head = tree.get("plan")
    if not isinstance(head, dict):
        raise InputError(
            f"{path}: no [plan] table; the file contains: {', '.join(tree) or 'nothing'}"
        )
    for key, kinds in (_HEAD | _OPTIONAL).items():
        if key not in head:
            if key in _OPTIONAL:
                continue
            raise InputError(f"{path}: plan lacks {key}; required: {', '.join(_HEAD)}")
        if not isinstance(head[key], kinds) or isinstance(head[key], bool):
            raise InputError(f"{path}: plan.{key} is {head[key]!r}; {_NEEDED[kinds[0]]} is needed")
    valid = _HEAD | _OPTIONAL
    unknown = sorted(set(head) - set(valid))
    if unknown:
        raise InputError(f"{path}: unknown key plan.{unknown[0]}; valid: {', '.join(valid)}")
    if head["format"] != FORMAT:
        raise InputError(f"{path}: plan.format is {head['format']}; this version reads {FORMAT}")
    for key, most in _RANGES.items():
        if not 0 <= head.get(key, 0) <= most:  # NaN too
            raise InputError(f"{path}: plan.{key} is {head[key]!r}; valid: 0 to {most}")
    if not all(isinstance(j, str) for j in head["joints"]):
        raise InputError(f"{path}: plan.joints must be names")
    for key, value in head["metrics"].items():
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise InputError(f"{path}: plan.metrics.{key} is {value!r}; a number is needed")
        try:
            head["metrics"][key] = float(value)
        except OverflowError:
            raise InputError(
                f"{path}: plan.metrics.{key} is an integer above 1e308; valid: below that"
            ) from None
    return head


def _read(path: Path, limit: int) -> str:
    if not path.exists():
        raise InputError(f"no plan file {str(path)!r}: NAME.csv and NAME.toml belong together")
    return read_text(path, limit)


def _read_table(path: Path, columns: list[str]) -> Array:
    text = _read(path, LARGEST_TABLE)
    try:
        lines = list(csv.reader(StringIO(text, newline="")))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    if not lines:
        raise InputError(f"{path}: empty; a header and rows are needed")
    header = [name.strip() for name in lines[0]]
    missing = [name for name in columns if name not in header]
    extra = [name for name in header if name not in columns]
    if missing or extra:
        what = (
            f"lacks the column {missing[0]}" if missing else f"has the unknown column {extra[0]!r}"
        )
        raise InputError(f"{path}: {what}; required for the plan's joints: {', '.join(columns)}")
    if len(set(header)) != len(header):
        raise InputError(f"{path}: the header contains a column twice")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(header):
            raise InputError(
                f"{path}: line {number} has {len(line)} values, the header {len(header)}"
            )
        values = []
        for name, text in zip(header, line, strict=True):
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise InputError(
                    f"{path}: line {number}, {name} is {text!r}; a finite number is needed"
                )
            values.append(value)
        rows.append(values)
    if len(rows) < 2:
        raise InputError(f"{path}: {len(rows)} rows; at least two are needed")
    order = [header.index(name) for name in columns]
    return np.array(rows)[:, order]


def _check_motion(path: Path, plan: PlanFile) -> None:
    """Check that time increases from 0, that positions agree with their rates, and these with the
    platform's accelerations."""
    if abs(plan.t[0]) > 1e-9:
        raise InputError(f"{path}: line 2, t_s is {plan.t[0]:g}; a plan starts at 0")
    steps = np.diff(plan.t)
    if np.any(steps <= 0.0):
        line = int(np.argmax(steps <= 0.0)) + 3
        raise InputError(f"{path}: line {line}, t_s is {plan.t[line - 2]:g}; times must increase")
    h = steps[:, None]
    _compare_steps(
        path, "rates", [*POSE, *(f"{j}_rad" for j in plan.joints)], h,
        np.hstack([plan.pose, plan.q]), np.hstack([plan.rate, plan.qd]), np.array(2e-3),
    )  # fmt: skip
    # an acceleration may jump anywhere between two rows
    jump = 0.5 * np.abs(np.diff(plan.acceleration, axis=0)) * h
    _compare_steps(
        path, "accelerations", [*RATE], h, plan.rate, plan.acceleration,
        jump + ACCELERATION_TOLERANCE * h + 2e-3,
    )  # fmt: skip


def _compare_steps(
    path: Path, what: str, names: list[str], h: Array, value: Array, rate: Array, slack: Array
) -> None:
    """Raise InputError unless each step of `value` (m, k) agrees with its `rate` (m, k).

    `h` (m - 1, 1) s are the steps in time, `slack` (m - 1, k) or () is the absolute tolerance, and
    `what` names the columns of the rate.
    """
    change = np.diff(value, axis=0)
    expected = 0.5 * (rate[1:] + rate[:-1]) * h
    wrong = np.abs(change - expected) > STEP_TOLERANCE * np.abs(expected) + slack
    if np.any(wrong):
        row, column = (int(i) for i in np.argwhere(wrong)[0])
        raise InputError(
            f"{path}: line {row + 3}, {names[column]} changes by {change[row, column]:.4g}, "
            f"but its {what} give {expected[row, column]:.4g}"
        )

"""The plan file: a table of rows (CSV) and its description (TOML), two files of one name.

NAME.csv has a header and one row per reference: `t_s`; the platform's `x_m, y_m, z_m, yaw_rad`,
their rates `vx_mps ... yaw_rate_rad_s` and accelerations `ax_mps2 ...`; for every joint `NAME_rad`,
`NAME_rad_s`. NAME.toml names robot, world and seed, the joints in order, and the planner's metrics.
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
"""Largest difference between a step in position and its adjacent rates, relative to the step."""


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


def list_columns(joints: Sequence[str]) -> list[str]:
    """Return the names of the columns for a robot's joints."""
    angles = [f"{name}_rad" for name in joints]
    rates = [f"{name}_rad_s" for name in joints]
    return ["t_s", *POSE, *RATE, *ACCELERATION, *angles, *rates]


def write_plan_file(path: str | os.PathLike[str], plan: PlanFile) -> tuple[Path, Path]:
    """Write `path` with the suffixes .csv and .toml; both appear only when complete."""
    base = Path(path).with_suffix("")
    table = np.column_stack([plan.t, plan.pose, plan.rate, plan.acceleration, plan.q, plan.qd])
    head = {
        "plan": {
            "format": FORMAT, "robot": plan.robot, "world": plan.world, "seed": plan.seed,
            "joints": list(plan.joints), "rows": len(plan.t),
            "duration_s": float(plan.t[-1]), "metrics": plan.metrics,
        }
    }  # fmt: skip
    files = base.with_suffix(".csv"), base.with_suffix(".toml")
    parts = [f.with_name(f.name + ".partial") for f in files]
    with parts[0].open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(list_columns(plan.joints))
        writer.writerows([[f"{x:.9g}" for x in row] for row in table])
    parts[1].write_text(tomli_w.dumps(head), encoding="utf-8")
    for part, file in zip(parts, files, strict=True):
        part.replace(file)
    return files


def load_plan_file(
    path: str | os.PathLike[str], robot: str | None = None, joints: Sequence[str] | None = None
) -> PlanFile:
    """Load a plan file (by either name); with `robot` and `joints`, only one of theirs.

    Raises InputError that names the file, row and column of the error.
    """
    base = Path(path).with_suffix("")
    head = _read_head(base.with_suffix(".toml"))
    names = tuple(head["joints"])
    if robot is not None and head["robot"] != robot:
        raise InputError(
            f"{base.with_suffix('.toml')}: the plan is for robot {head['robot']!r}, not {robot!r}"
        )
    if joints is not None and names != tuple(joints):
        raise InputError(
            f"{base.with_suffix('.toml')}: plan.joints are {', '.join(names) or 'none'}; the robot "
            f"has {', '.join(joints) or 'none'}"
        )
    table = _read_table(base.with_suffix(".csv"), list_columns(names))
    if len(table) != head["rows"]:
        raise InputError(
            f"{base.with_suffix('.csv')}: {len(table)} rows, but plan.rows is "
            f"{head['rows']}: the file is truncated or belongs to another plan"
        )
    n, at = len(names), 13
    plan = PlanFile(
        head["robot"], head["world"], head["seed"], names, table[:, 0], table[:, 1:5],
        table[:, 5:9], table[:, 9:13], table[:, at : at + n], table[:, at + n :],
        {k: float(v) for k, v in head["metrics"].items()},
    )  # fmt: skip
    _check_motion(base.with_suffix(".csv"), plan)
    return plan


_HEAD: dict[str, tuple[type, ...]] = {
    "format": (int,), "robot": (str,), "world": (str,), "seed": (int,), "joints": (list,),
    "rows": (int,), "duration_s": (float, int), "metrics": (dict,),
}  # fmt: skip


def _read_head(path: Path) -> dict[str, Any]:
    tree = parse_toml(_read(path, LARGEST_TOML), str(path))
    head = tree.get("plan")
    if not isinstance(head, dict):
        raise InputError(
            f"{path}: no [plan] table; the file contains: {', '.join(tree) or 'nothing'}"
        )
    for key, kinds in _HEAD.items():
        if key not in head:
            raise InputError(f"{path}: plan lacks {key}; required: {', '.join(_HEAD)}")
        if not isinstance(head[key], kinds) or isinstance(head[key], bool):
            raise InputError(f"{path}: plan.{key} is {head[key]!r}; {kinds[0].__name__} is needed")
    unknown = sorted(set(head) - set(_HEAD))
    if unknown:
        raise InputError(f"{path}: unknown key plan.{unknown[0]}; valid: {', '.join(_HEAD)}")
    if head["format"] != FORMAT:
        raise InputError(f"{path}: plan.format is {head['format']}; this version reads {FORMAT}")
    if not all(isinstance(j, str) for j in head["joints"]):
        raise InputError(f"{path}: plan.joints must be names")
    for key, value in head["metrics"].items():
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise InputError(f"{path}: plan.metrics.{key} is {value!r}; a number is needed")
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
    """Check that time increases from 0, and that positions agree with their rates."""
    if abs(plan.t[0]) > 1e-9:
        raise InputError(f"{path}: line 2, t_s is {plan.t[0]:g}; a plan starts at 0")
    steps = np.diff(plan.t)
    if np.any(steps <= 0.0):
        line = int(np.argmax(steps <= 0.0)) + 3
        raise InputError(f"{path}: line {line}, t_s is {plan.t[line - 2]:g}; times must increase")
    names = [*POSE, *(f"{j}_rad" for j in plan.joints)]
    place, rate = np.hstack([plan.pose, plan.q]), np.hstack([plan.rate, plan.qd])
    moved = np.diff(place, axis=0)
    told = 0.5 * (rate[1:] + rate[:-1]) * steps[:, None]
    wrong = np.abs(moved - told) > STEP_TOLERANCE * np.abs(told) + 2e-3
    if np.any(wrong):
        row, column = (int(i) for i in np.argwhere(wrong)[0])
        raise InputError(
            f"{path}: line {row + 3}, {names[column]} moves by {moved[row, column]:.4g}, "
            f"but its rates give {told[row, column]:.4g}"
        )

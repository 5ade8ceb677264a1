"""Stores the operator's input in the run's directory, so that the run can be repeated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.core.find import list_kinds
from skywright.description.dump import dump_description, list_sources
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.run.directory import write_sources
from skywright.run.kind import load_kind
from skywright.run.operator import FILE, Stick, write_recording
from skywright.run.planning import MissionPlan


def check_operator(description: Description) -> None:
    """Raise InputError if the mission has no operator, or already uses a recorded one."""
    mission: Any = description.mission
    if not load_kind(mission.kind).operated:
        valid = [kind for kind in list_kinds("kind") if load_kind(kind).operated]
        raise InputError(
            f"--operator: mission {mission.name!r} has no operator; kinds with an "
            f"operator: {', '.join(valid)}"
        )
    if mission.task.operator is not None:
        raise InputError(
            "--operator: mission.task.operator already selects the recording "
            f"{mission.task.operator}; give only one of the two"
        )


def write_mission(partial: Path, description: Description, plan: MissionPlan[Any]) -> None:
    """Write mission.toml and the files that it refers to: operator's recording, a kind's file."""
    if plan.operator is not None:
        keep_operator(partial, description, plan.operator.rows(), plan.operator.starts)
    else:
        _dump(partial, description)


def keep_operator(
    partial: Path,
    description: Description,
    rows: Sequence[tuple[float, Stick]],
    starts: Sequence[float],
) -> None:
    """Write the operator's input, then refer to it in mission.toml; both are written atomically.

    `starts` (s) are the beginnings of the pieces of work. Raises InputError if the disk is full.
    """
    mission: Any = description.mission
    write_recording(partial / FILE, rows, mission.task.stick_speed_mps, starts)
    task = mission.task.model_copy(update={"operator": FILE})
    _dump(partial, description._replace(mission=mission.model_copy(update={"task": task})))


def _dump(partial: Path, description: Description) -> None:
    kept = write_sources(partial, list_sources(description))  # for repeating the run
    fresh = partial / "mission.toml.new"
    fresh.write_text(dump_description(description, kept), encoding="utf-8")
    fresh.replace(partial / "mission.toml")

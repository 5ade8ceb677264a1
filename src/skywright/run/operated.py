"""A run's operator: what it did is kept in the run's directory, so that the run can be repeated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.description.dump import dump_description
from skywright.description.loader import Description
from skywright.description.mission.registry import load_kind
from skywright.description.mission.spec import KINDS
from skywright.errors import InputError
from skywright.run.operator import FILE, Recording, Stick, write_recording
from skywright.run.planning import MissionPlan


def check_operator(description: Description) -> None:
    """Raise InputError where nobody can be at the stick, or a recording is there already."""
    mission: Any = description.mission
    if not getattr(load_kind(mission.kind), "OPERATED", False):
        valid = [k for k in KINDS if getattr(load_kind(k), "OPERATED", False)]
        raise InputError(
            f"--operator: mission {mission.name!r} has no operator; kinds that have one: "
            f"{', '.join(valid)}"
        )
    if mission.task.operator is not None:
        raise InputError(
            f"--operator: mission.task.operator names a recording, {mission.task.operator}; give "
            "one of the two"
        )


def has_operator(plan: MissionPlan, operator: object) -> bool:
    """Whether a stick is in use, in person or from a recording."""
    return operator is not None or getattr(plan.task, "operator", None) is not None


def write_mission(partial: Path, description: Description, plan: MissionPlan) -> None:
    """Write mission.toml, and the recording of the operator that it names beside it."""
    recording = getattr(plan.task, "operator", None)
    if isinstance(recording, Recording):
        keep_operator(partial, description, recording.rows())
    else:
        _dump(partial, description)


def keep_operator(
    partial: Path, description: Description, rows: Sequence[tuple[float, Stick]]
) -> None:
    """Write what the operator did, then name it in mission.toml; an interrupt leaves both whole.

    Raises InputError when the disk is full.
    """
    mission: Any = description.mission
    write_recording(partial / FILE, rows, mission.task.stick_speed_mps)
    task = mission.task.model_copy(update={"operator": FILE})
    _dump(partial, description._replace(mission=mission.model_copy(update={"task": task})))


def _dump(partial: Path, description: Description) -> None:
    fresh = partial / "mission.toml.new"
    fresh.write_text(dump_description(description), encoding="utf-8")
    fresh.replace(partial / "mission.toml")

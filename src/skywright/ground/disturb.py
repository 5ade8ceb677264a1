"""Disturbances that an operator switches on in flight, for training.

They are faults of the plant, added to the mission before take-off with a start after its end.
Switching one on sets its start to the current time. The flight can be repeated with that start of
the fault (`list_repeats`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

NEVER_S = 100_000.0
"""s, the latest start that a description accepts; no flight lasts so long."""


class Disturbance(NamedTuple):
    """A disturbance that can be switched on."""

    name: str  # of the fault in plant.faults
    label: str
    sets: tuple[str, ...]  # of the fault, without its name and start
    for_s: float


DISTURBANCES = {
    d.name: d
    for d in (
        Disturbance("station_gust", "gust of 5 m/s for 4 s",
                    ('kind="squall"', "speed_mps=5.0", "rise_s=0.5", "for_s=4.0"), 4.0),
        Disturbance("station_push", "push of 8 N sideways for 0.5 s",
                    ('kind="bump"', "force_y_n=8.0", "for_s=0.5"), 0.5),
        Disturbance("station_blind", "no localisation for 2 s",
                    ('kind="localisation"', "for_s=2.0"), 2.0),
    )
}  # fmt: skip


def list_sets() -> list[str]:
    """Return the `--set` texts that add all of them to a mission, switched off."""
    return list_repeats(dict.fromkeys(DISTURBANCES, NEVER_S))


def list_repeats(starts: dict[str, float]) -> list[str]:
    """Return the `--set` texts that repeat those that were switched on."""
    return [
        f"plant.faults.{name}.{text}"
        for name, start in starts.items()
        for text in (*DISTURBANCES[name].sets, f"start_s={start!r}")
    ]


def switch_on(vehicle: Any, name: str, t: float) -> bool:
    """Start a disturbance at `t` (s); return False if the mission does not contain it."""
    names = {c.name for c in vehicle.assembly.components}
    if name not in DISTURBANCES or name not in names:
        return False
    memory = vehicle.get_memory(name)
    memory.start, memory.end = t, t + DISTURBANCES[name].for_s
    return True

"""Registration by a datum: the robot looks at a mark of known place before it works from it.

A survey by touch leaves open where the robot is along a pipe and around it, or along a wall. The
mark closes that: what was found is shifted along itself, and turned about a pipe's axis, so that
the mark has the place that the asset gives it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask, Samples
from skywright.core.rotations import rot_y
from skywright.description.world.structure import Surface, build_surface, find_place, locate_point
from skywright.description.world.surface import Cylinder, unroll_points
from skywright.models.things.datum import Datum, find_datum
from skywright.recordings.columns import has_columns
from skywright.run.flight import PhaseRecord
from skywright.run.kind import Mark, Measures
from skywright.run.setup import Setup
from skywright.run.where import Where
from skywright.vehicle.datum import DatumMark

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

PHASE = "look"
LOOK_S = 2.0
"""s that the robot looks at the mark, at rest."""
LEAST_IMAGES = 10
COLOUR = (0, 114, 178)

DATUM_MEASURES: Measures = {
    "datum.images": ("", "number of images of the datum mark, at rest before it"),
    "datum.error_mm": (
        "mm",
        "distance along the surface of the datum mark, as the robot found it, from its true place, "
        "less what the measured tip is off by while it works",
    ),
    "datum.std_mm": ("mm", "standard deviation of the datum mark's place, each way, as stated"),
}
"""Metrics of a flight that looked at a datum."""
DATUM_WHERE = {"datum.": Where((PHASE,))}


class SeenMark(NamedTuple):
    """Where the datum mark was seen."""

    p_WM: Array  # (3,) m, in W, as the robot measures its tip
    std: float  # m, along the surface, each way
    images: int


def get_datum(setup: Setup[Any]) -> Datum | None:
    """Return the datum that the mission refers to: None without a mark or a camera that sees it."""
    probe = setup.robot.probe
    if probe is None or probe.camera is None or not getattr(setup.task, "datum", False):
        return None
    return find_datum(setup.world)


def explain_view(setup: Setup[Any], stand_off: float, reach: float) -> str:
    """Say why the camera may miss the mark from `stand_off` (m) over its place by the map, or "".

    The true mark may be `reach` (m) aside.
    """
    probe, plant = setup.robot.probe, setup.description.plant
    assert probe is not None and probe.camera is not None
    camera = probe.camera
    away = stand_off + camera.back_m
    sees = away * math.tan(0.5 * math.radians(camera.field_of_view_deg))
    if away > camera.range_max_m:
        return (
            f"robot.probe.camera sees {camera.range_max_m:g} m far; the datum is {away:.2f} m away "
            "where the robot looks at it: raise range_max_m or set mission.task.datum=false"
        )
    if abs(camera.aside_m) + reach <= sees:
        return ""
    return (
        f"robot.probe.camera sees {1e3 * sees:.0f} mm to each side at {away:.2f} m; the datum may "
        f"be {1e3 * (abs(camera.aside_m) + reach):.0f} mm aside, plant.map_error_m = "
        f"{plant.map_error_m:g} included: raise field_of_view_deg or set "
        "mission.task.datum=false"
    )


def look_at_datum(s: Supervisor[Any], setup: Setup[Any]) -> SeenMark | str:
    """Look at the mark from where the robot rests; returns where it is, or what failed."""
    mark = s.vehicle.look(DatumMark)
    s.begin(PHASE)
    s.body.hold()
    before = float(mark.images), np.array(mark.p_WM)
    s.wait(LOOK_S)
    after = float(mark.images), np.array(mark.p_WM)
    seen = _build_seen(
        setup, before, after, np.array(s.vehicle.estimate["p_WT"]), s.vehicle.pose_std
    )
    s.end("retry" if isinstance(seen, str) else "done")
    return seen


def read_datum(
    setup: Setup[Any], samples: Samples, phases: Sequence[PhaseRecord]
) -> SeenMark | None:
    """Return where a recorded flight saw the mark; None where it did not."""
    looked = [i for i, p in enumerate(phases) if p.name == PHASE and p.outcome == "done"]
    if not looked or not has_columns(samples, "datum_images"):
        return None
    mine = samples[samples["phase"] == looked[-1]]
    if len(mine) < 2:
        return None
    before, after = (
        (float(row["datum_images"]), np.array(row["datum_p_WM"])) for row in mine[[0, -1]]
    )
    std = float(mine["pose_std"][-1]) if has_columns(samples, "pose_std") else math.nan
    seen = _build_seen(setup, before, after, mine["est_p_WT"][-1], std)
    return None if isinstance(seen, str) else seen


def _build_seen(
    setup: Setup[Any], before: tuple[float, Array], after: tuple[float, Array], p_WT: Array,
    pose_std: float,
) -> SeenMark | str:  # fmt: skip
    """Take what was seen before the robot rested out of the mean; p_WT (3,) m is the tip then."""
    (old, p_old), (all_, p) = before, after
    images = all_ - old if all_ >= old else all_
    if images < LEAST_IMAGES:
        return (
            f"datum: its mark was seen {images:.0f} times in {LOOK_S:g} s, at least {LEAST_IMAGES} "
            "are needed; it may be hidden, or off its place on the map by more than "
            "plant.map_error_* state"
        )
    if all_ > images:
        p = (all_ * p - old * p_old) / images
    away = float(np.linalg.norm(p - p_WT))
    return SeenMark(p, _compute_std(setup, images, away, pose_std), int(images))


def _compute_std(setup: Setup[Any], images: float, away: float, pose_std: float) -> float:
    """Return the deviation (m) of the mark's place along the surface, each way.

    `away` (m) is the tip from the mark. `pose_std` (m; NaN: motion capture of the tip) is what the
    estimator says of the platform's place, which is off by as much again when the robot works.
    """
    probe, plant = setup.robot.probe, setup.description.plant
    assert probe is not None and probe.camera is not None
    away += probe.camera.back_m
    turn = math.radians(plant.probe_camera_error_deg)
    noise = probe.camera.bearing_noise_rad * away / math.sqrt(images)
    place = math.sqrt(2.0) * pose_std if math.isfinite(pose_std) else 0.0
    return math.hypot(plant.probe_camera_error_m, turn * away, noise, place)


def register_cylinder(found: Cylinder, datum: Datum, mark: SeenMark) -> Cylinder:
    """Return the pipe shifted along its axis and turned about it until the mark is at its place."""
    s, phi = datum.get_place()
    at, c, _ = unroll_points(found, mark.p_WM[None], near=found.radius * phi)
    turn = rot_y(float(c[0]) / found.radius - phi)
    return found._replace(
        p_WP=found.p_WP + (float(at[0]) - s) * found.R_WP[:, 1],
        R_WP=np.ascontiguousarray(found.R_WP @ turn),
    )


def register_surface(found: Surface, datum: Datum, mark: SeenMark) -> tuple[Array, Array]:
    """Return S (3,) m and its normal (3,) for the mark to be at its place on the structure."""
    off = find_place(found, mark.p_WM)[:2] - np.array(datum.get_place())
    p, R = locate_point(found, off)
    return p, R[:, 2]


def judge_datum(
    setup: Setup[Any], mark: SeenMark, samples: Samples, work: Mask
) -> dict[str, float]:
    """Compare the mark's place with the truth, along the surface.

    What the measured tip is off by at `work` (n,) as well shifts mark and work alike, and is taken
    out; before any work, what it is off by throughout is left in.
    """
    p = mark.p_WM
    if np.any(work):
        p = p - np.mean(samples["est_p_WT"][work] - samples["p_WT"][work], axis=0)
    datum, world = find_datum(setup.true.world), setup.true.world
    assert datum is not None
    u, v = datum.get_place()
    if datum.on_pipe:
        true = setup.true.cylinder
        assert true is not None
        s, c, _ = unroll_points(true, p[None], near=true.radius * v)
        error = math.hypot(float(s[0]) - u, float(c[0]) - true.radius * v)
    else:
        assert world.structure is not None
        place = find_place(build_surface(world.structure), p)
        error = math.hypot(float(place[0]) - u, float(place[1]) - v)
    return {
        "datum.images": float(mark.images), "datum.error_mm": 1e3 * error,
        "datum.std_mm": 1e3 * mark.std,
    }  # fmt: skip


def describe_datum(metrics: Mapping[str, float], where: str) -> list[str]:
    """Say how well the datum was seen; `where` is what it tells. [] without one."""
    if "datum.std_mm" not in metrics:
        return []
    return [
        f"The probe's camera saw the datum mark {metrics['datum.images']:.0f} times before the "
        f"touches. {where} counts from it, with a standard deviation of "
        f"{metrics['datum.std_mm']:.1f} mm each way; in truth it was "
        f"{metrics['datum.error_mm']:.1f} mm off."
    ]


def list_datum_marks(result: Any) -> list[Mark]:
    """Where the mark was seen, for 3-D views; [] without one."""
    setup = Setup(result.description)
    seen = read_datum(setup, result.samples, result.phases) if get_datum(setup) else None
    if seen is None:
        return []
    since = next(p.start_s for p in result.phases if p.name == PHASE)
    return [Mark("datum mark, as seen", COLOUR, seen.p_WM, size_m=0.01, since_s=since)]

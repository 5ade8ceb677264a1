"""Registration by a datum: a camera measures a mark of known position before the work.

A survey by touch leaves the robot's position along and around a pipe, or along a wall,
undetermined. The mark determines it: the fitted surface is shifted along itself, and turned about a
pipe's axis, until the mark is at its place on the asset.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask, Samples
from skywright.core.rotations import exp_so3, rot_y
from skywright.description.world.datum import DatumThing, find_datum, find_seen_datum
from skywright.description.world.structure import Surface, build_surface, find_place, locate_point
from skywright.description.world.surface import Cylinder, roll_points, unroll_points
from skywright.inspection.touches import FoundCylinder
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
"""s, for which the robot measures the mark at rest."""
LEAST_IMAGES = 10
COLOUR = (0, 114, 178)

DATUM_MEASURES: Measures = {
    "datum.images": ("", "number of images of the datum mark, at rest before it"),
    "datum.error_mm": (
        "mm",
        "distance along the surface of the datum mark, as the robot found it, from its true place, "
        "minus the error of the measured tip, which is the same during the work",
    ),
    "datum.std_mm": ("mm", "standard deviation of the datum mark's place, each way, as stated"),
    "datum.place_std_mm": (
        "mm",
        "standard deviation of the place of the work that is farthest from the mark, each way, as "
        "stated",
    ),
}
"""Metrics of a flight that measured a datum."""
DATUM_WHERE = {"datum.": Where((PHASE,))}


class SeenMark(NamedTuple):
    """Measured position of the datum mark."""

    p_WM: Array  # (3,) m, in W, as the robot measures its tip
    std: float  # m, along the surface, each way
    images: int


def get_datum(setup: Setup[Any]) -> DatumThing | None:
    """Return the datum that the mission uses; None without a mark or a camera that sees it."""
    asked = getattr(setup.task, "datum", False)  # tasks without the key use no datum
    return find_seen_datum(setup.robot, setup.world) if asked else None


def explain_view(setup: Setup[Any], stand_off: float, reach: float, aside: float) -> str:
    """Return why the camera may not see the mark from `stand_off` (m) over its mapped place, or "".

    The true surface may be `reach` (m) nearer or farther, and the mark shifted by `aside` (m) along
    it.
    """
    probe, plant = setup.robot.probe, setup.description.plant
    assert probe is not None and probe.camera is not None
    camera, instead = probe.camera, "or set mission.task.datum=false"
    away = stand_off + camera.back_m
    sees = (away - reach) * math.tan(0.5 * math.radians(camera.field_of_view_deg))
    far = abs(camera.aside_m) + aside
    slant = math.sqrt(2.0) * plant.map_error_deg + math.degrees(math.atan2(far, away - reach))
    if camera.rate_hz * LOOK_S < LEAST_IMAGES:
        return (
            f"robot.probe.camera.rate_hz = {camera.rate_hz:g} gives {camera.rate_hz * LOOK_S:.0f} "
            f"images of the datum in {LOOK_S:g} s, {LEAST_IMAGES} are needed: raise it, {instead}"
        )
    if away + reach > camera.range_max_m:
        return (
            f"robot.probe.camera.range_max_m = {camera.range_max_m:g}: the datum may be "
            f"{away + reach:.2f} m away when the robot looks at it; raise range_max_m, {instead}"
        )
    if far > sees:
        return (
            f"robot.probe.camera covers {1e3 * sees:.0f} mm to each side at {away - reach:.2f} m; "
            f"the datum may be {1e3 * far:.0f} mm aside, plant.map_error_m = "
            f"{plant.map_error_m:g} included: raise field_of_view_deg, {instead}"
        )
    if slant > camera.slant_max_deg:
        return (
            f"robot.probe.camera.slant_max_deg = {camera.slant_max_deg:g}: the datum may be seen "
            f"at {slant:.0f} deg from its normal: raise it, {instead}"
        )
    return ""


def look_at_datum(s: Supervisor[Any], setup: Setup[Any]) -> SeenMark | str:
    """Measure the mark from the present pose, at rest; return its position, or why it failed.

    A measurement that a pilot's take-over interrupted is repeated.
    """
    mark = s.vehicle.look(DatumMark)
    while True:
        s.begin(PHASE)
        s.body.hold()
        began = s.vehicle.t
        before = float(mark.images), np.array(mark.sum_W)
        s.wait(LOOK_S)
        if s.vehicle.t - began < LOOK_S + 0.1:
            break
        s.end("retry")
    after = float(mark.images), np.array(mark.sum_W)
    seen = _build_seen(
        setup, before, after, np.array(s.vehicle.estimate["p_WT"]), s.vehicle.pose_std
    )
    s.end("retry" if isinstance(seen, str) else "done")
    return seen


def read_datum(
    setup: Setup[Any], samples: Samples, phases: Sequence[PhaseRecord]
) -> SeenMark | None:
    """Return the measured mark of a recorded flight; None without one."""
    looked = [i for i, p in enumerate(phases) if p.name == PHASE and p.outcome == "done"]
    if not looked or not has_columns(samples, "datum_images"):
        return None
    mine = samples[samples["phase"] == looked[-1]]
    if len(mine) < 2:
        return None
    before, after = (
        (float(row["datum_images"]), np.array(row["datum_sum_W"])) for row in mine[[0, -1]]
    )
    std = float(mine["pose_std"][-1]) if has_columns(samples, "pose_std") else math.nan
    seen = _build_seen(setup, before, after, mine["est_p_WT"][-1], std)
    return None if isinstance(seen, str) else seen


def _build_seen(
    setup: Setup[Any], before: tuple[float, Array], after: tuple[float, Array], p_WT: Array,
    pose_std: float,
) -> SeenMark | str:  # fmt: skip
    """Return the mean of the images between two samples; p_WT (3,) m is the tip at the end."""
    images = after[0] - before[0]
    if images < LEAST_IMAGES:
        return (
            f"datum: its mark was seen {images:.0f} times in {LOOK_S:g} s, at least {LEAST_IMAGES} "
            "are needed; it may be hidden, or off its place on the map by more than "
            "plant.map_error_* state"
        )
    p = (after[1] - before[1]) / images
    away = float(np.linalg.norm(p - p_WT))
    return SeenMark(p, _compute_std(setup, images, away, pose_std), int(images))


def _compute_std(setup: Setup[Any], images: float, away: float, pose_std: float) -> float:
    """Return the standard deviation (m) of the mark's position along the surface, each way.

    `away` (m) is the distance of the mark from the tip. `pose_std` (m) is the estimator's standard
    deviation of the platform's position (NaN: motion capture measures the tip). It enters twice, at
    the measurement and at the work.
    """
    probe, plant = setup.robot.probe, setup.description.plant
    assert probe is not None and probe.camera is not None
    away += probe.camera.back_m
    turn = math.radians(plant.probe_camera_error_deg)
    noise = probe.camera.bearing_noise_rad * away / math.sqrt(images)
    place = math.sqrt(2.0) * pose_std if math.isfinite(pose_std) else 0.0
    return math.hypot(plant.probe_camera_error_m, turn * away, noise, place)


def spread_over_pipe(
    setup: Setup[Any], found: FoundCylinder, datum: DatumThing, mark: SeenMark, places: Array
) -> float:
    """Return the largest deviation (m), each way, of `places` (n, 2) (s m, phi rad) from the datum.

    The mark determines one place. The uncertainty of the pipe's direction, axis and radius after
    the touches moves the others: `found` is the registered pipe with the covariance of its fit. The
    error of the tip's markers cancels as far as the tip's direction equals that at the mark.
    """
    cylinder, P = found.cylinder, found.fit.covariance
    s, phi = datum.get_place()
    p_M, _ = roll_points(cylinder, s, cylinder.radius * phi)
    p, _ = roll_points(cylinder, places[:, 0], cylinder.radius * places[:, 1])
    near = cylinder.radius * places[:, 1]
    shifts = []
    for k, step in enumerate(np.sqrt(np.diag(P))):
        x = np.zeros(5)
        x[k] = step
        R = np.empty((3, 3))
        exp_so3(np.array([x[0], 0.0, x[1]]), R)
        moved = Cylinder(
            cylinder.p_WP + cylinder.R_WP @ [x[2], 0.0, x[3]],
            np.ascontiguousarray(cylinder.R_WP @ R), cylinder.radius + x[4], cylinder.half_length,
        )  # fmt: skip
        again = register_cylinder(moved, datum, SeenMark(p_M[0], 0.0, 0))
        at, c, _ = unroll_points(again, p, near=near)
        # the asset defines an angle; its arc follows from the nominal radius
        arc = c / again.radius * cylinder.radius
        shifts.append(np.column_stack([at - places[:, 0], arc - near]) / step)
    J = np.array(shifts)  # (5, n, 2)
    spread = np.einsum("kna,kl,lna->na", J, P, J)
    turned = 2.0 * np.sin(0.5 * np.abs(np.angle(np.exp(1j * (places[:, 1] - phi)))))
    spread[:, 1] += (turned * setup.world.mocap.calibration_m) ** 2
    return math.sqrt(mark.std**2 + float(np.max(spread)))


def spread_over_structure(
    setup: Setup[Any], datum: DatumThing, mark: SeenMark, places: Array
) -> float:
    """Return the largest deviation (m), each way, of `places` (n, 2) m in S from the datum.

    The heading of a surface that faces down is uncertain by the stated map error. That of a surface
    that faces to the side is measured by the touches. The map has no error about the normal.
    """
    structure = setup.world.structure
    assert structure is not None
    turn = 0.0
    if structure.facing == "down":
        turn = math.radians(setup.description.plant.map_error_deg) / math.sqrt(3.0)
    far = float(np.max(np.linalg.norm(places - np.array(datum.get_place()), axis=1)))
    return math.hypot(mark.std, turn * far)


def register_cylinder(found: Cylinder, datum: DatumThing, mark: SeenMark) -> Cylinder:
    """Return the pipe, shifted along its axis and turned about it to have the mark at its place."""
    s, phi = datum.get_place()
    at, c, _ = unroll_points(found, mark.p_WM[None], near=found.radius * phi)
    turn = rot_y(float(c[0]) / found.radius - phi)
    return found._replace(
        p_WP=found.p_WP + (float(at[0]) - s) * found.R_WP[:, 1],
        R_WP=np.ascontiguousarray(found.R_WP @ turn),
    )


def register_surface(found: Surface, datum: DatumThing, mark: SeenMark) -> tuple[Array, Array]:
    """Return S (3,) m and its normal (3,) with the mark at its place on the structure."""
    off = find_place(found, mark.p_WM)[:2] - np.array(datum.get_place())
    p, R = locate_point(found, off)
    return p, R[:, 2]


def judge_datum(
    setup: Setup[Any], mark: SeenMark, samples: Samples, work: Mask, spread: float
) -> dict[str, float]:
    """Compare the mark's measured position with the truth, along the surface.

    `spread` (m) is the stated deviation of the place of the work that is farthest from the mark.

    The mean error of the measured tip at `work` (n,) shifts mark and work alike and is subtracted.
    Without any work it is not subtracted.
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
        "datum.std_mm": 1e3 * mark.std, "datum.place_std_mm": 1e3 * spread,
    }  # fmt: skip


def describe_datum(metrics: Mapping[str, float], where: str) -> list[str]:
    """Return sentences on the datum's accuracy; `where` names what refers to it. [] without one."""
    if "datum.std_mm" not in metrics:
        return []
    return [
        f"The probe's camera saw the datum mark {metrics['datum.images']:.0f} times before the "
        f"touches. {where} counts from it, with a standard deviation of "
        f"{metrics['datum.std_mm']:.1f} mm each way at the mark and up to "
        f"{metrics['datum.place_std_mm']:.1f} mm at the places of the work; in truth the mark was "
        f"{metrics['datum.error_mm']:.1f} mm off."
    ]


def list_datum_marks(result: Any) -> list[Mark]:
    """Return the measured position of the mark for 3-D views; [] without one."""
    setup = Setup(result.description)
    seen = read_datum(setup, result.samples, result.phases) if get_datum(setup) else None
    if seen is None:
        return []
    since = next(p.start_s for p in result.phases if p.name == PHASE)
    return [Mark("datum mark, as seen", COLOUR, seen.p_WM, size_m=0.01, since_s=since)]

"""Finding out where a surface is by touching it: slowly along the normal until it is felt.

A touch is felt by what the robot has: the probe's force sensor, or the external force that its
estimator tells; both are compared with what they said at rest in the air. Where the tip came to
rest is told by the estimate of the tip, springs and bending included, not by the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_from_quat
from skywright.planning.patterns import build_time_law, eval_time_law
from skywright.run.flight import PhaseRecord

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor


SPEED = 0.02  # m/s towards the surface: a touch is felt within 0.1 s, 2 mm further
BACK_SPEED = 0.05  # m/s, away from it
ACCELERATION = 0.1  # m/s^2
FELT_N = 1.0
"""N, along the normal, that count as a touch; half of it must last while the tip rests."""
FELT_SIGMAS = 5.0
"""As many deviations of what is felt in the air count, where that is more (gusts)."""
TARE_S = 1.0  # s in the air before each touch: what is felt there is zero
HOLD_S = 1.0  # s that the tip rests on the surface
AVERAGE_S = 0.5  # s, the last of them: their mean is where it touched
TRIES = 2  # at each place
ROW = 0.02  # s
PHASE = "survey_touch"


class Touch(NamedTuple):
    """One touch, or why there was none."""

    p_WT: Array  # (3,) m, the tip's end, estimated; NaN without a touch
    axis_W: Array  # (3,) the tip's axis, out of the robot
    reason: str  # "" for a touch

    def centre(self, tip_radius: float) -> Array:
        """Middle (3,) m of the tip's sphere."""
        return np.asarray(self.p_WT - tip_radius * self.axis_W)


def feel_surface(s: Supervisor[Any], normal: Array, sensed: bool) -> float:
    """Return the force (N) along the outward `normal` (3,) that the robot feels now.

    `sensed`: by the probe's own sensor; otherwise as the estimator tells it.
    """
    return s.vehicle.force if sensed else float(s.vehicle.estimate["f_ext_W"] @ normal)


def touch_surface(s: Supervisor[Any], R_WS: Array, travel: float, sensed: bool) -> Touch:
    """Go from the present place, over the surface, up to `travel` (m) inward until it is felt.

    R_WS (3, 3) is the surface's frame there, as believed, z outward.

    The robot is back where it began afterwards; phases "survey_touch" and "survey_back".
    """
    row = np.array(s.vehicle.reference)
    row["R_WS"], normal = R_WS, R_WS[:, 2]
    s.begin(PHASE)
    s.body.hold()
    air = np.array([feel_surface(s, normal, sensed) for _ in _ticks(s, TARE_S)])
    least = max(FELT_N, FELT_SIGMAS * float(np.std(air)))
    zero, reason = float(np.mean(air)), f"nothing was met within {1e3 * travel:.0f} mm"
    s.body.track(build_travel(row, -travel, SPEED, travel))
    while not s.tick().arrived:
        if feel_surface(s, normal, sensed) - zero > least:
            reason = ""
            break
    p, force, ended = [], [], s.vehicle.t + HOLD_S
    if not reason:
        s.body.hold()
        for _ in _ticks(s, HOLD_S):
            if s.vehicle.t > ended - AVERAGE_S:
                p.append(np.array(s.vehicle.estimate["p_WT"]))
                force.append(feel_surface(s, normal, sensed) - zero)
        if float(np.mean(force)) < 0.5 * least:
            reason = "what was felt did not last"
    s.end("retry" if reason else "done")
    s.begin("survey_back")
    here = np.array(s.vehicle.reference)
    back = float(normal @ (row["p_WT"] - here["p_WT"]))
    s.body.track(build_travel(here, back, BACK_SPEED, travel))
    s.until_arrived()
    s.end("done")
    where = np.full(3, np.nan) if reason else np.mean(p, axis=0)
    return Touch(where, np.array(row["R_WT"])[:, 2], reason)


def survey_surface(
    s: Supervisor[Any],
    moves: Sequence[Table | None],
    frames: Sequence[Array],
    travels: Sequence[float],
    sensed: bool,
    settle: Callable[[], None],
    on_moved: Callable[[Table], None],
) -> list[Touch]:
    """Touch at the end of each of `moves` (None: where the robot is), `travels` (m) deep at most.

    `frames` (3, 3) are the surface's there, as believed, z outward.

    `settle` lets the controller come to rest before each touch; `on_moved` is told each table that
    was flown.
    """
    found = []
    for move, R_WS, travel in zip(moves, frames, travels, strict=True):
        if move is not None:
            s.follow("survey_move", move)
            on_moved(move)
        for _ in range(TRIES):
            settle()
            touch = touch_surface(s, R_WS, travel, sensed)
            if not touch.reason or touch.reason.startswith("nothing"):
                break
        found.append(touch)
    return found


def read_touches(samples: NDArray[Any], phases: Sequence[PhaseRecord]) -> list[Touch]:
    """Return the touches of a recorded flight; misses have a reason.

    Samples come at other instants than mission ticks, so places differ from those that the robot
    worked with by the noise of a mean: less than 0.1 mm.
    """
    found = []
    for i, phase in enumerate(phases):
        if phase.name != PHASE:
            continue
        mine = samples[samples["phase"] == i]
        if phase.outcome != "done" or not len(mine):
            found.append(Touch(np.full(3, np.nan), np.zeros(3), "missed"))
            continue
        late = mine[mine["t"] > phase.end_s - AVERAGE_S]
        axis = rot_from_quat(mine["ref_q_WT"][-1])[:, 2]
        found.append(Touch(np.mean(late["est_p_WT"], axis=0), axis, ""))
    return found


def build_travel(row: Any, distance: float, speed: float, dead_zone: float) -> Table:
    """Move from `row` along its surface normal by `distance` (m, outward), rest to rest.

    `dead_zone` (m) holds throughout: the integral does not press on what is touched.
    """
    law = build_time_law(abs(distance), speed, ACCELERATION)
    t = ROW * np.arange(round(law.duration / ROW) + 1)
    way = np.array([eval_time_law(law, x) for x in t]) * np.sign(distance)
    table = np.repeat(np.array(row)[None], len(t))
    normal = np.array(row["R_WS"])[:, 2]
    table["t"] = t
    for name in ("p_WB", "p_WT"):
        table[name] += way[:, :1] * normal
    table["v_WB"] = table["v_WT"] = way[:, 1:2] * normal
    table["a_WB"] = way[:, 2:] * normal
    for name in ("w_WB_B", "wd_WB_B", "qd"):
        table[name] = 0.0
    table["dead_zone"] = dead_zone
    return table


def _ticks(s: Supervisor[Any], seconds: float) -> Any:
    """Tick for a time (s), yielding after each tick."""
    ends = s.vehicle.t + seconds
    while s.vehicle.t < ends - 1e-9:
        s.tick()
        yield

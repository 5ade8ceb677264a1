"""Touch with the docking feet: rise until contact, then align with the deck.

A rise at constant speed ends when the estimated external force indicates that a foot touches. The
rotors then push with a few newtons, and the attitude's reference follows the attitude. The law
therefore only damps, and the force at the touching feet turns the robot until the others touch as
well. At rest, the estimated positions of the feet are points of the deck.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.core.rotations import orthonormalise, rot_from_quat
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.survey import (
    AVERAGE_S,
    BACK_SPEED,
    FELT_N,
    FELT_SIGMAS,
    PHASE,
    TARE_S,
    Touch,
    build_travel,
    compute_march_s,
    ticks,
)
from skywright.run.flight import PhaseRecord
from skywright.run.supervisor import Supervisor
from skywright.vehicle.interface import fill_tips

SPEED = 0.05  # m/s towards the deck
DEEP = 2.0
"""Travel beyond the farthest deck, relative to the travel that causes the threshold force."""
FOOT_N = 1.0  # N, of each foot, once all of them touch
PUSH_S = 0.5  # s, ramp of the push
STILL_RAD, STILL_M = math.radians(0.2), 2e-3  # largest motion within STILL_S at rest
STILL_S, SEAT_MAX_S = 0.5, 8.0


def compute_seat_s(distance: float) -> float:
    """Return the duration (s) of `touch_with_feet` on a deck at `distance` (m)."""
    there, back = (compute_march_s(distance, speed) for speed in (SPEED, BACK_SPEED))
    return TARE_S + there + PUSH_S + STILL_S + back


def touch_with_feet(
    s: Supervisor[Any], R_WS: Array, feet: Array, travel: float, stiffness: float
) -> list[Touch]:
    """Touch with `feet` (n, 3) m in B, along the normal z_S (3, 3), `travel` (m) up at most.

    The position loop has the stiffness `stiffness` (N/m). Afterwards the robot is back at its
    initial position. Returns one touch per foot; phases "survey_touch" and "survey_back".
    """
    vehicle, normal = s.vehicle, R_WS[:, 2]

    def feel() -> float:
        return float(vehicle.estimate["f_ext_W"] @ normal)

    begin = set_rest(vehicle.reference)
    row = np.array(begin)
    row["R_WS"] = R_WS
    s.begin(PHASE)
    s.body.hold()
    air = np.array([feel() for _ in ticks(s, TARE_S)])
    least, zero = max(FELT_N, FELT_SIGMAS * float(np.std(air))), float(np.mean(air))
    travel += DEEP * least / stiffness
    reason = f"no contact within {1000.0 * travel:.0f} mm"
    s.body.track(build_travel(row, -travel, SPEED, travel))
    while not s.tick().arrived:
        if feel() - zero > least:
            reason = ""
            break
    met = not reason
    places = np.zeros((len(feet), 3))
    if not reason:
        places, felt = _settle(s, feet, feel, R_WS)
        if not math.isfinite(felt):
            reason = "the feet did not come to rest"
        elif felt - zero < 0.5 * FOOT_N * len(feet):
            reason = "the contact did not last"
    s.end("retry" if reason else "done")
    s.begin("survey_back")
    row = set_rest(vehicle.reference)
    row["R_WS"], row["docked"], row["f_feet_B"] = R_WS, 0.0, 0.0
    back = float(normal @ (begin["p_WB"] - row["p_WB"]))
    s.body.track(build_travel(row, back, BACK_SPEED, travel))
    s.until_arrived()
    s.end("done")
    if reason:
        places = np.full((len(feet), 3), np.nan)
    return [Touch(p, -normal, reason, met) for p in places]


def _settle(s: Supervisor[Any], feet: Array, feel: Any, R_WS: Array) -> tuple[Array, float]:
    """Push until the robot rests; returns positions (n, 3) m and force (N; NaN if it does not)."""
    vehicle = s.vehicle
    row = set_rest(vehicle.reference)
    row["R_WS"], row["docked"], row["p_WB"] = R_WS, 1.0, vehicle.estimate["p_WB"]
    heading, began = np.array(row["R_WB"])[:, 0], vehicle.t
    seen: list[tuple[Array, Array, float]] = []
    still, most = round(STILL_S / 0.02), round(SEAT_MAX_S / 0.02)
    while len(seen) < most:
        R = np.array(vehicle.estimate["R_WB"])
        row["R_WB"] = _turn_to(R, heading)
        share = min((vehicle.t - began) / PUSH_S, 1.0)
        row["f_feet_B"] = [0.0, 0.0, -share * FOOT_N * len(feet)]
        table = np.array(row)[None]
        fill_tips(vehicle, table)
        s.body.track(table)
        s.tick()
        seen.append((np.array(vehicle.estimate["p_WB"]), R, feel()))
        if share == 1.0 and len(seen) > 2 * still:
            p, before = seen[-still][0], seen[-still][1]
            turned = math.acos(min(float(R[:, 2] @ before[:, 2]), 1.0))
            if turned < STILL_RAD and abs((seen[-1][0] - p) @ R_WS[:, 2]) < STILL_M:
                late = seen[-round(AVERAGE_S / 0.02) :]
                p_WB = np.mean([x[0] for x in late], axis=0)
                R = np.mean([x[1] for x in late], axis=0)
                return _place(p_WB, R, feet), float(np.mean([x[2] for x in late]))
    return np.full((len(feet), 3), np.nan), math.nan


def read_seats(samples: Samples, phases: Sequence[PhaseRecord], feet: Array) -> list[Touch]:
    """Return the touches of the feet (n, 3) m in B of a recorded flight; failed ones have a reason.

    They end with the first successful touches: those of the first spot.
    """
    found: list[Touch] = []
    for i, phase in enumerate(phases):
        if phase.name != PHASE:
            continue
        late = samples[(samples["phase"] == i) & (samples["t"] > phase.end_s - AVERAGE_S)]
        if phase.outcome != "done" or not len(late):
            found += [Touch(np.full(3, np.nan), np.zeros(3), "missed")] * len(feet)
            continue
        R = np.mean([rot_from_quat(q) for q in late["est_q_WB"]], axis=0)
        places = _place(np.mean(late["est_p_WB"], axis=0), R, feet)
        return found + [Touch(p, R[:, 2], "") for p in places]
    return found


def _place(p_WB: Array, R_WB: Array, feet: Array) -> Array:
    """Return positions (n, 3) m in W; the mean attitude is orthonormalised."""
    R = np.ascontiguousarray(R_WB)
    orthonormalise(R)
    return np.asarray(p_WB + feet @ R.T)


def _turn_to(R_WB: Array, heading: Array) -> Array:
    """Return an attitude with the z of `R_WB` (3, 3) and x towards `heading` (3,)."""
    z = R_WB[:, 2]
    x = heading - (heading @ z) * z
    x /= np.linalg.norm(x)
    return np.ascontiguousarray(np.column_stack([x, np.cross(z, x), z]))

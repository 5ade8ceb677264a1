"""Locating a surface by touch: motion along the normal at low speed until contact is detected.

The contact force is measured by the probe's force sensor, the external force of the estimator, or
the estimated force of a hand. Each is compared with its value at rest in the air. The position of
the tip is its estimate, including the deflection of springs and links, not the reference. A
`Feeler` is either the probe's tip, moved by the platform, or a hand, moved by its arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_from_quat
from skywright.core.types import TASK_FORCE, TASK_POSITION
from skywright.missions.skills.moves import set_rest
from skywright.planning.patterns import build_time_law, eval_time_law
from skywright.run.flight import PhaseRecord
from skywright.vehicle.arms.ports import HandForce, Hands

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor


SPEED = 0.02  # m/s, towards the surface: contact is detected within 0.1 s, 2 mm further
BACK_SPEED = 0.05  # m/s, away from it
ACCELERATION = 0.1  # m/s^2
FELT_N = 1.0  # contact threshold of a probe's tip
FELT_SIGMAS = 5.0
"""Contact threshold in deviations of the force in the air, if that is larger (gusts)."""
TARE_S = 1.0  # s in the air before each touch, over which the force is tared
HOLD_S = 1.0  # s, for which the tip rests on the surface
AVERAGE_S = 0.5  # s, at the end of the rest: the mean over them is the point of contact
TRIES = 2  # at each place
REST = 2.0
ROW = 0.02  # s
PHASE = "survey_touch"


class Touch(NamedTuple):
    """One touch, or the reason why there was none."""

    p_WT: Array  # (3,) m, the tip's end, estimated; NaN without a touch
    axis_W: Array  # (3,) the tip's axis, pointing out of the robot
    reason: str  # "" for a touch
    met: bool = True  # whether contact was detected

    def centre(self, tip_radius: float) -> Array:
        """Return the centre (3,) m of the tip's sphere."""
        return np.asarray(self.p_WT - tip_radius * self.axis_W)


class Feeler(Protocol):
    """The part that touches a surface: how it moves, what it measures, where it is."""

    felt: float
    """Contact threshold (N) along the normal; half of it must last while the tip rests."""
    columns: tuple[str, str]
    """Recorded position and attitude, of which `locate` returns the mean."""

    def start(self, R_WS: Array) -> Any:
        """Return the first row of REFERENCE: the present pose, with the surface frame R_WS."""

    def lead(self, row: Any, normal: Array, distance: float, speed: float, travel: float) -> Table:
        """Move from `row` along `normal` (3,) by `distance` (m, outward); `travel` is the limit."""

    def place(self, row: Any) -> Array:
        """Return the position (3,) m that `row` commands."""

    def rest(self, s: Supervisor[Any]) -> None:
        """Stay in contact with the surface."""

    def feel(self, normal: Array) -> float:
        """Return the measured force (N) of the surface along the outward `normal` (3,)."""

    def locate(self) -> tuple[Array, Array]:
        """Return the estimated position (3,) m and outward axis (3,) of its end."""


class Tip:
    """The probe's tip. `sensed`: the force is the probe's, otherwise the estimator's."""

    columns = ("est_p_WT", "ref_q_WT")

    def __init__(self, s: Supervisor[Any], sensed: bool, felt: float = FELT_N) -> None:
        self.vehicle, self.sensed, self.felt = s.vehicle, sensed, felt

    def start(self, R_WS: Array) -> Any:
        row = np.array(self.vehicle.reference)
        row["R_WS"] = R_WS
        return row

    def lead(self, row: Any, normal: Array, distance: float, speed: float, travel: float) -> Table:
        return build_travel(row, distance, speed, travel)

    def place(self, row: Any) -> Array:
        return np.array(row["p_WT"])

    def rest(self, s: Supervisor[Any]) -> None:
        s.body.hold()

    def feel(self, normal: Array) -> float:
        if self.sensed:
            return float(self.vehicle.force)
        return float(self.vehicle.estimate["f_ext_W"] @ normal)

    def locate(self) -> tuple[Array, Array]:
        v = self.vehicle
        return np.array(v.estimate["p_WT"]), np.array(v.reference["R_WT"])[:, 2]


class PressingTip(Tip):
    """A tip whose law controls the force: in contact it presses with REST times `felt`.

    Position control alone would lose the contact: a stiff spring throws the robot back with less
    force than the position controller holds.
    """

    def rest(self, s: Supervisor[Any]) -> None:
        row = set_rest(self.vehicle.reference)
        row["R_WS"], row["press"], row["force"] = (
            self.vehicle.reference["R_WS"],
            1.0,
            REST * self.felt,
        )
        s.body.track(row[None])


def get_hand_columns(index: int) -> tuple[str, str]:
    """Return the recorded position and attitude of hand `index`."""
    side = ("left", "right")[index]
    return f"{side}_est_p_WH", f"{side}_q_WH"


class Hand:
    """Hand `index` of compliant arms, moved by its arm while the platform stays.

    `speed` (m/s) limits the motion of the arm. Its contact threshold is lower than that of a tip:
    on a slope a push deflects sideways, and an arm on a swinging link cannot resist that.
    """

    felt = 0.5

    def __init__(self, s: Supervisor[Any], index: int, speed: float) -> None:
        self.vehicle, self.index, self.speed = s.vehicle, index, speed
        self.columns = get_hand_columns(index)

    def start(self, R_WS: Array) -> Any:
        self.normal = R_WS[:, 2]
        return set_rest(self.vehicle.reference)

    def lead(self, row: Any, normal: Array, distance: float, speed: float, travel: float) -> Table:
        t, way = _march(distance, speed)
        table = np.repeat(np.array(row)[None], len(t))
        table["t"], table["task"][:, self.index] = t, TASK_POSITION
        table["v_WH"][:, self.index] = [self.speed, 0.0, 0.0]
        table["p_WH"][:, self.index] += way[:, :1] * normal
        return table

    def place(self, row: Any) -> Array:
        return np.array(row["p_WH"][self.index])

    def rest(self, s: Supervisor[Any]) -> None:
        """Press with the threshold force along the normal, without force or position across it.

        A hand held by friction does not follow a position reference. The arm would move its
        shoulder away instead, by the same amount in each lag of the servos, as far as the link
        swings.
        """
        row, hand = set_rest(self.vehicle.reference), self.index
        row["task"][hand], row["v_WH"][hand] = TASK_FORCE, 0.0
        row["p_WH"][hand] = self.vehicle.read(Hands).p_WH[hand]
        row["f_WH"][hand] = -self.felt * self.normal
        s.body.track(row[None])

    def feel(self, normal: Array) -> float:
        return -float(self.vehicle.read(HandForce).f_WH[self.index] @ normal)

    def locate(self) -> tuple[Array, Array]:
        hands = self.vehicle.read(Hands)
        R_WB = self.vehicle.estimate["R_WB"]
        return np.array(hands.p_WH[self.index]), R_WB @ np.array(hands.R_BH[self.index])[:, 2]


def compute_touch_s(distance: float) -> float:
    """Return the duration (s) of `touch_surface` on a surface at `distance` (m)."""
    return (
        TARE_S + HOLD_S + compute_march_s(distance, SPEED) + compute_march_s(distance, BACK_SPEED)
    )


def compute_march_s(distance: float, speed: float) -> float:
    """Return the duration (s) of a straight motion along a normal by `distance` (m)."""
    return float(build_time_law(distance, speed, ACCELERATION).duration)


def touch_surface(s: Supervisor[Any], feeler: Feeler, R_WS: Array, travel: float) -> Touch:
    """Move from the present position over the surface up to `travel` (m) inward until contact.

    R_WS (3, 3) is the estimated frame of the surface there, z outward.

    Afterwards the robot is back at its initial position; phases "survey_touch" and "survey_back".
    """
    row, normal = feeler.start(R_WS), R_WS[:, 2]
    s.begin(PHASE)
    s.body.hold()
    air = np.array([feeler.feel(normal) for _ in ticks(s, TARE_S)])
    least = max(feeler.felt, FELT_SIGMAS * float(np.std(air)))
    zero, reason = float(np.mean(air)), f"no contact within {1000.0 * travel:.0f} mm"
    s.body.track(feeler.lead(row, normal, -travel, SPEED, travel))
    while not s.tick().arrived:
        if feeler.feel(normal) - zero > least:
            reason = ""
            break
    met = not reason
    p, axis, force, ended = [], np.zeros(3), [], s.vehicle.t + HOLD_S
    if not reason:
        feeler.rest(s)
        for _ in ticks(s, HOLD_S):
            if s.vehicle.t > ended - AVERAGE_S:
                place, axis = feeler.locate()
                p.append(place)
                force.append(feeler.feel(normal) - zero)
        if float(np.mean(force)) < 0.5 * least:
            reason = "the contact did not last"
    s.end("retry" if reason else "done")
    s.begin("survey_back")
    here = np.array(s.vehicle.reference)
    here["press"] = here["force"] = 0.0
    back = float(normal @ (feeler.place(row) - feeler.place(here)))
    s.body.track(feeler.lead(here, normal, back, BACK_SPEED, travel))
    s.until_arrived()
    s.end("done")
    return Touch(np.full(3, np.nan) if reason else np.mean(p, axis=0), axis, reason, met)


def survey_surface(
    s: Supervisor[Any],
    feeler: Feeler,
    frames: Sequence[Array],
    travels: Sequence[float],
    come: Callable[[int, list[Touch]], None],
    settle: Callable[[], None],
) -> list[Touch]:
    """Touch at each place, `travels` (m) deep at most.

    `come` moves to place i, given the touches so far; `settle` waits until the controller is at
    rest before each touch. `frames` (3, 3) are the estimated frames of the surface there, z
    outward.
    """
    found: list[Touch] = []
    for i, (R_WS, travel) in enumerate(zip(frames, travels, strict=True)):
        come(i, found)
        for _ in range(TRIES):
            settle()
            touch = touch_surface(s, feeler, R_WS, travel)
            if not touch.reason or not touch.met:
                break
        found.append(touch)
    return found


def read_touches(
    samples: NDArray[Any], phases: Sequence[PhaseRecord], columns: tuple[str, str] = Tip.columns
) -> list[Touch]:
    """Return the touches of a recorded flight, by a feeler's columns; failed ones have a reason.

    Samples are recorded at other instants than mission ticks, so positions differ from those in
    flight by the noise of a mean: less than 0.1 mm.
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
        axis = rot_from_quat(mine[columns[1]][-1])[:, 2]
        found.append(Touch(np.mean(late[columns[0]], axis=0), axis, ""))
    return found


def build_travel(row: Any, distance: float, speed: float, dead_zone: float) -> Table:
    """Move from `row` along its surface normal by `distance` (m, outward), rest to rest.

    `dead_zone` (m) applies throughout, so that the integral does not build up a force in contact.
    """
    t, way = _march(distance, speed)
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


def _march(distance: float, speed: float) -> tuple[Array, Array]:
    """Return times (n,) s and (n, 3) m, m/s, m/s^2 along a straight line, rest to rest."""
    law = build_time_law(abs(distance), speed, ACCELERATION)
    t = np.array(ROW * np.arange(round(law.duration / ROW) + 1), dtype=np.float64)
    way: Array = np.array([eval_time_law(law, x) for x in t]) * np.sign(distance)
    return t, way


def ticks(s: Supervisor[Any], seconds: float) -> Any:
    """Tick for a time (s), yielding after each tick."""
    ends = s.vehicle.t + seconds
    while s.vehicle.t < ends - 1e-9:
        s.tick()
        yield

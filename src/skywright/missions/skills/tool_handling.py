"""Lifting and setting down a tool by its handle with two hooks (Suarez 2020, section VI-A).

A hook and the forearm behind it form a V that is open upward, the cradle. The hands approach from
below, and the platform lifts while the springs of the arms deflect. As the weight passes to the
hands, it appears in the platform's external force. This force is fed forward to the springs and to
the platform, so that the hands return to their height.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.moves import build_move, set_rest
from skywright.missions.skills.tool_pose import find_marker, measure_tool
from skywright.run.orders import Detour
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import HandForce, Hands, HandState
from skywright.vehicle.bus import Estimate
from skywright.vehicle.plant import MISSION_TICK

LOW = 0.08  # m, from the cradle, along its mouth, to the hands' waiting position
DROP = 0.06  # m, by which the platform is lower meanwhile, so that the arms stay bent
PRESS = 0.015  # m, from the handle to the hands' goal beyond it, so that they touch it
TOUCH_N = 0.4  # N, upward force of a hand that counts as contact
TOUCH_S = 0.06  # s, for which it has to last
LIFT = 0.10  # m, height from which a tool counts as lifted
FEEL_S = 0.4  # s, lag of the estimated weight; the lag of the estimate is about equal
ACCELERATION = 0.3  # m/s^2, of the platform
NEAR_SPEED = 0.15  # m/s, of the platform near the tool and its support
STEADY_S = 2.0  # s, to come to rest
LIGHT_N = 0.3  # N, below which a load counts as set down
DEEP = 0.04  # m, below its place: a tool lowered further has missed its place
ALIGN_RATE = 0.5  # 1/s, rate at which the platform corrects the position of the suspended tool
ALIGN_M = 0.004  # m, remaining position error
ALIGN_SPEED = 0.05  # m/s
READY_M = 0.012  # m, above its place, where a tool waits until its predicted error is small
LOWER_RATE = 1.0  # 1/s, rate of approach to that height: that of the platform's loop
LAG_S = 0.35  # s, lag of that loop
WAITS_S = 60.0  # s, time limit of the descent
MEETS_M = 0.005  # m, largest error of the tool's place: half of the requirement
LATEST = 10  # ticks, over which its drift is measured: an eighth of a period
TILT_MAX = math.radians(12.0)  # of a handle that hangs in both hooks
LEFT_OUT = "it was not put down"
"""Reason why a tool stays on the hooks after an operator's order."""
STRAY = 0.2  # m, from the hands: a tool farther away, or tilted more, has fallen


class Place(NamedTuple):
    """Position of a standing tool: its frame O."""

    p_WO: Array  # (3,) m
    yaw: float


class Grip(NamedTuple):
    """Posture that holds the handle; vectors in a level frame with the robot's heading."""

    q: Array  # (n_joints,) rad, handle in the cradle
    q_low: Array  # (n_joints,) rad, hands LOW below
    hands: Array  # (2, 3) m, in B at q
    cradle: Array  # (3,) m, from the hand's point to the axis of a handle that lies in the cradle
    mouth: Array  # (3,) unit vector, out of the cradle
    handle: Array  # (3,) m, middle of the handle in O


def find_platform(grip: Grip, place: Place) -> Array:
    """Return p_WB (3,) m at which the hands hold a tool that stands at `place`."""
    middle = 0.5 * (grip.hands[0] + grip.hands[1]) + grip.cradle
    return np.asarray(place.p_WO + rot_z(place.yaw) @ (grip.handle - middle))


def find_tool(s: Supervisor, seconds: float = 0.6) -> Place:
    """Measure the tool for a time (s); return its mean place."""
    places, ahead = [], np.zeros(3)
    for _ in range(max(round(seconds / MISSION_TICK), 1)):
        s.tick()
        p, R = measure_tool(s)
        places.append(p)
        ahead += R[:, 0]
    return Place(np.mean(places, axis=0), math.atan2(ahead[1], ahead[0]))


def move_platform(
    s: Supervisor, p: Array, yaw: float, speed: float, acceleration: float = ACCELERATION
) -> None:
    """Move the platform rest to rest; hands and load keep their references."""
    s.body.track(_build_move(s, p, yaw, speed, acceleration))
    s.until_arrived()


def _build_move(s: Supervisor, p: Array, yaw: float, speed: float, acceleration: float) -> Any:
    start = s.vehicle.reference
    end = start.copy()
    end["p_WB"], end["R_WB"] = p, rot_z(yaw)
    return build_move(
        s.vehicle.model, s.vehicle.n_joints, start, end, speed=speed, acceleration=acceleration
    )


def lead_hands(
    s: Supervisor, grip: Grip, along: float, speed: float, beside: Array | None = None
) -> None:
    """Move both hands on straight lines (23) to `along` (m) the mouth from their holding positions.

    `beside` (3,) m, in O, is added. The goal is fixed to the tool, which is tracked continuously.
    """
    marker = find_marker(s.vehicle.world)
    goals = {}
    for name, hand in zip(("left", "right"), grip.hands, strict=True):
        side = np.array([0.0, hand[1], 0.0])
        p_O = grip.handle + side - grip.cradle + along * grip.mouth
        p_O = p_O if beside is None else p_O + beside
        goals[name] = marker.R.T @ (p_O - marker.p)
    s.arms.hands_to_marker(goals, speed)


def compute_miss(s: Supervisor, grip: Grip, shift: Array | None = None) -> float:
    """Return the larger distance (m) of a hand from its holding position at the handle.

    `shift` (3,) m is the assumed offset of the true position from the estimate.
    """
    p, R = measure_tool(s)
    p = p if shift is None else p - shift
    p_WH = s.vehicle.look(Hands).p_WH
    worst = 0.0
    for h, hand in enumerate(grip.hands):
        goal = p + R @ (grip.handle + np.array([0.0, hand[1], 0.0]) - grip.cradle)
        worst = max(worst, math.dist(p_WH[h], goal))
    return worst


def is_at_hand(s: Supervisor, grip: Grip) -> bool:
    """Return whether the tool is upright and near the hands; otherwise they must not follow it."""
    _, R = measure_tool(s)
    return compute_miss(s, grip) < STRAY and R[2, 2] > math.cos(TILT_MAX)


class Weight:
    """Filtered estimate of the weight on the hands, from the platform's external force."""

    def __init__(self, s: Supervisor, carried: float) -> None:
        """`carried` (N) is the initial weight on the hands."""
        self.carried, self._f_W = carried, s.vehicle.look(Estimate).f_ext_W
        ups = []
        for _ in range(50):
            s.tick()
            ups.append(float(self._f_W[2]))
        self._zero = float(np.mean(ups)) + carried

    def feel(self, most: float) -> None:
        """Update the estimate with the force of this tick, limited to 0 to `most` (N)."""
        felt = self._zero - float(self._f_W[2])
        self.carried += MISSION_TICK / FEEL_S * (min(max(felt, 0.0), most) - self.carried)

    def step(self, s: Supervisor, v: Array, most: float) -> None:
        """Fly one tick at v (3,) m/s with the estimated load, limited to `most` (N)."""
        self.feel(most)
        row = set_rest(s.vehicle.reference)
        row["p_WB"] += MISSION_TICK * v
        row["v_WB"] = v
        row["load"] = 0.5 * self.carried
        s.body.track(row[None])
        s.tick()


def hold_joints(s: Supervisor) -> None:
    """Hold the arms at the present commands of the servos; the springs may deflect."""
    s.arms.move_to(np.array(s.vehicle.read(HandState).q_goal[: s.vehicle.n_joints]))
    s.until_arrived()


def take_up_again(
    s: Supervisor, grip: Grip, most: float, retries: int, speeds: tuple[float, float]
) -> float | None:
    """Grasp the handle and lift it; returns the tool's weight (N), or None if the grasp failed.

    `speeds` (m/s) are those of hands and platform; `most` (N) is the largest weight to lift. The
    platform starts DROP below the result of `find_platform`. After a failure the hands wait below
    the handle and grasp up to `retries` times again, at the tool's measured place. They do not
    follow a tool that is not at hand any more, such as one that was knocked over. An operator's
    order to draw back sets the tool down and draws the hooks out.
    """
    work = _TakeUp(s, grip, most, speeds)
    detour = Detour(work.lower, lambda: None)
    return s.orders.attempt("the handle", lambda: work.fly(retries), None, detour)


class _TakeUp:
    """State of a grasp, which an operator's order may interrupt."""

    def __init__(self, s: Supervisor, grip: Grip, most: float, speeds: tuple[float, float]) -> None:
        self.s, self.grip, self.most, self.speeds = s, grip, most, speeds
        self.weight: Weight | None = None
        self.height = math.inf  # m, height of the platform where the lift begins; inf: no lift

    def fly(self, retries: int) -> float | None:
        """Grasp until the tool is suspended."""
        s, grip = self.s, self.grip
        for k in range(retries + 1):
            if k > 0:
                s.begin("look again")
                place = find_tool(s)
                p = find_platform(grip, place) - [0.0, 0.0, DROP]
                move_platform(s, p, place.yaw, NEAR_SPEED)
                s.wait(STEADY_S)
            weight = self._take_up()
            if weight is not None:
                return weight
            self.lower()
            s.end("retry")
            if not is_at_hand(s, grip):
                break
        return None

    def _take_up(self) -> float | None:
        """Grasp once; returns the weight (N) on the hooks, None after a failure."""
        s = self.s
        s.begin("grasp")
        weight = self.weight = Weight(s, 0.0)
        start, _ = measure_tool(s)
        if not _touch(s, self.grip, self.speeds[0]):
            return None
        s.begin("lift")
        hold_joints(s)
        speed = self.speeds[1]
        up, ends = np.array([0.0, 0.0, speed]), s.vehicle.t + 3.0 * LIFT / speed
        self.height, lifted = self._find_height(), 0.0
        while s.vehicle.t < ends and lifted < LIFT:
            risen = self._find_height() - self.height
            weight.step(s, up if risen < 1.5 * LIFT else np.zeros(3), self.most)
            lifted = float((measure_tool(s)[0] - start)[2])
        for _ in range(round(STEADY_S / MISSION_TICK)):
            weight.step(s, np.zeros(3), self.most)
        p, R = measure_tool(s)
        hangs = (p - start)[2] > 0.5 * LIFT and abs(R[2, 1]) < math.sin(TILT_MAX)
        return weight.carried if hangs else None

    def lower(self) -> None:
        """Set a lifted load down, and withdraw the hooks.

        The feedforward of its weight raises the load, so the platform descends until the load
        stands.
        """
        s, weight, down = self.s, self.weight, np.array([0.0, 0.0, -self.speeds[1]])
        while weight is not None and (above := self._find_height() - self.height) > -LOW:
            if above <= 0.0 and weight.carried < LIGHT_N:
                break
            weight.step(s, down, self.most)
        self.height = math.inf
        let_go(s, self.grip, self.speeds[0])

    def _find_height(self) -> float:
        return float(self.s.vehicle.reference["p_WB"][2])


def _touch(s: Supervisor, grip: Grip, speed: float) -> bool:
    """Raise platform and hands until both hands detect the handle; stop there.

    The goals are fixed to the tool: hands that continued would follow a tool that they lift.
    """
    place = find_tool(s, MISSION_TICK)
    lead_hands(s, grip, PRESS, speed)
    s.body.track(_build_move(s, find_platform(grip, place), place.yaw, speed, 0.3))
    felt, patience = 0.0, s.vehicle.t + (LOW + PRESS) / speed + 2.0 * STEADY_S
    while s.vehicle.t < patience and felt < TOUCH_S - 1e-9 and is_at_hand(s, grip):
        s.tick()
        touch = bool(np.all(s.vehicle.read(HandForce).f_WH[:2, 2] > TOUCH_N))
        felt = felt + MISSION_TICK if touch else 0.0
    return felt > 0.0 or compute_miss(s, grip) < 2.0 * PRESS


def put_down(
    s: Supervisor, grip: Grip, place: Place, weight_n: float, speeds: tuple[float, float],
    phase: str, must: str = "",
) -> str:  # fmt: skip
    """Move the suspended tool over `place`, lower it (`phase`), and draw the hooks out.

    An operator's order to draw back lifts it again; `must` states why this step cannot be skipped.
    Returns "", or the reason why the tool was lifted again and stays on the hooks.
    """
    work = _PutDown(s, place, weight_n, speeds[1], phase)
    p, yaw = np.array(s.vehicle.reference["p_WB"]), place.yaw
    detour = Detour(work.lift, lambda: move_platform(s, p, yaw, NEAR_SPEED))
    reason = s.orders.attempt(f"the place of {phase!r}", work.fly, LEFT_OUT, detour, must)
    if not reason:
        let_go(s, grip, speeds[0])
    return reason


class _PutDown:
    """State of a tool that is lowered, which an operator's order may interrupt.

    The platform corrects the position of the suspended tool until it stands. During the descent
    gusts move both by more than the tolerance, so the tool waits READY_M above its place until its
    predicted error is small.
    """

    def __init__(
        self, s: Supervisor, place: Place, weight_n: float, speed: float, phase: str
    ) -> None:
        self.s, self.place, self.weight_n, self.phase = s, place, weight_n, phase
        self.weight, self.most, self.speed = Weight(s, weight_n), 1.5 * weight_n, speed
        self.height = float(s.vehicle.reference["p_WB"][2])

    def fly(self) -> str:
        """Lower the tool until it stands; returns "", or the reason why it was lifted again."""
        s, place, weight, speed = self.s, self.place, self.weight, self.speed
        align_tool(s, weight, place, self.most)
        s.begin(self.phase)
        ends = s.vehicle.t + WAITS_S
        errors, meets = [place.p_WO - measure_tool(s)[0]], False
        while weight.carried > LIGHT_N:
            error = place.p_WO - measure_tool(s)[0]
            errors = [*errors[-LATEST:], error]
            if -error[2] < 1.5 * READY_M and not meets:
                drift = (error - errors[0]) / (MISSION_TICK * (len(errors) - 1))
                arrives = error + drift * (LAG_S - error[2] / speed)
                meets = max(math.hypot(*error[:2]), math.hypot(*arrives[:2])) < MEETS_M
            if s.vehicle.t > ends or error[2] > DEEP:
                self.lift()
                if not meets:
                    within = f"{1e3 * MEETS_M:g} mm"
                    return f"the tool did not come within {within} of its place: it swings"
                return "nothing took the tool's weight at its place"
            if weight.carried < 0.7 * self.weight_n:  # it stands
                v = np.array([0.0, 0.0, -speed])
            else:
                v = _correct(error)
                slow = LOWER_RATE * (error[2] + READY_M)
                v[2] = -speed if meets else min(max(slow, -speed), speed)
            weight.step(s, v, self.most)
        return ""

    def lift(self) -> None:
        """Lift the tool again to its initial height."""
        while float(self.s.vehicle.reference["p_WB"][2]) < self.height:
            self.weight.step(self.s, np.array([0.0, 0.0, self.speed]), self.most)


def align_tool(s: Supervisor, weight: Weight, place: Place, most: float) -> None:
    """Move the suspended tool over `place` at constant height; `most` (N) as in `Weight.step`."""
    ends, calm = s.vehicle.t + 20.0, 0
    above = float(measure_tool(s)[0][2])
    while s.vehicle.t < ends and calm < 50:
        error = place.p_WO - measure_tool(s)[0]
        error[2] = above - measure_tool(s)[0][2]
        weight.step(s, _correct(error), most)
        calm = calm + 1 if float(np.linalg.norm(error[:2])) < ALIGN_M else 0


def _correct(error: Array) -> Array:
    """Return the velocity (3,) m/s of the platform for a position error (3,) m of the tool."""
    v = ALIGN_RATE * error
    return np.asarray(v * min(1.0, ALIGN_SPEED / max(math.hypot(*v), 1e-9)))


def let_go(s: Supervisor, grip: Grip, speed: float) -> None:
    """Draw the hooks out of the handle, along the mouth, and hold the arms there.

    If the handle is not at hand, the arms move to their low posture and the platform stays.
    """
    s.begin("release")
    row = set_rest(s.vehicle.reference)
    row["load"] = 0.0
    s.body.track(row[None])
    if not is_at_hand(s, grip):
        s.arms.move_to(grip.q_low)
        s.until_arrived()
        return
    place = find_tool(s, MISSION_TICK)
    lead_hands(s, grip, -LOW, speed)
    move_platform(s, find_platform(grip, place) - [0.0, 0.0, DROP], place.yaw, speed)
    s.wait(STEADY_S)

"""Two hooks and a tool with a handle: take it up, put it down (Suarez 2020, section VI-A).

A hook and the forearm behind it make a V, the cradle, that is open upward. The hands come from
below, and the platform lifts while the springs of the arms yield. As the weight passes to the hands
it shows in the platform's external force; that is fed forward to the springs and to the platform,
so that the hands rise again to where they were.
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

LOW = 0.08  # m, from the cradle, along its mouth, to where the hands wait for the handle
DROP = 0.06  # m, by which the platform is lower meanwhile, so that the arms need not stretch
PRESS = 0.015  # m, that the hands aim beyond the handle, so that they touch it
TOUCH_N = 0.4  # N, upward, at which a hand counts as touching
TOUCH_S = 0.06  # s, for which it has to be felt
LIFT = 0.10  # m, from which a tool counts as lifted
FEEL_S = 0.4  # s, lag of the felt weight; the estimate's own is about as long
ACCELERATION = 0.3  # m/s^2, of the platform
NEAR_SPEED = 0.15  # m/s, of the platform beside the tool and what it stands on
STEADY_S = 2.0  # s, to come to rest
LIGHT_N = 0.3  # N, under which a load counts as put down
DEEP = 0.04  # m, below its place: a tool that is lowered further has missed it
ALIGN_RATE = 0.5  # 1/s, at which the platform makes up for where the tool hangs
ALIGN_M = 0.004  # m, to which it does
ALIGN_SPEED = 0.05  # m/s
READY_M = 0.012  # m, above its place, where a tool waits until it will meet it
LOWER_RATE = 1.0  # 1/s, at which it comes there: that of the platform's loop, which lags by
LAG_S = 0.35  # s
WAITS_S = 60.0  # s, for the way down
MEETS_M = 0.005  # m, from its place that a tool may stand: half of what is allowed
LATEST = 10  # ticks, over which its drift is measured: an eighth of a swing
TILT_MAX = math.radians(12.0)  # of a handle that hangs in both hooks
LEFT_OUT = "it was not put down"
"""Why a tool stays on the hooks that an operator's order left there."""
STRAY = 0.2  # m, from the hands: a tool further away, or tilted more, has fallen


class Place(NamedTuple):
    """Where a tool stands: its frame O."""

    p_WO: Array  # (3,) m
    yaw: float


class Grip(NamedTuple):
    """How the arms hold the handle; vectors in a level frame with the robot's heading."""

    q: Array  # (n_joints,) rad, handle in the cradle
    q_low: Array  # (n_joints,) rad, hands LOW below
    hands: Array  # (2, 3) m, in B at q
    cradle: Array  # (3,) m, from the hand's point to the axis of a handle that lies in the cradle
    mouth: Array  # (3,) unit, out of the cradle
    handle: Array  # (3,) m, middle of the handle in O


def find_platform(grip: Grip, place: Place) -> Array:
    """Return p_WB (3,) m from which the hands hold a tool that stands at `place`."""
    middle = 0.5 * (grip.hands[0] + grip.hands[1]) + grip.cradle
    return np.asarray(place.p_WO + rot_z(place.yaw) @ (grip.handle - middle))


def find_tool(s: Supervisor, seconds: float = 0.6) -> Place:
    """Watch the tool for a time; return its mean place."""
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
    """Move the platform rest to rest; hands and load keep what they were told."""
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
    """Lead both hands on straight lines (23) to `along` (m) of the mouth from where they hold.

    `beside` (3,) m, in O, is added. The goal is fixed to the tool, which is tracked all the time.
    """
    marker, goals = find_marker(s.vehicle.world), {}
    for name, hand in zip(("left", "right"), grip.hands, strict=True):
        side = np.array([0.0, hand[1], 0.0])
        p_O = grip.handle + side - grip.cradle + along * grip.mouth
        p_O = p_O if beside is None else p_O + beside
        goals[name] = marker.R.T @ (p_O - marker.p)
    s.arms.hands_to_marker(goals, speed)


def compute_miss(s: Supervisor, grip: Grip, shift: Array | None = None) -> float:
    """Return how far (m) the worse hand is, across the handle, from where it holds it.

    `shift` (3,) m: from the estimate to where the robot is taken to be.
    """
    p, R = measure_tool(s)
    p, worst = p if shift is None else p - shift, 0.0
    for h, hand in enumerate(grip.hands):
        goal = p + R @ (grip.handle + np.array([0.0, hand[1], 0.0]) - grip.cradle)
        worst = max(worst, float(np.linalg.norm(s.vehicle.read(Hands).p_WH[h] - goal)))
    return worst


def is_at_hand(s: Supervisor, grip: Grip) -> bool:
    """Whether the tool is upright and near the hands; one that is not must not be followed."""
    return compute_miss(s, grip) < STRAY and measure_tool(s)[1][2, 2] > math.cos(TILT_MAX)


class Weight:
    """The weight on the hands as the platform feels it: slow, and against a known beginning."""

    def __init__(self, s: Supervisor, carried: float) -> None:
        """`carried` (N) hangs on the hands now."""
        self.carried = carried
        ups = []
        for _ in range(50):
            s.tick()
            ups.append(float(s.vehicle.estimate["f_ext_W"][2]))
        self._zero = float(np.mean(ups)) + carried

    def feel(self, s: Supervisor, most: float) -> None:
        """Take in what is felt in this tick: no less than nothing, no more than `most` (N)."""
        felt = self._zero - float(s.vehicle.look(Estimate).f_ext_W[2])
        self.carried += MISSION_TICK / FEEL_S * (min(max(felt, 0.0), most) - self.carried)

    def step(self, s: Supervisor, v: Array, most: float) -> None:
        """Fly one tick at v (3,) m/s with the load that is felt, no more than `most` (N)."""
        self.feel(s, most)
        row = set_rest(s.vehicle.reference)
        row["p_WB"] += MISSION_TICK * v
        row["v_WB"] = v
        row["load"] = 0.5 * self.carried
        s.body.track(row[None])
        s.tick()


def hold_joints(s: Supervisor) -> None:
    """Let the arms hang on their springs from where the servos lead them now."""
    s.arms.move_to(np.array(s.vehicle.read(HandState).q_goal[: s.vehicle.n_joints]))
    s.until_arrived()


def take_up_again(
    s: Supervisor, grip: Grip, most: float, retries: int, speeds: tuple[float, float]
) -> float | None:
    """Grasp the handle and lift it; returns the tool's weight (N), or None where it was missed.

    `speeds` (m/s) are those of hands and platform; `most` (N) is what may be lifted. The platform
    stands DROP below where `find_platform` says. After a miss the hands wait below the handle, and
    grasp up to `retries` times again, where the tool is then. A tool that is not at hand any more,
    as one that was knocked over, is not followed. An operator's order to draw back sets the tool
    down and draws the hooks out.
    """
    work = _TakeUp(s, grip, most, speeds)
    detour = Detour(work.lower, lambda: None)
    return s.orders.attempt("the handle", lambda: work.fly(retries), None, detour)


class _TakeUp:
    """The state of a grasp, in which an operator's order may end it."""

    def __init__(self, s: Supervisor, grip: Grip, most: float, speeds: tuple[float, float]) -> None:
        self.s, self.grip, self.most, self.speeds = s, grip, most, speeds
        self.weight: Weight | None = None
        self.height = math.inf  # m, of the platform from which it lifts; inf: it does not

    def fly(self, retries: int) -> float | None:
        """Grasp until the tool hangs."""
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
        """Grasp once; returns the weight (N) on the hooks, None for a miss."""
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

        The feedforward of its weight raises the load, so the platform descends until it stands.
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
    """Raise platform and hands until both hands feel the handle; stop there.

    The goals hang on the tool: hands that went on would follow a tool that they lift.
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
    """Bring the hanging tool over `place`, lower it (`phase`), and draw the hooks out.

    An operator's order to draw back lifts it again; `must` says why it cannot be left out. Returns
    "", or why the tool was lifted again and stays on the hooks.
    """
    work = _PutDown(s, place, weight_n, speeds[1], phase)
    p, yaw = np.array(s.vehicle.reference["p_WB"]), place.yaw
    detour = Detour(work.lift, lambda: move_platform(s, p, yaw, NEAR_SPEED))
    reason = s.orders.attempt(f"the place of {phase!r}", work.fly, LEFT_OUT, detour, must)
    if not reason:
        let_go(s, grip, speeds[0])
    return reason


class _PutDown:
    """The state of a tool that is lowered, in which an operator's order may end it.

    The platform makes up for where the tool hangs until it stands. Gusts move both by more than
    that in the seconds of the way down, so the tool waits READY_M above its place until it will
    meet it.
    """

    def __init__(
        self, s: Supervisor, place: Place, weight_n: float, speed: float, phase: str
    ) -> None:
        self.s, self.place, self.weight_n, self.phase = s, place, weight_n, phase
        self.weight, self.most, self.speed = Weight(s, weight_n), 1.5 * weight_n, speed
        self.height = float(s.vehicle.reference["p_WB"][2])

    def fly(self) -> str:
        """Lower it until it stands; returns "", or why it was lifted again."""
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
        """Lift it again to where it hung."""
        while float(self.s.vehicle.reference["p_WB"][2]) < self.height:
            self.weight.step(self.s, np.array([0.0, 0.0, self.speed]), self.most)


def align_tool(s: Supervisor, weight: Weight, place: Place, most: float) -> None:
    """Bring the hanging tool over `place`, its height kept; `most` (N) as in `Weight.step`."""
    ends, calm = s.vehicle.t + 20.0, 0
    above = float(measure_tool(s)[0][2])
    while s.vehicle.t < ends and calm < 50:
        error = place.p_WO - measure_tool(s)[0]
        error[2] = above - measure_tool(s)[0][2]
        weight.step(s, _correct(error), most)
        calm = calm + 1 if float(np.linalg.norm(error[:2])) < ALIGN_M else 0


def _correct(error: Array) -> Array:
    """Speed (3,) m/s of the platform for an error (3,) m of the tool."""
    v = ALIGN_RATE * error
    return np.asarray(v * min(1.0, ALIGN_SPEED / max(float(np.linalg.norm(v)), 1e-9)))


def let_go(s: Supervisor, grip: Grip, speed: float) -> None:
    """Draw the hooks out of the handle, along the mouth, and let the arms hang there.

    Where there is no handle any more, the arms go low and the platform stays.
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

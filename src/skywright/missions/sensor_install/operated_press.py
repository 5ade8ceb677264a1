"""An operator presses the sensor onto the pipe with the left hand: law (24), then a force.

The robot moves the hand to the stand-off, offset by `HAND_OVER` from the place, and hands over. The
platform hovers; the stick moves the hand. With `control = "position"` it does so in contact as
well; the springs of the arm turn the motion beyond the surface into a force. With `control =
"force"` the stick raises and lowers the force along the normal from the first touch on. If it
lowers the force to zero, it moves the hand again.

In free air the hand's goal is fixed in W: the arm compensates the platform's motion. In contact the
goal is given as joint angles, relative to the platform. A hand held by friction whose arm
compensates the platform's motion would push the platform away with the lag of the servos, and the
platform would swing.
"""

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.core.types import TASK_FORCE, TASK_JOINTS
from skywright.missions.sensor_install.plan import InstallPlan
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.assistance import LIMIT, Assistance
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.operated import Lead, OperatorGone, compute_velocity
from skywright.run.operator import Sight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands, HandState
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([-0.02, 0.02, 0.0])  # m, ahead, left, up, from the place below the pipe
FENCE = np.array([[-0.06, -0.06, -0.1], [0.06, 0.06, 0.08]])
"""m, relative to the place on the pipe: lowest and highest position that the stick can command."""
UP = (0.0, 0.0, 1.0)
CONTACT_N, CONTACT_S = 0.3, 0.1  # N, s: a touch
RIGHT = 0.4  # relative force error below which the phase "force" begins
LOST_S = 1.0  # s without contact, after which the hand moves to the pipe again
RATE = 0.5  # 1/s, rate of the force at full deflection, relative to the requested force
MOST = 2.0  # largest force that the stick can command, relative to the requested force
DAMPING = 0.03  # m, damping of the inverse Jacobian near a singularity
LEAST_N = 0.1  # N; below it the stick moves the hand again


def press_by_operator(s: Supervisor[SensorInstall], lead: Lead, way: InstallPlan) -> str:
    """Fly "touch", "press" and "force" with the operator; returns the reason of a failure, or "".

    The press ends when the operator presses the button in contact.
    """
    press = _Press(s, lead, way)
    s.begin("touch")
    lead.begin()
    try:
        while not press.step():
            pass
    except OperatorGone as gone:
        s.end("failed")
        return f"{gone} before the sensor was pressed on: the hand exerted {press.force:.1f} N"
    finally:
        press.lead.end()
    return ""


class _Press:
    """State of an operated press; each step is one tick."""

    def __init__(self, s: Supervisor[SensorInstall], lead: Lead, way: InstallPlan) -> None:
        self.s, self.task, self.lead = s, s.task, lead
        x = rot_z(way.yaw)[:, 0]
        self.R = np.column_stack([x, np.cross(way.normal, x), way.normal])
        self.contact = way.contact
        self.help = Assistance(s.task.assistance, s.task.force_n)
        self.goal, self.force = self._measure(), 0.0
        self.exerts = 0.0  # N, commanded in force control; 0: the stick moves the hand
        self._phase, self._felt, self._free = "touch", 0.0, 0.0

    def step(self) -> bool:
        """Read the stick and fly a tick; returns whether the operator reports the end."""
        s, task = self.s, self.task
        off = self._measure()
        self.force = float(s.vehicle.read(HandForce).f_WH[0] @ self.R[:, 2])
        stick = self.lead.read(
            Sight(off, False, UP, max(self.force, 0.0), task.force_n, task.hold_s)
        )
        if self._watch() and stick.button:
            return True
        up = float(stick.axes[2])
        if task.control == "force" and self._phase != "touch" and self._exert(up):
            return False
        axes, v_max = np.array(stick.axes), task.stick_speed_mps
        axes[2] = self.help.step(up, v_max, -float(off[2]), max(self.force, 0.0)) / v_max
        v = compute_velocity(axes, v_max, self.goal, FENCE)
        self.goal = self.goal + MISSION_TICK * v
        if self._phase == "touch":
            s.arms.hands_velocity({"left": self.R @ v})
        else:
            self._lead_joints(self.R @ v)
        s.tick()
        return False

    def _lead_joints(self, v: Array) -> None:
        """Command joint angles with which a free hand would move at v (3,) m/s relative to the
        platform."""
        vehicle = self.s.vehicle
        arm, state, row = (
            vehicle.read(ArmModel),
            vehicle.read(HandState),
            set_rest(vehicle.reference),
        )
        mine = slice(arm.first[0], arm.first[0] + arm.n)
        if row["task"][0] != TASK_JOINTS:
            row["q"][mine] = state.q_goal[mine]
        J = vehicle.estimate["R_WB"] @ vehicle.read(Hands).J_BP[0][:, mine]
        damped = J @ J.T + DAMPING**2 * np.eye(3)
        row["q"][mine] += MISSION_TICK * J.T @ np.linalg.solve(damped, v)
        row["task"][0] = TASK_JOINTS
        self.s.body.track(row[None])

    def _measure(self) -> Array:
        """Return the hand's position relative to its place on the pipe, (3,) m: ahead, left, up."""
        p: Array = self.s.vehicle.read(Hands).p_WH[0]
        return self.R.T @ (p - self.contact)

    def _watch(self) -> bool:
        """Begin the phase that matches the contact; returns whether there is contact."""
        touch = self.force > CONTACT_N
        self._felt = self._felt + MISSION_TICK if touch else 0.0
        self._free = 0.0 if touch else self._free + MISSION_TICK
        if self._phase == "touch" and self._felt > CONTACT_S - 1e-9:
            self._begin("press")
        if self._phase != "touch" and self._free > LOST_S:
            self.s.end("retry")
            self._begin("touch")
        off = abs(self.force - self.task.force_n)
        if self._phase == "press" and off < RIGHT * self.task.force_n:
            self._begin("force")
        return self._phase != "touch"

    def _begin(self, phase: str) -> None:
        self._phase = phase
        self.s.begin(phase)

    def _exert(self, up: float) -> bool:
        """Change the force by the stick for a tick; returns whether the hand exerts one."""
        s, asked = self.s, self.task.force_n
        if self.exerts == 0.0:
            self.exerts = max(self.force, CONTACT_N)
        most = MOST * asked
        change = RATE * asked * up
        if self.task.assistance == "guard":
            most = LIMIT * asked
        self.help.step(up, self.task.stick_speed_mps, 0.0, self.force)
        if self.help.holding:
            change = min(max(asked - self.exerts, -RATE * asked), RATE * asked)
        self.exerts = min(self.exerts + MISSION_TICK * change, most)
        if self.exerts < LEAST_N:
            self.exerts, self.goal = 0.0, self._measure()
            return False
        row = set_rest(s.vehicle.reference)
        row["task"][0], row["p_WH"][0] = TASK_FORCE, s.vehicle.read(Hands).p_WH[0]
        row["v_WH"][0], row["f_WH"][0] = 0.0, self.exerts * self.R[:, 2]
        s.body.track(row[None])
        s.tick()
        return True

"""Keys of a mission of the kind "impact"."""

from typing import Literal

from pydantic import Field

from skywright.description.mission.spec import Task
from skywright.description.robot.spec import Robot

_SPRING = {
    "flex_stiffness_nm_per_rad": None,
    "flex_damping_nms_per_rad": None,
    "flex_linear_deg": None,
    "deflection_encoder": False,
}


class Impact(Task):
    """Fly into a padded obstacle with the left hand or with the passive link."""

    speed_mps: float = Field(default=0.5, ge=0.05, le=1.5)  # speed at the impact
    pad: str | None = None  # name of the thing to hit; default: the first pad
    part: Literal["arm", "link"] = "arm"  # part that hits it: the left hand or the passive link
    # stiff: without springs between servos and links
    joints: Literal["compliant", "stiff"] = "compliant"
    # time from the planned contact to the command to stop
    reaction_s: float = Field(default=0.1, ge=0, le=1)

    def adapt_robot(self, robot: Robot) -> Robot:
        """Remove the springs from the joints if the task requires it."""
        if self.joints == "compliant" or robot.arm is None:
            return robot
        links = {n: link.model_copy(update=_SPRING) for n, link in robot.arm.links.items()}
        return robot.model_copy(update={"arm": robot.arm.model_copy(update={"links": links})})

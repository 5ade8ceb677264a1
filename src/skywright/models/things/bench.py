"""A bench: a fixture that clamps the platform while the arms are free; a trial can move it."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from skywright.description.world.thing import Fixture


class Bench(Fixture):
    """A fixture that clamps the platform, which heads +x; O is the platform's origin."""

    kind: str = "bench"
    anywhere: ClassVar[bool] = True
    z_m: float = Field(default=1.2, gt=0, le=100)
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)  # about y; at 90, z of B points along x

    @model_validator(mode="after")
    def _heads_along_x(self) -> Bench:
        if self.yaw_deg:
            raise ValueError(f"yaw_deg is {self.yaw_deg:g}; valid: 0, since a bench heads +x")
        return self

    @property
    def q_WB(self) -> tuple[float, float, float, float]:
        """Attitude of the platform (wxyz)."""
        half = 0.5 * math.radians(self.pitch_deg)
        return math.cos(half), 0.0, math.sin(half), 0.0

    def extend_plant(self, spec: Any, name: str) -> None:
        """Clamp the platform to a body whose pose is prescribed (a MuJoCo "mocap" body)."""
        import mujoco

        place = [self.x_m, self.y_m, self.z_m]
        spec.worldbody.add_body(name=name, mocap=True, pos=place, quat=list(self.q_WB))
        clamp = spec.add_equality(
            name=self.CLAMP, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1="platform", name2=name,
        )  # fmt: skip
        clamp.solref = [0.005, 1.0]
        clamp.data = np.array([0, 0, 0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0])  # same frame

    def describe(self) -> str:
        """Return a description with height and pitch of the platform."""
        return f"bench that clamps the platform at {self.z_m:g} m, pitched {self.pitch_deg:g} deg"

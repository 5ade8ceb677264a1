"""Robot and world as a MuJoCo model, and the robot as URDF."""

from pathlib import Path

import mujoco

import skywright

model = skywright.build_model("othex", "pipe")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
print(f"{model.nbody} bodies, {model.nv} degrees of freedom, {sum(model.body_mass):.2f} kg")
Path("othex.xml").write_text(skywright.build_mjcf("othex", "pipe"))
Path("othex.urdf").write_text(skywright.build_urdf("othex"))

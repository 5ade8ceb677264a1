"""A control law stepped on your own state."""

import numpy as np

import skywright

law = skywright.build_law(skywright.load("waypoints", robot="othex"))
print("at rest:", law.step().f_B)  # N, in B: the weight
law.estimate.p_WB = law.reference.p_WB + [0.1, 0.0, 0.0]  # m, too far ahead
for _ in range(5):
    command = law.step()
print("pushed back:", np.round(command.f_B, 2), "N,", np.round(command.t_B, 2), "N m")

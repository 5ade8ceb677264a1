"""Results of a run as arrays by name."""

import numpy as np

import skywright

directory = skywright.run("waypoints", report=False).directory
run = skywright.open_run(directory)
error = np.linalg.norm(run["platform.p_W"] - run["reference.platform.p_W"], axis=1)  # m
print(f"{run.outcome}: largest error {error.max():.3f} m at t = {run['t'][error.argmax()]:.2f} s")
print(f"energy {run.metrics['flight.energy_wh']:.2f} Wh")
for phase in run.phases:
    print(f"{phase.name}: {phase.start_s:.1f} to {phase.end_s:.1f} s, {phase.outcome}")

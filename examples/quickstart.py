# %% [markdown]
# # Scan a pipe, look at the weld, change the conditions
#
# Cells for VS Code, Spyder or Jupytext; also a plain script: `python examples/quickstart.py`.
# Results are typed objects and NumPy arrays in SI units and radians; any other unit is in the name.

# %% Plan and fly the built-in mission on a smaller, inclined pipe
import numpy as np

import skywright

description = skywright.load(
    "pipe-weld-scan",
    sets={"world.pipe.diameter_m": 0.35, "world.pipe.inclination_deg": 10.0},
    seed=7,
)
plan = skywright.plan(description)
print(f"planned in {plan.plan_s:.2f} s: {plan.duration_s:.0f} s of flight,")
print(f"at least {1e3 * plan.min_clearance_m:.0f} mm from everything")

result = skywright.run(description, report=False)
print(f"{result.outcome} in {result.timing['wall_s']:.1f} s")

# %% Requirements and metrics
for verdict in result.requirements:
    mark = "met" if verdict.passed else "FAILED"
    print(f"{verdict.name:24s} {verdict.value:8.3f} {verdict.sense} {verdict.limit:g}  {mark}")

# %% The recording is one structured array: 100 samples a second, fields in core/types.py
samples = result.samples
scan = next(i for i, phase in enumerate(result.phases) if phase.name == "scan")
force = samples["f_normal"][samples["phase"] == scan]  # N
print(f"push while scanning: {force.mean():.2f} N, from {force.min():.2f} to {force.max():.2f} N")

# %% The weld, as the instrument's processing found it
line = result.details.line
print(f"weld at {np.degrees(line.angle):.2f} deg from the circumference")
print(f"standard deviation {np.degrees(line.std_angle):.2f} deg, {1e3 * line.std_offset:.1f} mm")

# %% The same robot against more wind than it may be asked to hold: refused, with the numbers
windy = skywright.load(
    "pipe-weld-scan", sets={"world.wind.kind": "steady", "world.wind.mean_mps": 9.0}
)
print(skywright.plan(windy).blocked_by)

# %% Evaluate a finished run again from its directory
again = skywright.evaluate(result.directory)
assert again.metrics["weld.angle_error_deg"] == result.metrics["weld.angle_error_deg"]

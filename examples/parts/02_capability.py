"""A robot and its capability."""

import math

import skywright

robot = skywright.load_robot("othex", sets={"robot.platform.mass_kg": 2.0})
print(f"platform {robot.platform.mass_kg} kg, rotors {robot.rotors.thrust_max_n} N each")
can = skywright.compute_capability(robot, posture="folded")
print(f"level: {can.lateral_force.min():.1f} N to every side, {can.payload:.2f} kg payload")
print(f"hovers {math.degrees(can.hover_tilt[0]):.1f} deg rolled, {can.endurance / 60:.0f} min")

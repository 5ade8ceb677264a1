"""Data of instruments and flights: a weld, a trajectory, a robot's parameters."""

import skywright

weld = skywright.weld("examples/weld_data/pipe_scan.csv", calibrate="0:7")
print(f"weld: {weld.to_json()['line']}")
bag = "runs/waypoints/recording.mcap"
judged = skywright.locate(f"{bag}:/estimate/pose", reference=f"{bag}:/truth/pose")
print(f"trajectory: {judged.to_json()['errors']}")
robot = skywright.identify("runs/waypoints")
for name, found in robot.to_json()["parameters"].items():
    print(name, found["value"], found["unit"] if found["identified"] else "not identified")

"""A vehicle ticked in a loop, with save and restore."""

import skywright

vehicle = skywright.build_vehicle("waypoints")
while not vehicle.localised:
    vehicle.tick()
skywright.Uav(vehicle).take_off(1.2)  # m
while not vehicle.tick().arrived:
    pass
state = vehicle.save()
for seed in (1, 2, 1):
    vehicle.restore(state, seed)
    height = [vehicle.tick() and vehicle.last_sample["p_WB"][0, 2] for _ in range(100)]
    print(f"noise of seed {seed}: {height[-1]:.6f} m after 2 s")

"""A vehicle ticked in a loop, with save and restore."""

import skywright

vehicle = skywright.build_vehicle("waypoints")
while not vehicle.localised:
    vehicle.tick()
skywright.Uav(vehicle).take_off(1.2)  # m
state = vehicle.save()
for seed in (1, 2, 1):
    vehicle.restore(state, seed)
    while not vehicle.tick().arrived:
        pass
    print(f"noise of seed {seed}: {vehicle.last_sample['p_WB'][0, 2]:.6f} m")

"""A vehicle ticked in a loop, with save and restore."""

import skywright

vehicle = skywright.build_vehicle("waypoints")
while not vehicle.localised:
    vehicle.tick()
skywright.Uav(vehicle).take_off(1.2)  # m
state = vehicle.save()
for seed in (1, 2, 1):
    vehicle.restore(state, seed)
    ticks = [vehicle.tick() for _ in range(150)]  # 3 s
    print(f"seed {seed}: {vehicle.last_sample['p_WB'][0, 2]:.6f} m at {ticks[-1].t:.2f} s")

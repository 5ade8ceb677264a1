"""A vehicle flown by a script, with its arms and its streams."""

import skywright

vehicle = skywright.fly("bimanual", backend="kinematic")  # or "physics"
vehicle.subscribe("state", lambda t, state: print(f"{t:.0f} s: {state}"), rate_hz=0.2)
vehicle.take_off(1.5)  # m; commands wait until they have ended
print(vehicle.go_to((1.0, 0.5, 1.8), yaw=0.5).result)
for _ in range(50):  # a stream at 50 Hz
    vehicle.set_velocity((0.0, 0.2, 0.0), yaw_rate=0.1)  # m/s in W, rad/s
    vehicle.tick()
print(vehicle.pose.p, vehicle.battery, vehicle.take_off(1.0).result.reason)  # refused
vehicle.land()

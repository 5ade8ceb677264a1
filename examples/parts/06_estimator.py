"""An estimator on your own arrays; here those that a run recorded."""

import numpy as np

import skywright

run = skywright.open_run("runs/waypoints")
imu, fix = run["/sensors/inertial"], run["/sensors/mocap/platform"]
found = skywright.run_estimator("waypoints", t=imu["t"], gyro=imu["gyro"], accel=imu["accel"],
                                t_fix=fix["t"], p_fix=fix["p_WB"], R_fix=fix["q_WB"])  # fmt: skip
true = np.array([np.interp(found["t"], run["t"], x) for x in run["platform.p_W"].T]).T
error = np.linalg.norm(found["p_WB"] - true, axis=1)[found["t"] > 2.0]
print(f"{1e3 * np.sqrt(np.mean(error**2)):.2f} mm rms")

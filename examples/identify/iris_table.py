"""A public flight of PX4's Iris in Gazebo, written as tables for `skywright identify`.

    python examples/identify/iris_table.py data-driven-dynamics/resources/quadrotor_model.csv

The file is one of ethz-asl/data-driven-dynamics: pulse widths, velocity (north, east, down),
attitude (W from B), body rates and specific force (forward, right, down), at 100 Hz. Another
program simulated the flight. The parameters of its model are known, and the table in
docs/howto/identify.md compares them with the identified ones.

Gazebo turns a pulse width u (0 to 1) into a speed of 100 + 1000 u rad/s. `iris-gazebo.csv` holds
these speeds as shares of the full speed. `iris-linear.csv` takes thrust proportional to u instead,
as PX4 does by default (THR_MDL_FAC = 0). Needs NumPy and SciPy only.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

ORDER = (2, 1, 3, 0)  # PX4's motors of the Iris, counter-clockwise from front left
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # from north, east, down
UP = np.array([0.0, 0.0, 1.0])
STALL = 25.0  # m/s along its axis at which a rotor of Gazebo's motor model has no thrust
FLU = np.diag([1.0, -1.0, -1.0])  # from forward, right, down


def build_table(file: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the columns of a table without commands, and the pulse widths (n, 4) from 0 to 1."""
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))

    def read(*names: str) -> np.ndarray:
        lacking = [k for k in names if not rows or not rows[0].get(k)]
        if lacking:
            raise SystemExit(f"{file}: lacks the columns {', '.join(lacking)}, or rows")
        return np.array([[float(row[k]) for k in names] for row in rows])

    def name(columns: np.ndarray, *names: str) -> dict[str, np.ndarray]:
        return dict(zip(names, columns.T, strict=True))

    attitude = Rotation.from_quat(read("q1", "q2", "q3", "q0")).as_matrix()  # scalar last
    x, y, z, w = Rotation.from_matrix(ENU @ attitude @ FLU).as_quat().T
    us = read("timestamp")[:, 0]
    table = {"t_s": (us - us[0]) * 1e-6}
    rates = read("ang_vel_x", "ang_vel_y", "ang_vel_z") @ FLU
    table |= name(rates, "wx_rad_s", "wy_rad_s", "wz_rad_s")
    table |= name(read("acc_b_x", "acc_b_y", "acc_b_z") @ FLU, "ax_m_s2", "ay_m_s2", "az_m_s2")
    table |= name(read("vx", "vy", "vz") @ ENU.T, "vx_m_s", "vy_m_s", "vz_m_s")
    table |= {"qw": w, "qx": x, "qy": y, "qz": z}
    pulses = read(*(f"u{i}" for i in ORDER))
    return table, np.clip((pulses - 1000.0) / 1000.0, 0.0, 1.0)


def main() -> None:
    """Write the two tables into the current folder."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_file():
        raise SystemExit(f"usage: {Path(sys.argv[0]).name} quadrotor_model.csv")
    table, pulses = build_table(Path(sys.argv[1]))
    turning = pulses > 0.0
    curves = {"gazebo": np.where(turning, 100.0 + 1000.0 * pulses, 0.0) / 1100.0,
              "linear": np.sqrt(pulses)}  # fmt: skip
    for curve, share in curves.items():
        columns = table | {f"command_{i + 1}": share[:, i] for i in range(4)}
        np.savetxt(
            f"iris-{curve}.csv", np.column_stack(list(columns.values())), "%.8g", ",",
            header=",".join(columns), comments="",
        )  # fmt: skip
        print(f"iris-{curve}.csv: {len(share)} rows, {table['t_s'][-1]:.1f} s")
    z = Rotation.from_quat(np.column_stack([table[k] for k in ("qx", "qy", "qz", "qw")])).apply(UP)
    along = sum(table[f"v{a}_m_s"] * z[:, i] for i, a in enumerate("xyz"))
    left = 1.0 - np.mean(np.abs(along)) / STALL
    print(f"thrust that Gazebo leaves at the flown speeds along the rotors' axes: {left:.3f}")


if __name__ == "__main__":
    main()

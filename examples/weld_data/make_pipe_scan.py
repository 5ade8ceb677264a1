"""Make `pipe_scan.csv`: a synthetic scan as an eddy-current instrument and a tracker would log it.

The signal model is deliberately not the one that Skywright simulates with (no Dodd and Deeds, no
tables): lift-off is a sum of two exponentials that turn in phase, the weld a bump with two
shoulders from its heat-affected zones, the texture a filtered random walk. So the file tests
`skywright weld` on something that its own processing did not produce.

    python examples/weld_data/make_pipe_scan.py [OUT.csv] [SEED]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

RADIUS = 0.162  # m
AXIS_POINT = np.array([3.10, -0.40, 1.85])  # m
YAW, INCLINATION = math.radians(25.0), math.radians(8.0)
WELD_ANGLE, WELD_OFFSET = math.radians(-14.0), 0.012  # from the circumference; m along the axis
RATE = 25.0  # Hz
AIR = 310 * np.exp(1j * math.radians(205))  # screen units
WELD = 30 * np.exp(1j * math.radians(128))


def pipe_frame() -> np.ndarray:
    """Columns x, y (axis), z of the pipe in the tracker's frame."""
    cy, sy, ci, si = math.cos(YAW), math.sin(YAW), math.cos(INCLINATION), math.sin(INCLINATION)
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    lift = np.array([[1, 0, 0], [0, ci, -si], [0, si, ci]])
    return turn @ lift


def smooth_noise(rng: np.random.Generator, n: int, samples: float) -> np.ndarray:
    """Unit-variance noise with a correlation of about `samples`."""
    kernel = np.hanning(max(3, int(3 * samples)))
    x = np.convolve(rng.standard_normal(n + kernel.size), kernel, mode="same")[:n]
    return x / x.std()


def make_scan(seed: int = 7) -> tuple[list[str], np.ndarray]:
    """Return the column names and the table of the scan."""
    rng = np.random.default_rng(seed)
    corners = []
    for i, phi in enumerate(np.radians([-22, -11, 0, 11, 22])):
        ends = (-0.09, 0.09) if i % 2 == 0 else (0.09, -0.09)
        corners += [(end, RADIUS * phi) for end in ends]
    points = np.array(corners)
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    t = np.arange(0, 8 + length[-1] / 0.009 + 3, 1 / RATE)
    travel = np.clip((t - 8) * 0.009, 0, length[-1])
    s = np.interp(travel, length, points[:, 0]) + 0.0015 * smooth_noise(rng, t.size, 40)
    c = np.interp(travel, length, points[:, 1]) + 0.0015 * smooth_noise(rng, t.size, 40)
    lift = np.clip(0.02 - 0.004 * t, 0, None) + np.clip((t - t[-1] + 2.5) * 0.01, 0, None)
    gap = lift + 2e-5 * np.abs(smooth_noise(rng, t.size, 3))

    tilt = np.radians(2.0 + 1.0 * smooth_noise(rng, t.size, 60))
    near = 0.55 * np.exp(-gap / 0.9e-3) + 0.45 * np.exp(-gap / 2.6e-3) * np.exp(0.12j)
    near *= 1 - 0.35 * tilt**2
    d = (s - WELD_OFFSET) * math.cos(WELD_ANGLE) - c * math.sin(WELD_ANGLE)
    shoulders = np.exp(-(((d - 0.007) / 0.003) ** 2)) + np.exp(-(((d + 0.007) / 0.003) ** 2))
    bump = np.exp(-((d / 0.0048) ** 2)) - 0.12 * shoulders
    texture = 0.06 * smooth_noise(rng, t.size, 0.025 / 0.009 * RATE / 2)
    air = AIR * (1 - near / near.real.max())
    ec = air + WELD * (bump + texture) * np.exp(-gap / 1.1e-3) + (40 - 15j)
    ec += 0.4 * (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size))

    phi = c / RADIUS
    frame = pipe_frame()
    normal = np.stack([-np.cos(phi), 0 * phi, np.sin(phi)], axis=1) @ frame.T
    p = AXIS_POINT + np.outer(s, frame[:, 1]) + (RADIUS + gap)[:, None] * normal
    p += 4e-4 * rng.standard_normal(p.shape)
    axis = -normal + np.tan(tilt)[:, None] * frame[:, 1]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    table = np.column_stack([t, ec.real, ec.imag, 1e3 * p, axis, 21 + 0.01 * t])
    names = ["t_s", "re", "im", "x_mm", "y_mm", "z_mm", "ax", "ay", "az", "temperature_c"]
    return names, table


def main() -> None:
    """Write the file, with the flaws that real logs have."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("pipe_scan.csv")
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    names, table = make_scan(seed)
    table[900:905, 3:6] = np.nan  # the tracker lost its target
    rows = [",".join(f"{v:.6g}" if k else f"{v:.3f}" for k, v in enumerate(r)) for r in table]
    rows[1200:1235] = []  # a pause in the log
    rows.insert(500, rows[500])  # a line written twice
    header = ["# eddy current 100 kHz, absolute probe; positions by an optical tracker"]
    out.write_text("\n".join([*header, ",".join(names), *rows]) + "\n")


if __name__ == "__main__":
    main()

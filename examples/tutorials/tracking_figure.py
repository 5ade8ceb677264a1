"""Draw a figure for a paper: tracking over time in one run, and its spread over a campaign.

    python tracking_figure.py RUN_DIRECTORY CAMPAIGN_DIRECTORY FIGURE.pdf

See docs/tutorials/researcher.md.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import skywright


def main(run: Path, campaign: Path, out: Path) -> None:
    """Write the figure: 85 mm wide, one column of a two-column page."""
    flight = skywright.open_run(run)
    error = np.linalg.norm(flight["platform.p_W"] - flight["reference.platform.p_W"], axis=1)  # m
    table = campaign / "results.csv"
    if not table.is_file():
        sys.exit(f"{table}: does not exist; give the folder that skywright campaign wrote")
    with table.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["position.rms_m"]]  # those that flew
    wind = [float(row["world.wind.mean_mps"]) for row in rows]
    rms = [1e3 * float(row["position.rms_m"]) for row in rows]

    figure = Figure(figsize=(85 / 25.4, 95 / 25.4), layout="constrained")
    over_time, over_wind = figure.subplots(2, 1)
    over_time.plot(flight["t"], 1e3 * error, lw=0.8)
    over_time.set(xlabel="time (s)", ylabel="position error (mm)")
    over_wind.plot(wind, rms, "o", ms=4)
    over_wind.set(xlabel="mean wind (m/s)", ylabel="error, rms (mm)", ylim=(0, None))
    figure.savefig(out)
    print(f"{out}: {len(rows)} runs, rms error {min(rms):.0f} to {max(rms):.0f} mm")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(*(Path(argument) for argument in sys.argv[1:4]))
    except skywright.InputError as error:
        sys.exit(str(error))

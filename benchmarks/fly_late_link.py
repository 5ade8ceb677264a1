"""Fly a weld scan whose control link gets slower in flight: `python benchmarks/fly_late_link.py`.

The check of the link before take-off (run/link_limit.py) would refuse this delay: the OTHex's
attitude loop tolerates 5.2 ms each way, and the link becomes 12 ms slower, once on the path to the
pipe and once during the scan. The rule link_late reduces the bandwidth of the loop, and the robot
lands. Each flight is evaluated by benchmarks/judge_faults.py.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from judge_faults import judge

from skywright.description.loader import load_description
from skywright.run.run import run_mission

SHORT = (
    "plant.map_error_m=0", "plant.map_error_deg=0", "plant.map_error_size_m=0",
    "mission.task.passes=1", "mission.task.pass_length_m=0.03",
)  # fmt: skip
LATER = (
    "world.link.delay_s=0.001", "plant.faults.late.kind=link",
    "plant.faults.late.loss_fraction=0", "plant.faults.late.delay_s=0.012",
)  # fmt: skip

if __name__ == "__main__":
    for start in (8, 30):
        sets = [*SHORT, *LATER, f"plant.faults.late.start_s={start}"]
        with tempfile.TemporaryDirectory() as folder:
            d = load_description("pipe-weld-scan", sets=sets)
            print(judge(run_mission(d, out=Path(folder) / "run").directory))

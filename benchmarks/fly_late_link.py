"""Fly a weld scan whose control link gets later in flight: `python benchmarks/fly_late_link.py`.

What the check of the link before take-off (run/link_limit.py) would refuse happens in flight: the
OTHex's attitude loop bears 5.2 ms each way, the link gets 12 ms later, once on the way to the pipe
and once while the robot scans. The rule link_late slows the loop, and the robot lands. Each flight
is judged as benchmarks/judge_faults.py does.
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

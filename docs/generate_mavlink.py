"""Write docs/reference/mavlink.md: which robot and mission flies over MAVLink, and why not.

python docs/generate_mavlink.py     (a minute; a test compares the page)

Nothing is flown: what is written is what the commands answer before anything is connected, and the
rows of benchmarks/mavlink-events.csv.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

ACCEPTED = "**accepted**"
PAGE = Path(__file__).parent / "reference" / "mavlink.md"
EVENTS = Path(__file__).parent.parent / "benchmarks" / "mavlink-events.csv"
HEAD = """# MAVLink: robots and missions

This page lists whether the commands accept each built-in robot and mission, before a connection.
`python docs/generate_mavlink.py` writes it. **Accepted** does not mean flown:
[Limitations](../limitations.md) lists what was flown.
"""


def list_robots() -> list[str]:
    """Return the rows of the robots."""
    import skywright
    from skywright.description.robot.loader import list_robots
    from skywright.errors import InputError
    from skywright.links.mavlink.body_force import compute_most, find_forceless
    from skywright.links.mavlink.check import find_unflyable
    from skywright.links.px4.parameters import build_airframe
    from skywright.run.parts import build_law
    from skywright.run.setup import Setup
    from skywright.vehicle.loops import choose_bandwidths

    rows = []
    for entry in list_robots():
        d = skywright.load("waypoints", robot=entry.name)
        setup = Setup(d)
        try:
            build_airframe(d.robot, d.world)
            airframe = ""
        except InputError as error:
            airframe = str(error)
        companion, law = find_unflyable(setup), build_law(d, setup)
        force = _tell(companion or find_forceless(d.robot, law, d.world.gravity_mps2))
        if force == ACCEPTED:
            most = compute_most(choose_bandwidths(law.table, setup), setup.rotors.time_constant)
            force = f"{ACCEPTED} up to {1e3 * most:.0f} ms"
        rows.append(
            f"| `{entry.name}` | {_tell(airframe)} | {_tell(airframe)} | {_tell(companion)} | "
            f"{force} |"
        )
    return rows


def list_missions() -> list[str]:
    """Return the rows of the missions."""
    import skywright
    from skywright.description.loader import list_missions
    from skywright.errors import SkywrightError
    from skywright.links.mavlink.check import find_refusal
    from skywright.links.px4.check import find_refusal as find_px4_refusal
    from skywright.run.parts import build_estimator
    from skywright.run.setup import Setup

    rows = []
    for entry in list_missions():
        try:
            d: Any = skywright.load(entry.name)
            setup = Setup(d)
            says = [find_px4_refusal(setup, build_estimator(d).is_truth), find_refusal(setup)]
        except SkywrightError as error:
            says = [str(error)] * 2
        rows.append(f"| `{entry.name}` | {_tell(says[0])} | {_tell(says[1])} |")
    return rows


def list_events() -> list[str]:
    """Return the rows of the flights in which something happened."""
    with EVENTS.open(encoding="utf-8", newline="") as file:
        return [
            f"| {r['moment']} | {r['event']} | {r['reason'] or 'goes on'} | {r['vehicle']} |"
            for r in csv.DictReader(file)
        ]


def _tell(says: str) -> str:
    return f"refused: {says}".replace("|", "\\|") if says else ACCEPTED


def build() -> str:
    """Return the page."""
    return "\n".join(
        [
            HEAD,
            "## Robots",
            "",
            "The last column names the largest dead time at which the position loop keeps a phase",
            "margin of 30 deg; a slower link is refused.",
            "",
            "| robot | `sitl ROBOT --autopilot px4` | `serve ROBOT --mavlink URL` | "
            "`run waypoints --robot ROBOT --backend mavlink:URL` | the same with `URL?force` |",
            "|---|---|---|---|---|",
            *list_robots(),
            "",
            "## Missions",
            "",
            "| mission | `run MISSION --backend px4` | `run MISSION --backend mavlink:URL` |",
            "|---|---|---|",
            *list_missions(),
            "",
            "## Events",
            "",
            "`run --backend mavlink:URL` flies a mission of one way-point with the robot of",
            "`serve hexarotor --mavlink URL`, both on one clock. Events are a loss of all",
            "packets for 0.2 s, for 2 s or permanently, a restart of the autopilot, a pilot who",
            "takes over for 3 s and gives back, or lands. Each event occurs once in each phase",
            "(`python benchmarks/mavlink_events.py`). The result must follow the",
            "[rules](../howto/real-vehicle.md#rules). The last column is the vehicle 15 s after",
            "the end of the mission. `touch-down` is the autopilot's landing at the end.",
            "",
            "| phase | event | the mission | the vehicle |",
            "|---|---|---|---|",
            *list_events(),
            "",
        ]
    )


if __name__ == "__main__":
    PAGE.write_text(build(), encoding="utf-8")

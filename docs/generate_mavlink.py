"""Write docs/reference/mavlink.md: which robot and mission flies over MAVLink, and why not.

python docs/generate_mavlink.py     (a minute; a test compares the page)

Nothing is flown: what is written is what the commands answer before anything is connected.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

ACCEPTED = "**accepted**"
PAGE = Path(__file__).parent / "reference" / "mavlink.md"
HEAD = """# MAVLink: robots and missions

What the commands answer for each built-in robot and mission before anything is connected, as
`python docs/generate_mavlink.py` writes it. **Accepted** is not flown: what was flown is in
[Limitations](../limitations.md).
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
        ]
    )


if __name__ == "__main__":
    PAGE.write_text(build(), encoding="utf-8")

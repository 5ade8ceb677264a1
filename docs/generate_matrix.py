"""Write docs/reference/matrix.md: which robot flies which mission, and why not.

python docs/generate_matrix.py [ROBOT ...]     (minutes a robot; a test holds the page to its form)

A pair is flown once, as `skywright run MISSION --robot ROBOT` does it, in a process that is given
LIMIT seconds. With names, only the rows of these robots are made anew.
"""

from __future__ import annotations

import multiprocessing
import re
import sys
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

PAGE = Path(__file__).parent / "reference" / "matrix.md"
LIMIT = 300.0
"""s a pair; the motion planner alone may search for longer."""
HEIGHT = 2.0  # m, of the line of follow-plan
LONGEST = 160  # characters of a reason
HEAD = """# Robots and missions

What `skywright run MISSION --robot ROBOT` gives for each built-in pair, as
`python docs/generate_matrix.py` writes it: one flight with the mission's seed and the robot's law.
A [campaign](../howto/campaign.md) with varied conditions says more. `follow-plan` follows a line of
1 m with the arms folded.

- **succeeded**: the flight met every requirement.
- *failed*, *aborted*: it was flown and missed a requirement, or was ended early.
- *no plan*: robot and mission fit, but the planner found no way within the limits.
- refused: robot, mission and world do not fit.
- *not decided*: planning and flight did not end within 300 s.
"""


def judge(robot: str, mission: str) -> tuple[str, str]:
    """Return (verdict, reason) of a pair: the outcome of the flight, no plan, or refused."""
    import skywright
    from skywright.errors import InfeasibleError, SkywrightError

    with tempfile.TemporaryDirectory() as scratch:
        try:
            sets: dict[str, object] = {}
            if mission == "follow-plan":
                sets["mission.task.plan_file"] = write_plan(robot, Path(scratch) / "plan")
                sets["mission.hover_height_m"] = HEIGHT
            description = skywright.load(mission, robot=robot, sets=sets)
            flown = skywright.run(description, out=Path(scratch) / "run", report=False)
        except InfeasibleError as error:
            return "no plan", error.blocked_by or str(error)
        except SkywrightError as error:
            return "refused", str(error).replace(f"{scratch}/", "")
    return flown.outcome, "" if flown.outcome == "succeeded" else flown.reason


def write_plan(robot: str, path: Path) -> str:
    """Write a plan file for a robot: 1 m ahead in 6 s, with its arms folded; return its name."""
    import numpy as np

    from skywright.description.robot.loader import load_robot
    from skywright.models.rigid_body import joint_names, posture
    from skywright.planning.motion.plan_file import PlanFile, write_plan_file
    from skywright.vehicle.rest_to_rest import quintic

    built, seconds = load_robot(robot)[0], 6.0
    t = np.linspace(0.0, seconds, 301)
    s, ds, dds = quintic(t / seconds)
    pose, rate, change = np.zeros((3, len(t), 4))
    pose[:, 0], pose[:, 2] = s, HEIGHT
    rate[:, 0], change[:, 0] = ds / seconds, dds / seconds**2
    q = np.tile(posture(built, "folded"), (len(t), 1))
    plan = PlanFile(
        robot, "open", 1, tuple(joint_names(built)), t, pose, rate, change, q, 0.0 * q, {}
    )  # fmt: skip
    write_plan_file(path, plan)
    return str(path.with_suffix(".csv"))


def serve(robot: str, missions: list[str], answers: Connection) -> None:
    """Judge missions one after the other."""
    for mission in missions:
        answers.send((mission, *judge(robot, mission)))


def judge_robot(robot: str, missions: list[str]) -> dict[str, tuple[str, str]]:
    """Return the verdicts of a robot; a pair that takes too long gets a new process after it."""
    out: dict[str, tuple[str, str]] = {}
    context = multiprocessing.get_context("spawn")
    while left := [mission for mission in missions if mission not in out]:
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=serve, args=(robot, left, there), daemon=True)
        process.start()
        there.close()
        try:
            while len(out) < len(missions) and here.poll(LIMIT):
                mission, verdict, reason = here.recv()
                out[mission] = (verdict, reason)
            stuck = next((mission for mission in left if mission not in out), None)
            if stuck is not None:
                out[stuck] = ("not decided", f"planning and flight took longer than {LIMIT:.0f} s")
        except EOFError:
            stuck = next(mission for mission in left if mission not in out)
            out[stuck] = ("not decided", "the process ended")
        process.kill()
        process.join()
    return out


def shorten(reason: str) -> str:
    """Return a reason on one line, without what a table's cell cannot hold."""
    text = re.sub(r"\s+", " ", reason).replace("|", "\\|")
    return text if len(text) <= LONGEST else text[:LONGEST].rsplit(" ", 1)[0] + " ..."


def write_section(robot: str, verdicts: dict[str, tuple[str, str]]) -> str:
    """Return a robot's table."""
    rows = [f"## {robot}", "", "| mission | answer | reason |", "|---|---|---|"]
    for mission in sorted(verdicts):
        verdict, reason = verdicts[mission]
        shown = {"succeeded": "**succeeded**", "refused": "refused"}.get(verdict, f"*{verdict}*")
        rows.append(f"| `{mission}` | {shown} | {shorten(reason) or '-'} |")
    return "\n".join(rows) + "\n"


def read_sections(text: str) -> dict[str, str]:
    """Return the page's sections by robot."""
    parts = re.split(r"(?m)^(?=## )", text)[1:]
    return {part.split("\n", 1)[0].removeprefix("## "): part.strip() + "\n" for part in parts}


def main(names: list[str]) -> None:
    """Write the page, or the sections of some robots in it."""
    from skywright.description.loader import list_missions
    from skywright.description.robot.loader import list_robots

    robots, missions = list_robots(), list_missions()
    names = names or [entry.name for entry in robots]
    sections = read_sections(PAGE.read_text("utf-8")) if PAGE.exists() else {}
    for name in names:
        sections[name] = write_section(name, judge_robot(name, [m.name for m in missions]))
        known = [entry.name for entry in robots if entry.name in sections]
        body = "\n".join(sections[robot] for robot in known)
        PAGE.write_text(f"{HEAD}\n{body}", encoding="utf-8")
        print(
            f"{name}: {sections[name].count('**succeeded**')} of {len(missions)} missions",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])

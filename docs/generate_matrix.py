"""Write docs/reference/matrix.md: which robot can be asked for which mission, and why not.

python docs/generate_matrix.py [ROBOT ...]     (minutes a robot; a test holds the page to its form)

Nothing is flown: a pair is planned as `skywright plan MISSION --robot ROBOT` does it, in a process
that is given LIMIT seconds. With names, only the rows of these robots are made anew.
"""

from __future__ import annotations

import multiprocessing
import re
import sys
from multiprocessing.connection import Connection
from pathlib import Path

PAGE = Path(__file__).parent / "reference" / "matrix.md"
LIMIT = 120.0
"""s a pair; the motion planner alone may search for longer."""
LONGEST = 160  # characters of a reason
HEAD = """# Robots and missions

What `skywright plan MISSION --robot ROBOT` answers for each built-in pair, as
`python docs/generate_matrix.py` writes it. A pair that can be planned is not thereby flown: the
mission's requirements and campaigns decide.

- **plan**: a plan exists.
- *no plan*: robot and mission fit, but the planner found no way within the limits.
- refused: robot, mission and world do not fit.
- *not decided*: the planning did not end within 120 s.
"""


def judge(robot: str, mission: str) -> tuple[str, str]:
    """Return (verdict, reason) of a pair; the verdict is plan, no plan or refused."""
    import skywright
    from skywright.errors import InfeasibleError, SkywrightError

    try:
        found = skywright.plan(skywright.load(mission, robot=robot))
    except InfeasibleError as error:
        return "no plan", str(error)
    except SkywrightError as error:
        return "refused", str(error)
    return ("plan", "") if found.feasible else ("no plan", str(found.blocked_by))


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
                out[stuck] = ("not decided", f"planning took longer than {LIMIT:.0f} s")
        except EOFError:
            stuck = next(mission for mission in left if mission not in out)
            out[stuck] = ("not decided", "the planning process ended")
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
        shown = {"plan": "**plan**", "refused": "refused"}.get(verdict, f"*{verdict}*")
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
        print(f"{name}: {sections[name].count('**plan**')} of {len(missions)} missions", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

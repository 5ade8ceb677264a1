"""Import of a robot, comparison of two robots, and the overhead of a comparison of laws."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from tempfile import mkdtemp

import skywright
from skywright.analysis.campaign.local import fly_local
from skywright.analysis.campaign.spec import build_campaign
from skywright.analysis.compare.compare import compare_robots
from skywright.analysis.compare_laws.compare import compare_laws
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave, read_clock
from skywright.evidence.bench.workers import iterate_tasks
from skywright.models.importing.importer import Request, import_robot

IMPORTED = "tilthex-arm"
PAIR = ("bimanual", "bimanual-longreach")
LAWS, MISSION, ROBOT = ["thrust_vectoring", "cascade"], "waypoints", "hexarotor"


def measure(session: Session) -> list[Row]:
    """Time an import and a comparison of robots, and compare laws with their flights alone."""
    rounds, runs = session.pick(1, 3, 10), session.pick(1, 2, 5)
    model = session.scratch / "robot.xml"
    model.write_text(skywright.build_mjcf(IMPORTED, "open"), encoding="utf-8")
    spent = interleave(
        {"import": partial(_import, model), "compare": _compare}, session.pick(1, 3, 10)
    )
    times = interleave(
        {
            "laws": partial(_compare_laws, session.scratch, runs),
            "flights": partial(_fly_alone, runs),
        },
        rounds,
    )
    flights = f"{runs} flights of {MISSION} with each of {len(LAWS)} laws, one worker"
    return [
        build_row(
            "import_s", spent["import"], "s",
            note=f"import of {IMPORTED} from MJCF, with the comparison with MuJoCo",
        ),
        build_row("compare_s", spent["compare"], "s", note=f"compare {' '.join(PAIR)} --no-fly"),
        build_row(
            "compare_laws_over_flights", compute_ratios(times["laws"], times["flights"]),
            note=f"compare laws over its flights alone: {flights}; includes the cost of a step",
        ),
    ]  # fmt: skip


def _import(model: Path) -> float:
    begin = read_clock()
    request = Request(model, None, None, None, None, (), (), IMPORTED, {}, True, True)
    import_robot(request, Path(mkdtemp(dir=model.parent)) / IMPORTED)
    return read_clock() - begin


def _compare() -> float:
    begin = read_clock()
    compare_robots(*PAIR, fly=False)
    return read_clock() - begin


def _compare_laws(folder: Path, runs: int) -> float:
    begin = time.perf_counter()
    compare_laws(
        LAWS, MISSION, robot=ROBOT, cases=["nominal"], runs=runs, out=Path(mkdtemp(dir=folder)),
        workers=1,
    )  # fmt: skip
    return time.perf_counter() - begin


def _fly_alone(runs: int) -> float:
    begin = time.perf_counter()
    sets = [f"mission.law={law}" for law in LAWS]
    tasks = [
        task
        for text in sets
        for task in iterate_tasks(build_campaign(MISSION, [], robot=ROBOT, sets=[text]), runs)
    ]
    list(fly_local(iter(tasks), 1))
    return time.perf_counter() - begin

"""POD, laws and robots on a Ray cluster: the same results as here, with a worker killed in each."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exact_map import EXACT
from skywright.analysis.campaign.campaign import run_campaign
from skywright.analysis.campaign.cluster import connect, disconnect
from skywright.analysis.campaign.jobs import Job, fly_jobs
from skywright.analysis.campaign.spec import build_campaign
from skywright.analysis.campaign.store import decode_row, encode_row
from skywright.analysis.compare.compare import compare_robots
from skywright.analysis.compare.flown import hover_once
from skywright.analysis.compare_laws.compare import compare_laws
from skywright.analysis.pod.flights import collect_inspections, write_table
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError, SimulationError
from skywright.models.rigid_body import posture
from skywright.run.rows import Row

KILLER = """
import os
import signal
from pathlib import Path

from skywright.core.record import Record
from skywright.vehicle.bus import Truth
from skywright.vehicle.component import Effect, Sensor

MARK = Path(__file__).with_suffix(".killed")


def die_once():
    if os.getpid() != PARENT and not MARK.exists():
        MARK.touch()
        os.kill(os.getpid(), signal.SIGKILL)


class KillerSensor(Sensor):
    class Me(Record):
        none: float

    def build(self, me, table, context):
        die_once()

    @staticmethod
    def step(me: Me, truth: Truth) -> None:
        me.none = 0.0


class Killer(Effect):
    class Me(Record):
        none: float

    def build(self, me, table, context):
        die_once()

    @staticmethod
    def step(me: Me, truth: Truth) -> None:
        me.none = 0.0
"""
HOP = """
[mission]
name = "hop"
kind = "waypoints"
robot = "hexarotor"
world = "open"
hover_height_m = 0.6
timestep_ms = 2

[[mission.task.points]]
x_m = 0.3
y_m = 0.0
z_m = 0.6
hold_s = 0.5

[mission.requirements]
"position.rms_m" = { limit = 0.16 }

[world.wind]
kind = "steady"
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """A Ray of this machine with two workers, to which this program is connected already."""
    assert connect("local", 2)
    yield "local"
    disconnect()


@pytest.fixture
def killer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """An effect that kills the first process which builds it, but never this one; also a sensor."""
    file = tmp_path / "killer.py"
    # a file of equal content is one module in a worker that lives on: its mark would be the old one
    file.write_text(KILLER.replace("PARENT", str(os.getpid())) + f"# {tmp_path}\n")
    (tmp_path / "hop.toml").write_text(HOP)
    monkeypatch.chdir(tmp_path)
    return f"world.effects.killer.kind={file}:Killer"


def strip(rows: list[Row]) -> list[Row]:
    """Rows without what depends on the machine's speed and luck; NaN equal to itself."""
    return [decode_row(encode_row(row._replace(timing={}, attempts=1))) for row in rows]


def test_a_pod_is_the_same_and_complete(cluster: str, killer: str) -> None:
    short = [*EXACT, "mission.task.passes=2", "mission.task.pass_length_m=0.08",
             "mission.timestep_ms=2", killer]  # fmt: skip
    plan = build_campaign("pipe-weld-scan", ["world.pipe.friction=choice(0.1,0.3)"], sets=short)
    there = run_campaign(plan, 2, out=Path("there"), ray=cluster)
    assert Path("killer.killed").exists()
    assert sorted(row.attempts for row in there.rows) in ([1, 2], [2, 2])
    here = run_campaign(plan, 2, out=Path("here"), workers=1)
    assert strip(there.rows) == strip(here.rows)
    tables = [write_table(collect_inspections(found.rows)) for found in (there, here)]
    assert tables[0] == tables[1] and tables[0].count("\n") >= 3


def test_laws_are_compared_alike_and_completely(cluster: str, killer: str) -> None:
    found = [
        compare_laws(
            ["cascade", "thrust_vectoring"], "hop.toml", runs=2, sets=[killer],
            vary=["world.wind.mean_mps=uniform(0,4)"], cases=["mine:plant.mass_error=0.02"],
            out=Path(name), seed=3, **where,
        )
        for name, where in (("there", {"ray": cluster}), ("here", {"workers": 1}))
    ]  # fmt: skip
    there, here = found
    assert Path("killer.killed").exists()
    assert {row.attempts for f in there.flown for row in f.rows} == {1, 2}
    assert [(f.law, f.case) for f in there.flown] == [(f.law, f.case) for f in here.flown]
    for a, b in zip(there.flown, here.flown, strict=True):
        assert strip(a.rows) == strip(b.rows) and len(a.rows) == 2


def test_flights_of_robots_are_the_same_and_complete(
    cluster: str, killer: str, tmp_path: Path
) -> None:
    """What `compare A B` flies, with a robot whose sensor is the killer: on a cluster and here."""
    file = tmp_path / "robot.toml"
    file.write_text(
        '[robot]\nname = "othex-killer"\nextends = "othex"\n'
        '[robot.sensors.killer]\nkind = "killer.py:KillerSensor"\n'
    )
    pose = posture(load_robot("othex")[0], "working")
    jobs = [Job(k, f"hover {k}", hover_once, (str(file), pose, 0.0, k)) for k in range(2)]
    told: list[str] = []
    there = fly_jobs(jobs, ray=cluster, step=told.append)
    assert Path("killer.killed").exists() and sorted(told) == ["hover 0", "hover 1"]
    here = fly_jobs(jobs)
    np.testing.assert_array_equal(there, here)
    assert np.all(np.array(here) < 0.05) and here[0] != here[1]  # m; another seed


def test_a_job_that_raises_raises_here_and_one_that_kills_is_told() -> None:
    with pytest.raises(InputError, match="no-such"):
        fly_jobs([Job(0, "load", load_robot, ("no-such",))], workers=1)
    with pytest.raises(SimulationError, match=r"die: crashed: the worker process died 3 times"):
        fly_jobs([Job(0, "die", os._exit, (7,))], workers=1)


@pytest.mark.parametrize(
    "more, says",
    [({"workers": 0}, "valid: 1 to"), ({"ray": "nowhere"}, "is not an address")],
)
def test_wrong_workers_are_told_before_anything_is_measured(
    more: dict[str, Any], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        compare_robots("bimanual", "bimanual-longreach", **more)

"""The plant's structure stands beside the map; everybody but the plant knows the map only."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.description.map_error import displace_world
from skywright.description.world.spec import World
from skywright.description.world.structure import build_surface
from skywright.errors import InputError
from skywright.evidence.reproduce.load import load_claims
from skywright.missions.skills.surveyed import is_surveyed
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup
from skywright.vehicle.assembly import NEAR, Assembly
from skywright.vehicle.bus import Truth
from skywright.vehicle.component import Context
from skywright.vehicle.effects.drag import Drag

SETS = {"plant.map_error_m": 0.03, "plant.map_error_deg": 3.0, "plant.map_error_size_m": 0.005}


def test_pipes_are_off_by_no_more_than_is_said() -> None:
    d = load_description("pipe-weld-scan", sets=SETS)
    here, off = d.world.pipe, []
    assert here is not None
    for seed in range(300):
        pipe = displace_world(d.world, d.plant, seed).pipe
        assert pipe is not None
        off.append([pipe.x_m - here.x_m, pipe.y_m - here.y_m, pipe.z_m - here.z_m,
                    pipe.yaw_deg - here.yaw_deg, pipe.inclination_deg - here.inclination_deg,
                    0.5 * (pipe.diameter_m - here.diameter_m)])  # fmt: skip
    most = np.array([0.03, 0.03, 0.03, 3.0, 3.0, 0.005])
    reached = np.max(np.abs(off), axis=0)
    assert np.all(reached <= most) and np.all(reached > 0.95 * most)
    assert np.all(np.abs(np.mean(off, axis=0)) < 4.0 * most / np.sqrt(3.0 * len(off)))
    spread = np.corrcoef(np.array(off).T) - np.eye(6)
    assert np.max(np.abs(spread)) < 0.25  # each is drawn for itself


@pytest.mark.parametrize("world", ["bridge", "tunnel", "pillar"])
def test_structures_are_off_by_no_more_than_is_said(world: str) -> None:
    d = load_description("bridge-contact", world=world)
    plant = d.plant.model_copy(update={k.split(".")[1]: v for k, v in SETS.items()})
    s = d.world.structure
    assert s is not None
    known, tilts = build_surface(s), []
    for seed in range(100):
        true = displace_world(d.world, plant, seed).structure
        assert true is not None
        surface = build_surface(true)
        assert np.all(np.abs(surface.p_WS - known.p_WS) <= 0.03)
        assert abs(surface.radius - known.radius) <= (0.005 if s.radius_m else 0.0)
        tilts.append(np.degrees(np.arccos(min(surface.R_WS[:, 2] @ known.R_WS[:, 2], 1.0))))
    assert max(tilts) <= 3.0 * np.sqrt(2.0) + 1e-6 and max(tilts) > 2.0


def test_seeds_draw_and_repeat() -> None:
    d = load_description("pipe-weld-scan", sets=SETS)
    assert displace_world(d.world, d.plant, 4) == displace_world(d.world, d.plant, 4)
    assert displace_world(d.world, d.plant, 4) != displace_world(d.world, d.plant, 5)
    exact = load_description("pipe-weld-scan", sets={key: 0.0 for key in SETS})
    assert exact.true_world == exact.world


def test_the_plant_has_the_truth_and_missions_the_map() -> None:
    d = load_description("pipe-weld-scan", sets=SETS)
    setup = Setup(d)
    vehicle = build_vehicle(d, setup=setup)
    assert vehicle.world == d.world and setup.cylinder is not None
    assert isinstance(vehicle.assembly, Assembly)
    true = setup.true.cylinder
    assert true is not None
    model = vehicle.scene.model
    i = int(np.flatnonzero([model.geom(g).name == "pipe" for g in range(model.ngeom)])[0])
    np.testing.assert_allclose(model.geom_pos[i], true.p_WP)
    assert model.geom_size[i][0] == pytest.approx(true.radius)
    assert np.max(np.abs(true.p_WP - setup.cylinder.p_WP)) > 1e-3


@pytest.mark.parametrize(
    ("mission", "key", "what"),
    [
        ("waypoints", "map_error_m", "no pipe and no structure"),
        ("bridge-contact", "map_error_size_m", "no curved surface"),
    ],
)
def test_an_error_of_nothing_is_refused(mission: str, key: str, what: str) -> None:
    d = load_description(mission, sets={f"plant.{key}": 0.01})
    with pytest.raises(
        InputError, match=rf"--set: plant.{key} = 0.01 has no effect: .* has {what}"
    ):
        plan_mission(d)


def test_a_run_from_before_flew_with_its_world_as_the_truth(tmp_path: Path) -> None:
    from skywright.description.dump import dump_description

    text = dump_description(load_description("pipe-weld-scan"))
    old = [line for line in text.splitlines() if "map_error_size_m" not in line]
    old = ["map_error_m = 0.02" if "map_error_m " in line else line for line in old]
    (tmp_path / "mission.toml").write_text("\n".join(old))
    d = load_description(tmp_path / "mission.toml")
    assert d.plant.map_error_m == 0.0 and d.true_world == d.world


LAW = """
from skywright.vehicle.bus import Estimate, WrenchCommand
from skywright.vehicle.component import Law, Out

GIVEN = []


class Curious(Law):
    compiled = False

    def build(self, me, table, context):
        GIVEN.append(context)

    def get_period(self, step, context):
        GIVEN.append(context)
        return 0.0

    @staticmethod
    def step(est: Estimate, cmd: Out[WrenchCommand]) -> None:
        cmd.f_B[2] = 1.0
"""


def test_a_law_is_built_from_the_map_and_sees_nothing_of_the_plant(tmp_path: Path) -> None:
    """Neither the true world nor a record or an object of the plant is in what it is given."""
    (tmp_path / "curious.py").write_text(LAW)
    kind = f"{tmp_path / 'curious.py'}:Curious"
    sets = {**SETS, "mission.law.kind": kind, "world.link.delay_s": 0.01}
    d = load_description("pipe-weld-scan", sets=sets)
    vehicle = build_vehicle(d)
    given = sys.modules[type(vehicle.law).__module__].GIVEN
    assert len(given) >= 2 and d.true_world.pipe != d.world.pipe
    for context in given:
        assert type(context) is Context and context.world == d.world
        assert context.nominal.world == d.world
        assert not any(
            isinstance(value, World) and value != d.world for value in vars(context).values()
        )
        assert all(c.side == "robot" for c in (*context.components, *context.named))
        records = {(record.__qualname__, name) for record, name in context.records}
        assert ("Truth", "") not in records and ("RotorState", "") not in records
        assert ("Estimate", "") in records and ("MocapSample", "") in records  # of the far end
        assert not any(name.endswith(NEAR) and record in ("MocapSample", "ImuBatch")
                       for record, name in records)  # fmt: skip
        assert not any(owner.startswith("MotionCapture") for owner, _ in records)
    plant = vehicle.find(Drag)
    assert plant.side == "plant" and (Truth, "") in vehicle.assembly.records


def test_a_law_cannot_say_that_it_is_part_of_the_plant(tmp_path: Path) -> None:
    text = LAW.replace("compiled = False", 'compiled = False\n    side = "plant"')
    (tmp_path / "curious.py").write_text(text)
    d = load_description(
        "waypoints", "othex", sets={"mission.law": f"{tmp_path / 'curious.py'}:Curious"}
    )
    with pytest.raises(InputError, match="'law' is a law with side = 'plant'"):
        build_vehicle(d)


def test_a_scan_surveys_where_its_map_may_be_wrong() -> None:
    exact = dict.fromkeys(SETS, 0.0)
    cases = [({}, True), (exact, False), ({"mission.task.survey": False}, False),
             ({**exact, "plant.map_error_size_m": 0.001}, True),
             ({**exact, "mission.task.survey": True}, True)]  # fmt: skip
    for sets, surveys in cases:
        assert is_surveyed(Setup(load_description("pipe-weld-scan", sets=sets))) is surveys
    blind = load_description("pipe-weld-scan", sets={"world.localisation": "gnss"})
    with pytest.raises(InputError, match=r"set mission\.task\.survey=false"):
        plan_mission(blind)


def test_the_papers_claims_are_flown_with_a_known_pipe() -> None:
    for case in load_claims("tognon-2018").cases.values():
        d = load_description(case.mission, case.robot or None, sets=case.sets)
        assert d.true_world == d.world and not is_surveyed(Setup(d))

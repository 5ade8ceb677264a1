"""Contacts that an operator or a pilot interrupts: which spot each hold belongs to afterwards."""

from __future__ import annotations

import numpy as np
import pytest

from constructed import LEVEL, about, build_flown, build_samples
from exact_map import EXACT
from skywright.description.loader import load_description
from skywright.description.world.structure import locate_point
from skywright.inspection.history.store import InspectionStore
from skywright.missions.bridge_contact.metrics import compute_metrics as judge_contact
from skywright.missions.bridge_contact.visits import is_left_out, list_visits
from skywright.missions.tool_install.metrics import compute_metrics as judge_tool
from skywright.run.flight import PhaseRecord
from skywright.run.orders import WAITING
from skywright.run.run import run_mission

CONTACT = ("free near", "free touch", "free hold 3 N", "free release", "free leave")
BACK = ("draw back", "rejoin")
SKIPPED = (*CONTACT[:3], "draw back", WAITING, "rejoin")


ENDED_BY = {"draw back": "drawn back", "manual": "taken over"}


def mark(phases: list[PhaseRecord]) -> list[PhaseRecord]:
    """Give the phases that an order or a pilot ends their outcomes, by the names of the next."""
    after = [p.name for p in phases[1:]] + [""]
    return [
        p._replace(outcome=ENDED_BY.get(name, p.outcome))
        for p, name in zip(phases, after, strict=True)
    ]


def build_phases(*names: str) -> list[PhaseRecord]:
    return mark([PhaseRecord(name, float(i), i + 1.0, "done") for i, name in enumerate(names)])


def name_visits(*names: str, docked: bool = False) -> list[list[str]]:
    return [[names[i] for i in v] for v in list_visits(build_phases(*names), docked)]


def test_a_visit_begins_with_its_approach_and_keeps_its_repeated_contacts():
    first = ("start", "take_off", "free approach", *CONTACT[:3], *BACK, *CONTACT)
    second = ("free approach", "manual", "rejoin", "free approach", *CONTACT, "return", "land")
    assert name_visits(*first, *second) == [list(first), list(second)]
    assert name_visits("free hold 3 N") == [["free hold 3 N"]]
    docked = ("approach", "align", "dock", "hold 3 N", "undock", "free approach", *CONTACT)
    assert name_visits(*docked, *docked, docked=True) == [list(docked), list(docked)]


def test_an_order_or_a_pilot_interrupts_a_hold_and_next_leaves_the_contact_out():
    phases = build_phases("free hold 3 N", "draw back", "free hold 3 N", "manual", "free hold 3 N")
    assert [p.is_interrupted for p in phases] == [True, False, True, False, False]
    assert is_left_out(build_phases("free approach", *SKIPPED))
    assert is_left_out(build_phases("free approach", *SKIPPED, "survey_move", "survey_touch"))
    assert not is_left_out(build_phases("free approach", *SKIPPED, *CONTACT))  # it was repeated
    assert not is_left_out(build_phases("free approach", *CONTACT[:3], *BACK))


@pytest.mark.parametrize(
    ("between", "second"),
    [
        ((*BACK, *CONTACT), True),
        (("manual", "rejoin", *CONTACT), True),
        (("draw back", WAITING, "rejoin"), False),
    ],
)
def test_a_press_that_is_repeated_or_left_out_does_not_shift_the_other_spots(between, second):
    """Holds of 1 s at x = 0 and x = 0.4 m; the platform moves on by as much."""
    spots = "mission.task.spots=[{x_m=0},{x_m=0.4}]"
    sets = ["plant.map_error_m=0", "plant.map_error_deg=0", spots]
    run0 = build_flown("wall-contact", *build_samples([("x", 1.0)]), sets=sets)
    deck = run0.setup.true.surface
    names = ["free approach", *CONTACT[:3], *between, "free approach", *CONTACT]
    at = [0.0] * (len(names) - 1 - len(CONTACT)) + [0.4] * (1 + len(CONTACT))
    if second:  # the platform does not stop exactly where it was
        at = [x if i < 4 else x + 0.004 for i, x in enumerate(at)]
    places = [locate_point(deck, np.array([x, 0.0]))[0] for x in at]
    samples, phases = build_samples(
        [(name, 1.0) for name in names], p_WT=places, p_WB=places, q_WT=about("y", 90.0),
        f_contact=np.zeros(3), ref_force=3.0, force_meas=3.0, q_WB=LEVEL, v_WB=np.zeros(3),
        f_docking_W=np.zeros(3),
    )  # fmt: skip
    phases = mark(phases)
    samples["force_meas"][samples["phase"] == 3] = 9.0  # in the hold that is interrupted
    way = {"stations": [type("S", (), {"place": np.zeros(2)})()], "survey": None}
    m = judge_contact(build_flown("wall-contact", samples, phases, way, sets=sets))
    assert m["press.place_error_mm"] == pytest.approx(4.0 if second else 0.0, abs=1e-6)
    assert m["free.wander_mm"] == pytest.approx(0.0, abs=1e-6)
    assert m["free.sensor_error_n"] == pytest.approx(3.0, abs=1e-6)


def test_a_grasp_that_an_order_repeats_is_no_missed_grasp():
    names = ["grasp", "look again", "grasp", "lift", "draw back", "rejoin", "grasp", "lift"]
    samples, phases = build_samples([(name, 1.0) for name in names])
    run = build_flown("tool-install", samples, phases)
    run.phases[0] = run.phases[0]._replace(outcome="retry")
    run.phases[:] = mark(run.phases)
    assert judge_tool(run)["tool.retries"] == 1.0


SPOTS = (
    *EXACT, "mission.task.survey=false", "mission.task.datum=false", "mission.task.tries=1",
    "mission.task.spots=[{name='a'},{name='b',x_m=0.2}]",
)  # fmt: skip


class Operator:
    """Gives an order in the first hold, and another one 0.5 s after the robot began to wait."""

    def __init__(self, *orders: str) -> None:
        self.orders, self.results, self.phase, self.since = list(orders), [], "", 0.0

    def on_plan(self, plan, description):
        pass

    def on_supervisor(self, supervisor):
        self.s = supervisor

    def on_tick(self, t, phase, vehicle):
        if phase != self.phase:
            self.phase, self.since = phase, t
        late = t > self.since + (0.2 if phase.startswith("free hold") else 0.5)
        where = WAITING if self.orders[:1] == ["next"] else "free hold"
        if self.orders and late and phase.startswith(where):
            self.results.append(self.s.order(self.orders.pop(0)))

    def close(self):
        pass


@pytest.mark.parametrize("orders", [("retry",), ("retract", "next")])
def test_readings_are_stored_under_the_spot_that_was_touched(tmp_path, orders):
    tries = () if orders == ("retry",) else ("mission.task.tries=3",)
    d = load_description("thickness-survey", sets=[*SPOTS, *tries])
    operator = Operator(*orders)
    out, file = tmp_path / "run", tmp_path / "r.db"
    result = run_mission(d, out=out, records=file, observers=[operator])
    assert [r.ok for r in operator.results] == [True] * len(orders)
    found = [(r["spot"], r["accepted"]) for r in result.found["readings"]]
    a = [r for r in result.found["readings"] if r["spot"] == "a"]
    b = [r for r in result.found["readings"] if r["spot"] == "b"]
    assert all(abs(r["u_m"]) < 0.02 for r in a) and all(abs(r["u_m"] - 0.2) < 0.02 for r in b)
    store = InspectionStore(file)
    stored = [(r.reading.spot, r.reading.accepted) for r in store.find_readings()]
    store.close()
    assert stored == found
    touches = [p.name for p in result.phases].count("free touch")
    if orders == ("retry",):
        assert result.outcome == "succeeded", result.reason
        assert found == [("a", True), ("b", True)] and touches == 3
    else:  # the spot is left out, although two more tries were allowed
        assert result.outcome == "aborted"
        assert result.reason == "left out by the operator's order: a"
        assert found[-1] == ("b", True) and not a and touches == 1 + len(b)

"""Operated flights in which something fails: the radio, the battery, the fence; by a computed hand.

The sensor is pressed onto the pipe by the careful operator behind a radio link; each flight is
judged by what the robot then did.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skywright
from cut_flights import Until
from skywright.description.world.radio import Radio
from skywright.ground.operator_model import ModelOperator
from skywright.ground.radio_operator import LET_GO_S, RadioOperator
from skywright.missions.skills import operated
from skywright.run.result import RunResult
from skywright.run.run import run_mission

SETS = (
    "mission.task.hover_s=0", "mission.task.swing_deg=0", "mission.task.survey=false",
    "mission.task.hold_s=4", "mission.timestep_ms=2", "mission.record_raw=false",
    "robot.control.speed_max_mps=1.5", "robot.control.acceleration_max_mps2=2",  # short ways
)  # fmt: skip
RADIO = Radio(delay_s=0.05)


class Outage(RadioOperator):
    """A radio that carries nothing in stretches of time, s after the work began."""

    def __init__(self, *stretches: tuple[float, float]) -> None:
        super().__init__(ModelOperator("careful", 1, 0.03), RADIO, 1)
        self.stretches = stretches
        self.axes: list[tuple[float, np.ndarray]] = []  # as the robot followed them
        lost = RADIO.model_copy(update={"loss_fraction": 1.0})
        self._radios = (RADIO, lost)

    def read(self, t: float, sight: Any) -> Any:
        out = any(start <= t < end for start, end in self.stretches)
        self._up.radio = self._down.radio = self._radios[out]
        stick = super().read(t, sight)
        if stick is not None:
            self.axes.append((t, np.array(stick.axes)))
        return stick


class Watch:
    """Keeps what rules did."""

    def __init__(self) -> None:
        self.acted: list[str] = []

    def on_plan(self, plan: Any, description: Any) -> None:
        pass

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        pass

    def on_acted(self, acted: Any) -> None:
        self.acted.append(acted.rule)

    def close(self) -> None:
        pass


def fly(folder: Path, operator: Any, *sets: str) -> tuple[RunResult, list[str]]:
    watch = Watch()
    result = run_mission(
        skywright.load("sensor-install", sets=(*SETS, *sets)), out=folder / "run",
        operator=operator, observers=[watch],
    )  # fmt: skip
    return result, watch.acted


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The work without a fault, up to the force: tells when what begins."""
    operator = RadioOperator(ModelOperator("careful", 1, 0.03), RADIO, 1)
    return run_mission(
        skywright.load("sensor-install", sets=SETS), out=tmp_path_factory.mktemp("plain") / "run",
        operator=operator, observers=[Until("force")],
    )  # fmt: skip


def find_phase(result: RunResult, name: str) -> Any:
    return next(p for p in result.phases if p.name == name)


def assert_home(result: RunResult) -> None:
    """It stands where it took off, and met nothing that broke it."""
    p = result.samples["p_WB"]
    assert p[-1, 2] < 0.5 + p[0, 2] and np.linalg.norm(p[-1, :2] - p[0, :2]) < 0.3
    assert np.all(np.isfinite(p))


def test_a_link_that_is_lost_for_a_moment_lets_the_stick_go_and_the_work_goes_on(
    tmp_path: Path,
) -> None:
    operator = Outage((2.0, 2.2), (4.0, 6.0))
    result, acted = fly(tmp_path, operator)
    assert result.outcome == "succeeded", (result.reason, acted)
    inside = [axes for t, axes in operator.axes if 4.0 + LET_GO_S + 0.1 < t < 6.0]
    assert inside
    assert all(np.all(axes == 0.0) for axes in inside)  # it is not moved by what was said before
    for start in (2.0, 4.0):
        still = [axes for t, axes in operator.axes if start - 0.1 < t < start + LET_GO_S]
        assert still and not all(np.all(axes == 0.0) for axes in still)  # nothing is felt yet
    assert_home(result)


def test_a_link_that_is_lost_for_good_ends_the_work_and_the_robot_comes_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operated, "LONGEST_S", 8.0)
    operator = Outage((4.0, math.inf))
    result, _ = fly(tmp_path, operator)
    assert result.outcome != "succeeded"
    assert "the operator took more than 8 s" in result.reason
    late = [axes for t, axes in operator.axes if t > 4.5]
    assert late and all(np.all(axes == 0.0) for axes in late)
    names = [p.name for p in result.phases]
    assert "retract" in names and names[-1] == "land"
    assert_home(result)


def test_a_battery_that_runs_low_in_contact_brings_it_home(
    tmp_path: Path, plain: RunResult
) -> None:
    """The cell fails where it is pressed."""
    at = find_phase(plain, "force").start_s + 0.5
    result, acted = fly(
        tmp_path / "b", RadioOperator(ModelOperator("careful", 1, 0.03), RADIO, 1),
        'plant.faults.cell.kind="battery"', f"plant.faults.cell.start_s={at}",
        "mission.timestep_ms=1",  # forces are judged
    )  # fmt: skip
    assert acted[0] == "battery_low" and result.outcome == "aborted"
    assert "in force" in result.reason
    names = [p.name for p in result.phases]
    assert names[names.index("force") + 1] == "retract" and "come home" in names
    t, force = result.samples["t"], np.linalg.norm(result.samples["left_f_W"], axis=1)
    back, home = find_phase(result, "retract"), find_phase(result, "come home")
    assert np.max(force[(t > back.start_s) & (t < back.end_s)]) < 3.0  # it presses no harder
    assert np.max(force[(t > home.start_s) & (t < home.end_s)]) < 0.1  # and lets go of the pipe
    assert_home(result)


def test_a_fence_that_is_left_by_the_operators_work_brings_it_home(
    tmp_path: Path, plain: RunResult
) -> None:
    """The fence ends 0.1 m beside the place of work: a push carries the robot over it."""
    work = find_phase(plain, "touch")
    s = plain.samples
    y = s["p_WB"][(s["t"] > work.start_s) & (s["t"] < work.end_s), 1]
    result, acted = fly(
        tmp_path / "b", RadioOperator(ModelOperator("careful", 1, 0.03), RADIO, 1),
        f"mission.fence.y_min_m={float(np.min(y)) - 0.1!r}",
        'plant.faults.gust.kind="bump"', f"plant.faults.gust.start_s={work.start_s + 1.0}",
        "plant.faults.gust.force_y_n=-25.0", "plant.faults.gust.for_s=0.8",
        "mission.faults.unintended_contact.on=false",
    )  # fmt: skip
    assert acted[0] == "geofence" and result.outcome == "aborted", (acted, result.reason)
    assert "come home" in [p.name for p in result.phases]
    assert_home(result)


class Leaver(Watch):
    """An observer that is the operator, too: nobody is there from `for_s` after `phase` began."""

    def __init__(self, phase: str, for_s: float = 0.4) -> None:
        super().__init__()
        self.model = ModelOperator("careful", 1, 0.03)
        self.phase, self.for_s, self.since = phase, for_s, math.inf

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        if phase == self.phase:
            self.since = min(self.since, t)
        self.gone = t >= self.since + self.for_s

    def read(self, t: float, sight: Any) -> Any:
        return None if self.gone else self.model.read(t, sight)


@pytest.mark.parametrize("phase", ["touch", "press", "force"])
def test_an_operator_who_falls_silent_in_any_phase_ends_the_work_and_it_comes_home(
    tmp_path: Path, phase: str
) -> None:
    leaver = Leaver(phase)
    result = run_mission(
        skywright.load("sensor-install", sets=SETS), out=tmp_path / "run", operator=leaver,
        observers=[leaver],
    )  # fmt: skip
    assert result.outcome == "aborted", result.reason
    assert "the operator's input ended before the sensor was pressed on" in result.reason
    assert next(p for p in result.phases if p.outcome == "failed").name == phase
    names = [p.name for p in result.phases]
    assert phase in names and names[-1] == "land" and not leaver.acted
    t, force = result.samples["t"], np.linalg.norm(result.samples["left_f_W"], axis=1)
    after = t > leaver.since + leaver.for_s + 5.0
    assert np.max(force[after]) < 0.3  # it let go of the pipe
    assert_home(result)


def test_a_bar_whose_operator_falls_silent_is_carried_back(tmp_path: Path) -> None:
    """In the air: what hangs on the hooks goes back into the rack."""
    leaver = Leaver("lower")
    result = run_mission(
        skywright.load("bar-insertion", sets=("mission.timestep_ms=2",)), out=tmp_path / "run",
        operator=leaver, observers=[leaver],
    )  # fmt: skip
    assert result.outcome == "aborted" and "the bar is back in the rack" in result.reason
    assert_home(result)


def test_the_pilots_switch_wins_over_an_operator_in_contact(tmp_path: Path) -> None:
    """The hand's stick is not followed while the pilot flies; given back, the robot comes home."""

    class Pilot(Watch):
        supervisor: Any = None
        began = over = math.inf
        said: tuple[Any, ...] = ()

        def on_supervisor(self, supervisor: Any) -> None:
            self.supervisor = supervisor

        def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
            s = self.supervisor
            if phase == "force":
                self.began = min(self.began, t)
            if t >= self.began + 0.5 and math.isinf(self.over):
                self.over, self.said = t, (s.choose_mode("position"), s.take_over())
            elif t > self.over + 2.0 and s.pilot.flies and s.pilot.switch:
                self.said = (*self.said, s.give_back())
            elif s.pilot.flies:
                s.move_stick([0.0, 0.0, 0.0, -0.5])  # down, away from the pipe

    pilot = Pilot()
    result = run_mission(
        skywright.load("sensor-install", sets=SETS), out=tmp_path / "run",
        operator=ModelOperator("careful", 1, 0.03), observers=[pilot],
    )  # fmt: skip
    assert all(pilot.said) and len(pilot.said) == 3, pilot.said
    manual = find_phase(result, "manual")
    assert manual.start_s - pilot.over < 0.05  # at once
    s = result.samples
    during = (s["t"] > manual.start_s + 0.1) & (s["t"] < manual.end_s)
    assert s["v_WB"][during, 2].min() < -0.1 and "operator_stick" in s.dtype.names
    still = s["operator_stick"][during]
    assert np.all(still == still[0])  # the hand is led by nobody
    assert result.outcome != "succeeded" and "the pilot took over in force" in result.reason
    assert_home(result)

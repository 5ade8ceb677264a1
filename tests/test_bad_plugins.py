"""What is wrong with a user's part is told in one line, by the command line, before a flight.

Further cases: names that exist twice and packages (test_packages.py), files that end Python
(test_user_files.py), a law that never returns (test_parts.py).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import CliRunner

from command_server import CommandServer
from skywright import cli
from skywright.run.directory import load_run

IMPORTS = """
from typing import NamedTuple

from skywright.core.record import Record
from skywright.core.spec import Positive, Spec
from skywright.description.mission.spec import Task
from skywright.description.world.thing import Part, Placed, Solid
from skywright.run.kind import Figures, MissionKind
from skywright.vehicle.bus import Clock, Estimate, MuJoCo, Truth, WrenchCommand
from skywright.vehicle.component import Effect, Estimator, Law, Out, Output, Sensor
from skywright.vehicle.estimates import EstimatorState


class Nobody(Output):
    x: float


class Said(Output):
    x: float

"""
HEAD = "[mission]\nname = 'm'\nkind = 'waypoints'\nrobot = 'othex'\nworld = 'open'\n"
KEYS = {
    "law": "mission.law", "sensor": "robot.sensors.mine", "estimator": "mission.estimator",
    "effect": "world.effects.mine", "thing": "world.things.mine", "kind": "mission.kind",
}  # fmt: skip
"""Where a description names a part of each group."""
TABLES = {**KEYS, "kind": "mission.task"}
WHAT = {"law": "control law", "kind": "mission kind"}
FILLS = {"law": "WrenchCommand", "estimator": "Estimate", "sensor": "Said", "effect": "Said"}
COMPONENTS = list(FILLS)
CLASSES = {
    **{g: f"class Mine({g.capitalize()}):\n" for g in COMPONENTS},
    "thing": "class Mine(Placed):\n",
    "kind": "class Mine(MissionKind):\n",
}
KIND = """
class MineTask(Task):
    gain: Positive = 1.0


class Mine(MissionKind):
    task = MineTask
    needs = frozenset({"uav"})
    measures = {}

    def plan(self, setup):
        from skywright.run.planning import MissionPlan

        return MissionPlan(True, None, 0.0, 1.0, way=None)

    def fly(self, s, way):
        from skywright.run.flight import Flight

        return Flight(True, "")

    def metrics(self, run):
        return {}

    def figures(self):
        return Figures(lambda result: "flew", {})
"""
THING = """class Mine(Placed):
    gain: Positive = 1.0

    def list_parts(self):
        return [Part([Solid("sphere", [0.05])])]
"""


def write_class(group: str, ports: str, *lines: str, more: str = "") -> str:
    """Write a component with a key `gain` and a step with these ports and lines."""
    fills = FILLS[group]
    body = "".join(f"        {line}\n" for line in lines or ("pass",))
    return (
        f"{IMPORTS}{CLASSES[group]}{more}    class Table(Spec):\n        gain: Positive = 1.0\n\n"
        f"    @staticmethod\n    def step({ports}out: Out[{fills}]) -> None:\n{body}"
    )


def write_good(group: str) -> str:
    """Write a part that could fly."""
    if group in FILLS:
        return write_class(group, "clock: Clock, ", "clock.t")
    return IMPORTS + (KIND if group == "kind" else THING)


class Case(NamedTuple):
    """A part that is wrong: its groups, its file, what else is set, and what is told."""

    groups: list[str]
    write: Callable[[str], str]
    words: Callable[[str], list[str]]
    sets: Callable[[str], list[str]] = lambda group: []


def say(*words: str) -> Callable[[str], list[str]]:
    return lambda group: [w.format(key=KEYS[group], group=group, what=WHAT.get(group, group),
                                   table=TABLES[group]) for w in words]  # fmt: skip


def other(group: str) -> str:
    return "effect" if group == "sensor" else "sensor"


ROBOTS = ["law", "estimator"]
ALL = [*COMPONENTS, "thing", "kind"]
BARE = {g: f"{IMPORTS}{text}    pass\n" for g, text in CLASSES.items()}
CASES = {
    "no step": Case(
        COMPONENTS, BARE.__getitem__, say("Mine", "has no static method 'step'", "mine.py")
    ),
    "no methods": Case(
        ["kind"], BARE.__getitem__,
        say("mission.kind", "mine.py", "does not define its task class"),
    ),
    "a port nobody fills": Case(
        COMPONENTS, lambda g: write_class(g, "x: Nobody, "),
        say("reads Nobody, which no component of this vehicle fills; available:", "BodyModel"),
    ),
    "the truth": Case(
        ROBOTS, lambda g: write_class(g, "truth: Truth, "), say("{group}", "cannot read Truth"),
    ),
    "the plant's own arrays": Case(
        ROBOTS, lambda g: write_class(g, "mj: MuJoCo, "), say("{group}", "cannot read MuJoCo"),
    ),
    "the plant's side": Case(
        ROBOTS, lambda g: write_class(g, "truth: Truth, ", more='    side = "plant"\n\n'),
        say("'{group}' is a", "{group} with side = 'plant'"),
    ),
    "no annotation": Case(
        COMPONENTS, lambda g: write_class(g, "x, "), say("parameter 'x' has no annotation"),
    ),
    "an annotation that is no record": Case(
        COMPONENTS, lambda g: write_class(g, "x: int, "), say("'x'", "int"),
    ),
    "a step with self": Case(
        COMPONENTS, lambda g: write_class(g, "self, ").replace("    @staticmethod\n", ""),
        say("Mine", "has no static method 'step'"),
    ),
    "no compiled code": Case(
        COMPONENTS, lambda g: write_class(g, "clock: Clock, ", "nowhere(clock.t)"),
        say("does not compile", "nowhere", "mine.py:"),
    ),
    "a field that is none": Case(
        COMPONENTS, lambda g: write_class(g, "clock: Clock, ", "out.nonsense = clock.t"),
        say("does not compile", "nonsense", "mine.py:"),
    ),
    "an unknown key": Case(
        ALL, write_good, say("{table}.gian", "gain"), lambda g: [f"{TABLES[g]}.gian=2"],
    ),
    "a value out of range": Case(
        ALL, write_good, say("{table}.gain", "-2"), lambda g: [f"{TABLES[g]}.gain=-2"],
    ),
    "a build that raises": Case(
        COMPONENTS,
        lambda g: write_class(
            g, "clock: Clock, ", "clock.t",
            more="    def build(self, me, table, context):\n        1 / 0\n\n",
        ),
        say("ZeroDivisionError", "of mine.py", "Mine"),
    ),
    "parts that raise": Case(
        ["thing"], lambda g: IMPORTS + THING.replace("[0.05]", "[1 / 0]"),
        say("things.mine", "ZeroDivisionError", "of mine.py"),
    ),
    "a plan that raises": Case(
        ["kind"], lambda g: IMPORTS + KIND.replace("return MissionPlan", "1 / 0\n        return X"),
        say("ZeroDivisionError", "of mine.py"),
    ),
    "an exception": Case(
        ALL, lambda g: "x = 1\n1 / 0\n",
        say("{key}", "mine.py failed", "ZeroDivisionError", "line 2 of mine.py"),
    ),
    "a syntax error": Case(
        ALL, lambda g: "x = 1 +\n", say("{key}", "SyntaxError", "line 1 of mine.py"),
    ),
    "a SystemExit": Case(
        ALL, lambda g: "raise SystemExit(7)\n", say("{key}", "SystemExit: 7", "line 1 of mine.py"),
    ),
    "an import that is missing": Case(
        ALL, lambda g: "import nowhere_at_all\n", say("{key}", "nowhere_at_all", "mine.py"),
    ),
    "no class": Case(
        ALL, lambda g: "x = 1\n", say("{key}", "mine.py has no class 'Mine'", "{what}s: none"),
    ),
    "another group": Case(
        ALL, lambda g: write_good(other(g)),
        lambda g: [f"a {WHAT.get(g, g)} is needed", "Mine", f"is a {other(g)}"],
    ),
}  # fmt: skip


def run(tmp_path: Path, *sets: str, group: str = "law") -> tuple[int, str]:
    """Run a mission with the part in mine.py; return exit code and what was told."""
    mission = tmp_path / "mission.toml"
    points = "" if group == "kind" else "[[mission.task.points]]\nx_m=0\ny_m=0\nz_m=1.2\n"
    mission.write_text(HEAD + points)
    args = ["run", str(mission), "--out", str(tmp_path / "out")]
    key = KEYS[group] if group == "kind" else f"{KEYS[group]}.kind"
    place = [f"world.things.mine.{a}_m=3" for a in "xyz"] if group == "thing" else []
    for one in (f"{key}={tmp_path / 'mine.py'}:Mine", *place, *sets):
        args += ["--set", one]
    result = CliRunner().invoke(cli.main, args)
    assert "Traceback" not in result.output and "internal error" not in result.output, result.output
    return result.exit_code, " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("name", "group"), [(name, group) for name, case in CASES.items() for group in case.groups]
)
def test_a_part_that_is_wrong_is_refused(tmp_path: Path, name: str, group: str) -> None:
    case = CASES[name]
    (tmp_path / "mine.py").write_text(case.write(group))
    code, told = run(tmp_path, *case.sets(group), group=group)
    assert code == 2, told
    assert told.count("skywright:") == 1, told
    missing = [word for word in case.words(group) if word not in told]
    assert not missing, (missing, told)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith("out")] == []


def test_two_components_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(write_good("sensor"))
    for key in ("robot.sensors.truth.kind", "robot.sensors.law.kind", "world.effects.drag.kind"):
        group = "effect" if "effects" in key else "sensor"
        (tmp_path / "mine.py").write_text(write_good(group))
        args = ["--set", f"{key}={tmp_path / 'mine.py'}:Mine", "--out", str(tmp_path / "out")]
        result = CliRunner().invoke(cli.main, ["run", "waypoints", "--robot", "othex", *args])
        name = key.split(".")[2]
        assert result.exit_code == 2, result.output
        assert f"two components are named '{name}'" in " ".join(result.stderr.split())
        assert not (tmp_path / "out.partial").exists()


def test_a_file_with_one_part_twice_is_refused(tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    for place in ("robot.sensors.a", "world.effects.a", "world.things.a"):
        mission.write_text(HEAD + 2 * f"[{place}]\nkind = 'airspeed'\n")
        result = CliRunner().invoke(cli.main, ["run", str(mission)])
        assert result.exit_code == 2 and "mission.toml" in result.stderr, result.output
        assert "line 8" in result.stderr and "Traceback" not in result.output


LATE = ("if clock.t > 0.1:", "    raise ValueError('too late')")


@pytest.mark.parametrize("mode", ["fast", "interactive"])
@pytest.mark.parametrize("group", COMPONENTS)
def test_a_step_that_raises_ends_the_run_and_leaves_its_recording(
    tmp_path: Path, group: str, mode: str
) -> None:
    (tmp_path / "mine.py").write_text(write_class(group, "clock: Clock, ", *LATE))
    code, told = run(tmp_path, f"mission.mode={mode}", group=group)
    assert code == 3, told
    stored = load_run(tmp_path / "out.partial")
    assert stored.outcome == "diverged"
    name = group if group in ("law", "estimator") else "mine"
    for word in (name, "Mine.step", "too late", "mine.py"):
        assert word in stored.reason, (word, stored.reason)
    assert not (tmp_path / "out").exists() and 5 < len(stored.samples) < 20


@pytest.mark.parametrize("group", ["law", "sensor", "estimator"])
def test_an_index_beyond_an_array_ends_the_run_and_the_reason_has_its_line(
    tmp_path: Path, group: str
) -> None:
    """In compiled code too, which would otherwise read or write what lies behind the array."""
    port = "clock: Clock, est: Estimate, "
    lines = ("k = 0", "while k < 10.0 + clock.t:", "    k += 1", "out.x = est.p_WB[k]")
    if group == "law":
        lines = (*lines[:3], "out.f_B[k] = 1.0")
    if group == "estimator":
        port, lines = "clock: Clock, ", (*lines[:3], "out.p_WB[k] = 1.0")
    text = write_class(group, port, *lines)
    (tmp_path / "mine.py").write_text(text)
    code, told = run(tmp_path, group=group)
    assert code == 3, told
    reason = load_run(tmp_path / "out.partial").reason
    line = next(i for i, one in enumerate(text.splitlines(), 1) if "[k]" in one)
    assert "IndexError" in reason and f"mine.py:{line})" in reason, reason


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("group", ["sensor", "estimator", "effect"])  # a law: test_parts.py
def test_a_step_that_never_returns_ends_the_run_and_leaves_its_recording(
    tmp_path: Path, commands: CommandServer, group: str, compiled: bool
) -> None:
    loop = ("n = 0", "while clock.t > 0.1 and n >= 0:", "    n = (n + 1) % 1000")
    if not compiled and group != "sensor":  # it waits, so that the processor is free
        loop = ("import time", *loop, "    time.sleep(0.01)")
    more = f"    compiled = {compiled}\n\n"
    (tmp_path / "mine.py").write_text(write_class(group, "clock: Clock, ", *loop, more=more))
    mode = "fast" if compiled else "interactive"
    out = tmp_path / "out"
    words = [
        "run", "waypoints", "--robot", "othex",
        "--set", f"{KEYS[group]}.kind={tmp_path / 'mine.py'}:Mine", "--out", str(out),
        "--set", "mission.step_limit_s=1", "--set", f"mission.mode={mode}",
    ]  # fmt: skip
    done = commands.run(words, tmp_path)
    told = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 3, told
    name = group if group == "estimator" else "mine"
    says = f"component {name} (Mine.step in mine.py) did not return within 1 s at t = 0.1"
    assert says in told and "Traceback" not in told, told
    stored = load_run(tmp_path / "out.partial")
    assert stored.outcome == "diverged" and says in stored.reason and len(stored.samples) > 5


def test_a_kind_that_raises_in_flight_ends_the_run_and_leaves_its_recording(tmp_path: Path) -> None:
    text = IMPORTS + KIND.replace("        return Flight(", "        1 / 0\n        return Flight(")
    (tmp_path / "mine.py").write_text(text)
    code, told = run(tmp_path, group="kind")
    assert code == 3, told
    stored = load_run(tmp_path / "out.partial")
    for word in ("ZeroDivisionError", "of mine.py"):
        assert word in stored.reason, (word, stored.reason)
    assert len(stored.samples) > 10 and not (tmp_path / "out").exists()

"""Files of a campaign that change: while it runs, between two calls, and at its start."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skywright.analysis.campaign import campaign as campaign_module
from skywright.analysis.campaign.campaign import run_campaign
from skywright.analysis.campaign.spec import (
    Campaign,
    _hash_laws,
    _list_task_files,
    build_campaign,
    build_identity,
)
from skywright.analysis.campaign.store import IDENTITY, Store
from skywright.description.loader import find_mission
from skywright.errors import InputError
from skywright.missions.skills.operated import OperatedTask
from skywright.planning.motion.plan_file import name_files
from skywright.run.rows import Row
from test_campaign import MISSION

VARY = ("plant.mass_error=uniform(0,0.1)",)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hop.toml").write_text(MISSION)
    monkeypatch.chdir(tmp_path)


def build(seed: int = 3) -> Campaign:
    return build_campaign("hop.toml", VARY, seed=seed)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (MISSION.replace("hold_s = 0.5", "hold_s = 0.6"), r"\(their content differs\)"),
        (MISSION[:60], r"\(.*hop\.toml"),
    ],
)
def test_a_file_that_changes_during_the_campaign_ends_it(
    text: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Later runs would be those of another mission, under the identity of the first."""

    def fly(tasks: Iterator[Any], *args: Any, **more: Any) -> Iterator[Row]:
        for k, task in enumerate(tasks):
            if k == 1:
                Path("hop.toml").write_text(text)
            yield Row(
                task.draw.run, task.draw.seed, "succeeded", "", (), "", {}, {}, {}, 1, task.command
            )

    monkeypatch.setattr(campaign_module, "fly_local", fly)
    with pytest.raises(InputError, match=f"have changed while it runs {says}.*are kept"):
        run_campaign(build(), 5, out=Path("c"), workers=1)
    assert Path("c/runs.jsonl").read_bytes().count(b"\n") == 2


@pytest.mark.parametrize("name", ["way", "way.csv", "way.toml", "way.v2"])
@pytest.mark.parametrize("mission", ["bar-transport", "follow-plan"])
@pytest.mark.parametrize("varied", [False, True])
def test_both_files_of_a_plan_are_part_of_the_identity(
    name: str, mission: str, varied: bool
) -> None:
    files = name_files(name)
    for file in files:
        file.write_text("1\n")
    vary = (f'mission.task.plan_file=choice("{name}")',) if varied else VARY
    sets = () if varied else (f"mission.task.plan_file={name}",)
    campaign = build_campaign(mission, vary, sets=sets)
    found = [build_identity(campaign)["law"]]
    assert build_identity(campaign)["law"] == found[0]
    for file in files:
        file.write_text("2\n")
        found.append(build_identity(campaign)["law"])
    assert len(set(found)) == 3


def test_a_recorded_operator_is_part_of_the_identity() -> None:
    class Operated(OperatedTask):
        pass

    campaign = build_campaign("hop.toml", VARY)
    path = Path("stick.csv")
    path.write_text("1\n")
    mission = campaign.base.mission.model_copy(update={"task": Operated(operator=str(path))})
    campaign = campaign._replace(base=campaign.base._replace(mission=mission))
    before = _hash_laws(campaign)
    path.write_text("2\n")
    assert _hash_laws(campaign) not in (before, None)


CAREFUL = ('mission.task.operator=choice("careful")',)


def test_a_varied_operator_of_the_package_is_part_of_the_identity() -> None:
    campaign = build_campaign("tool-install", ('mission.task.operator=choice("careful","hasty")',))
    files = _list_task_files(campaign, Path())
    assert [path.name for path in files] == ["careful.csv", "hasty.csv"]
    assert all(path.is_file() for path in files)


def test_varied_files_of_a_mission_in_a_folder_are_part_of_the_identity() -> None:
    folder = Path("mine")
    folder.mkdir()
    (folder / "mission.toml").write_text(find_mission("tool-install").path.read_text())
    careful = _list_task_files(build_campaign("tool-install", CAREFUL), Path())[0]
    (folder / "mine.csv").write_bytes(careful.read_bytes())
    campaign = build_campaign("mine", ('mission.task.operator=choice("mine.csv")',))
    before = build_identity(campaign)["law"]
    (folder / "mine.csv").write_bytes(careful.read_bytes() + b"\n")
    assert build_identity(campaign)["law"] not in (before, None)


def test_a_campaign_that_another_one_overtook_at_its_start_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both have seen an empty folder; the second one has written its identity last."""
    mine, other = build_identity(build()), build_identity(build(4))
    Store(Path("o"), other).close()
    theirs = (Path("o") / IDENTITY).read_bytes()
    write = Store.write

    def overtake(self: Store, name: str, function: Any) -> Path:
        path = write(self, name, function)
        path.write_bytes(theirs)
        return path

    with monkeypatch.context() as patch:
        patch.setattr(Store, "write", overtake)
        with pytest.raises(InputError, match="its seed is 4, not 3"):
            Store(Path("c"), mine)
    Store(Path("c"), other).close()  # the lock is free

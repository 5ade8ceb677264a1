"""Installed packages offer laws, sensors, estimators, effects, things and kinds by name."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from skywright import cli
from skywright.core.find import list_offers
from skywright.recordings.recording import read_recording
from user_parts import FILES, MISSION

POINTS = """[skywright.components]
law.springs = my_parts.springs:Springs
sensor.heights = my_parts.heights:Height
effect.tug = my_parts.tug:Tug
[skywright.things]
post = my_parts.post:Post
[skywright.missions]
my-hop = my_parts.hop:Hop
"""


def install(site: Path, name: str, points: str, files: dict[str, str]) -> None:
    """Write a package with the metadata that an installation leaves."""
    for file, text in files.items():
        path = site / name.replace("-", "_") / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(re.sub(r"(?m)^( *)import gains", r"\1from . import gains", text).replace(
            "from gains", "from .gains"))  # fmt: skip
    info = site / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    site = tmp_path / "site"
    install(site, "my-parts", POINTS, {"__init__.py": "", **FILES})
    monkeypatch.syspath_prepend(str(site))
    list_offers.cache_clear()
    yield site
    list_offers.cache_clear()
    for name in [n for n in sys.modules if n.partition(".")[0] in ("my_parts", "other")]:
        del sys.modules[name]


def call(*arguments: str) -> Result:
    """Run the command line in this process."""
    return CliRunner().invoke(cli.main, list(arguments))


def test_parts_of_a_package_are_listed_with_where_they_come_from(site: Path) -> None:
    for word, name, value in (
        ("laws", "springs", "my_parts.springs:Springs"),
        ("sensors", "heights", "my_parts.heights:Height"),
        ("effects", "tug", "my_parts.tug:Tug"),
        ("things", "post", "my_parts.post:Post"),
        ("kinds", "my-hop", "my_parts.hop:Hop"),
    ):
        found = json.loads(call("list", word, "--json").stdout)[word]
        places = {entry["name"]: entry["description"] for entry in found}
        assert places[name] == f"my-parts ({value})" and len(set(places.values())) > 3


def test_parts_of_a_package_fly_by_their_names(site: Path, tmp_path: Path) -> None:
    text = re.sub(r"\w+\.py:\w+", "NAME", MISSION.format(estimator="filter"))
    for name in ("my-hop", "springs", "heights", "tug", "post"):  # in the order of the file
        text = text.replace("NAME", name, 1)
    mission = tmp_path / "mission.toml"
    mission.write_text(text)
    sets = ["--set", "world.effects.tug.force_n=0.7", "--set", "world.things.post.height_m=0.18",
            "--set", "robot.sensors.height.noise_m=0.002"]  # fmt: skip
    done = call("run", str(mission), *sets, "--out", str(tmp_path / "run"))
    assert done.exit_code == 0, done.output
    samples = read_recording(tmp_path / "run" / "recording.mcap").samples
    assert samples["f_tug"].max() == 0.7
    error = samples["height_meas"] - samples["p_WB"][:, 2]
    assert 0.001 < error.std() < 0.005
    refused = call("run", str(mission), "--set", "world.effects.tug.force_nn=1")
    assert refused.exit_code == 2 and "force_n" in refused.stderr


@pytest.mark.parametrize(
    ("points", "key", "places"),
    [
        ("[skywright.components]\nlaw.springs = other:X\n", "mission.law=springs",
         ("control law 'springs'", "my-parts (my_parts.springs:Springs)", "other (other:X)")),
        ("[skywright.components]\nlaw.cascade = other:X\n", "mission.law=cascade",
         ("control law 'cascade'", "built in", "other (other:X)")),
        ("[skywright.components]\nsensor.heights = other:X\n", "robot.sensors.h.kind=heights",
         ("sensor 'heights'", "my-parts (my_parts.heights:Height)", "other (other:X)")),
        ("[skywright.things]\nbox = other:X\n", "world.things.b.kind=box",
         ("thing 'box'", "built in", "other (other:X)")),
        ("[skywright.missions]\nscan = other:X\n", "mission.kind=scan",
         ("mission kind 'scan'", "built in", "other (other:X)")),
    ],
)  # fmt: skip
def test_a_name_that_exists_twice_is_refused_with_both_places(
    site: Path, points: str, key: str, places: tuple[str, ...]
) -> None:
    install(site, "other", points, {"__init__.py": "class X: ...\n"})
    done = call("run", "waypoints", "--set", key, "--out", str(site / "run"))
    told = " ".join(done.stderr.split())
    assert done.exit_code == 2 and "is defined twice" in told, told
    assert all(place in told for place in places), told
    assert "Traceback" not in told and not list(site.glob("run*"))


def test_a_package_that_does_not_import_is_told(site: Path) -> None:
    install(site, "other", "[skywright.components]\nlaw.sick = other:X\n",
            {"__init__.py": "x = 1\nraise SystemExit(4)\n"})  # fmt: skip
    done = call("run", "waypoints", "--set", "mission.law=sick")
    told = " ".join(done.stderr.split())
    assert done.exit_code == 2, told
    assert "importing other (other:X) failed: SystemExit: 4 (line 2 of __init__.py)" in told

"""What a campaign is: mission, layers, seed and variations; and what each of its runs is."""

import hashlib
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skywright.analysis.campaign.distributions import (
    Value,
    Variation,
    draw,
    draw_seed,
    parse_variations,
)
from skywright.core.toml_files import parse_value
from skywright.core.user_files import PythonEndedError, read_sources, tried_first
from skywright.description.dump import dump_description, list_sources
from skywright.description.loader import Description, load_description, split_assignments
from skywright.errors import InputError
from skywright.run.source_hash import collect_code_versions

DRAWING = tuple(f"analysis/campaign/{name}.py" for name in ("distributions", "runner", "spec"))
"""Files of this package that decide a row."""
COMPANY = 8
"""Drawn runs in whose company an extreme value is tried before it is refused."""


class Campaign(NamedTuple):
    """A campaign without its number of runs: what decides every row."""

    mission: str
    robot: str | None
    world: str | None
    sets: tuple[str, ...]
    seed: int
    variations: tuple[Variation, ...]
    base: Description
    """The description before anything is varied."""


class Draw(NamedTuple):
    """One run of a campaign, before it flies."""

    run: int
    seed: int
    varied: dict[str, Value]


@tried_first()
def build_campaign(
    mission: str | os.PathLike[str],
    vary: Sequence[str] = (),
    *,
    robot: str | os.PathLike[str] | None = None,
    world: str | os.PathLike[str] | None = None,
    sets: Sequence[str] = (),
    seed: int | None = None,
) -> Campaign:
    """Load the mission and parse what varies; without `seed` the mission's own is the base.

    Raises InputError on a wrong key, distribution or file.
    """
    robot_text, world_text = (None if x is None else os.fspath(x) for x in (robot, world))
    fixed = split_assignments(tuple(sets))
    variations = parse_variations(vary)
    for key in [*(key for key, _ in fixed), *(v.key for v in variations)]:
        if key == "mission.seed":
            raise InputError("mission.seed: a campaign derives the seed of each run from --seed")
    for variation in variations:
        if variation.key in dict(fixed):
            raise InputError(f"{variation.key} is fixed by --set and varied by --vary; choose one")
        for given, root in ((robot, "robot"), (world, "world")):
            if given is not None and variation.key == f"mission.{root}":
                raise InputError(f"mission.{root} is fixed by --{root} and varied by --vary")
    base = load_description(mission, robot, world, sets, seed)
    return Campaign(
        os.fspath(mission), robot_text, world_text, tuple(sets), base.mission.seed, variations, base
    )


def draw_run(campaign: Campaign, run: int) -> Draw:
    """Draw the seed and the varied values of run number `run` (from 0)."""
    varied = {v.key: draw(v, campaign.seed, run) for v in campaign.variations}
    return Draw(run, draw_seed(campaign.seed, run), varied)


def _read_list(value: Value) -> object:
    """The list that a cell of a table writes, or the value itself."""
    return parse_value(value) if isinstance(value, str) and value.startswith("[") else value


def load_run(campaign: Campaign, one: Draw) -> Description:
    """Load the description of one run. Raises InputError when its values do not go together."""
    drawn = {key: _read_list(value) for key, value in one.varied.items()}
    sets = {**dict(split_assignments(campaign.sets)), **drawn}
    return load_description(campaign.mission, campaign.robot, campaign.world, sets, one.seed)


def check_variations(campaign: Campaign, runs: int) -> None:
    """Try the extreme draws of every key, so that a bad range is told before anything flies.

    Raises InputError naming key and distribution.
    """
    # a value may need its company (dryden needs a mean wind): it is bad if no company helps
    company = [draw_run(campaign, i).varied for i in range(min(runs, COMPANY))]
    for variation in campaign.variations:
        for value in _list_extremes(variation, campaign.seed, runs):
            refused: InputError | None = None
            for others in (*company, {}):
                try:
                    varied = {**others, variation.key: value}
                    load_run(campaign, Draw(0, campaign.seed, varied))
                    break
                except InputError as error:
                    if isinstance(error.__cause__, PythonEndedError):
                        break  # such runs are refused one by one, the others fly
                    refused = error
            else:
                raise InputError(_tell_refusal(variation, value, str(refused)))


def _tell_refusal(variation: Variation, value: Value, why: str) -> str:
    """Say why a variation is refused; a key that does not exist is no matter of the draw."""
    why = why.removeprefix("--set: ").removeprefix(f"--set {variation.key}: ")
    drawn = "" if why.startswith("unknown") else f"the draw {write_value(value)} is refused: "
    return f"--vary {variation.key}={variation.text}: {drawn}{why}"


def _list_extremes(variation: Variation, seed: int, runs: int) -> list[Value]:
    if variation.kind in ("uniform", "loguniform"):
        return [float(v) for v in variation.values]
    if variation.kind == "choice":  # a misspelt word is told even where few runs do not draw it
        return list(dict.fromkeys(variation.values))
    drawn = list(dict.fromkeys(draw(variation, seed, i) for i in range(runs)))
    if not variation.numeric:
        return drawn
    return [drawn[0], min(drawn, key=float), max(drawn, key=float)]


def write_command(campaign: Campaign, one: Draw) -> str:
    """Write the command line that repeats one run alone, bit for bit."""
    words = ["skywright", "run", campaign.mission]
    for flag, value in (("--robot", campaign.robot), ("--world", campaign.world)):
        if value is not None:
            words += [flag, value]
    for text in campaign.sets:
        words += ["--set", text]
    for key, drawn in one.varied.items():
        words += ["--set", f"{key}={write_value(drawn)}"]
    return shlex.join([*words, "--seed", str(one.seed)])


def write_value(value: Value) -> str:
    """Write a value as TOML that reads back to exactly the same one."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


def build_identity(campaign: Campaign) -> dict[str, Any]:
    """Return what must agree for two campaigns to have the same rows; what tells most is first."""
    text = dump_description(campaign.base)
    return {
        "mission": campaign.mission,
        "robot": campaign.base.robot.name,
        "world": campaign.base.world.name,
        "set": list(campaign.sets),
        "seed": campaign.seed,
        "vary": {v.key: v.text for v in campaign.variations},
        "values": hashlib.sha256(
            repr([(v.key, v.kind, v.values) for v in campaign.variations]).encode()
        ).hexdigest()[:16],
        "law": _hash_laws(campaign),
        "description": hashlib.sha256(text.encode()).hexdigest()[:16],
        "versions": collect_code_versions(*DRAWING),
    }


def _hash_laws(campaign: Campaign) -> str | None:
    """Return the hash of the users' sources, fixed or varied, and of robots and worlds varied.

    With other files the rows are others; what is fixed of robot and world is in the description.
    """
    names = [f"{path}:" for path in list_sources(campaign.base)]
    texts = [v for x in campaign.variations for v in x.values if isinstance(v, str)]
    names += [v for v in texts if not v.startswith(("[", "{"))]  # a list or a table is no file
    digest, found = hashlib.sha256(), False
    for name in dict.fromkeys(n for n in names if n):
        file = name.rpartition(":")[0] if ".py:" in name else name
        for path in (Path(campaign.mission).parent / file, Path(file)):
            for one in sorted(path.glob("*.toml")) if path.is_dir() else [path]:
                if one.is_file():
                    read = read_sources(one) if one.suffix == ".py" else {one: one.read_bytes()}
                    for source, data in sorted(read.items()):
                        digest.update(source.as_posix().encode() + b"\0" + data)
                    found = True
    return digest.hexdigest()[:16] if found else None

"""Definition of a campaign (mission, layers, seed, variations) and of each of its runs."""

import hashlib
import os
import shlex
from collections.abc import Mapping, Sequence
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
from skywright.description.dump import dump_description, list_sources, write_literal
from skywright.description.loader import (
    Description,
    Sets,
    find_mission,
    load_description,
    split_assignments,
    to_plain,
)
from skywright.errors import InputError
from skywright.run.source_hash import collect_code_versions

DRAWING = tuple(f"analysis/campaign/{name}.py" for name in ("distributions", "runner", "spec"))
"""Files of this package on which a row depends."""
COMPANY = 8
"""Number of draws of the other keys that are tried with an extreme value before it is refused."""


class Campaign(NamedTuple):
    """A campaign without its number of runs: everything on which a row depends."""

    mission: str
    robot: str | None
    world: str | None
    sets: tuple[str, ...]
    seed: int
    variations: tuple[Variation, ...]
    base: Description
    """The description before variations are applied."""


class Draw(NamedTuple):
    """Seed and drawn values of one run."""

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
    sets: Sets = (),
    seed: int | None = None,
) -> Campaign:
    """Load the mission and parse the variations; `sets` and `seed` as `load_description` has them.

    Raises InputError on a wrong key, distribution or file.
    """
    robot_text, world_text = (None if x is None else os.fspath(x) for x in (robot, world))
    texts = _write_sets(sets)
    fixed = split_assignments(texts)
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
    base = load_description(mission, robot, world, texts, seed)
    return Campaign(
        os.fspath(mission), robot_text, world_text, texts, base.mission.seed, variations, base
    )


def _write_sets(sets: Sets) -> tuple[str, ...]:
    """Return `sets` as the `KEY=VALUE` texts that a run's command line repeats."""
    if isinstance(sets, str):
        return (sets,)
    if not isinstance(sets, Mapping):
        return tuple(sets)
    texts = []
    for key, value in sets.items():
        try:  # a text stands as it is, as on the command line
            text = value if isinstance(value, str) else write_literal(to_plain(value))
        except TypeError:
            raise InputError(
                f"sets: {key} = {value!r}; valid: a number, text, boolean, list or dictionary"
            ) from None
        texts.append(f"{key}={text}")
    return tuple(texts)


def draw_run(campaign: Campaign, run: int) -> Draw:
    """Draw the seed and the varied values of run number `run`, counted from 0."""
    varied = {v.key: draw(v, campaign.seed, run) for v in campaign.variations}
    return Draw(run, draw_seed(campaign.seed, run), varied)


def _read_list(value: Value) -> object:
    """Parse a table cell that contains a list; return other values unchanged."""
    return parse_value(value) if isinstance(value, str) and value.startswith("[") else value


def load_run(campaign: Campaign, one: Draw) -> Description:
    """Load the description of one run. Raises InputError if its combination of values is
    invalid."""
    drawn = {key: _read_list(value) for key, value in one.varied.items()}
    sets = {**dict(split_assignments(campaign.sets)), **drawn}
    return load_description(campaign.mission, campaign.robot, campaign.world, sets, one.seed)


def check_variations(campaign: Campaign, runs: int) -> None:
    """Load the extreme draws of every key, so that an invalid range is reported before any flight.

    Raises InputError that names key and distribution.
    """
    # a value may be valid only with others (dryden needs a mean wind): try several combinations
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
                        break  # such runs are refused individually, the others fly
                    refused = error
            else:
                raise InputError(_tell_refusal(variation, value, str(refused)))


def _tell_refusal(variation: Variation, value: Value, why: str) -> str:
    """Return why a variation is refused; for an unknown key the text omits the drawn value."""
    why = why.removeprefix("--set: ").removeprefix(f"--set {variation.key}: ")
    drawn = "" if why.startswith("unknown") else f"the draw {write_value(value)} is refused: "
    return f"--vary {variation.key}={variation.text}: {drawn}{why}"


def _list_extremes(variation: Variation, seed: int, runs: int) -> list[Value]:
    if variation.kind in ("uniform", "loguniform"):
        return [float(v) for v in variation.values]
    if variation.kind == "choice":  # check all choices, even those that few runs do not draw
        return list(dict.fromkeys(variation.values))
    drawn = list(dict.fromkeys(draw(variation, seed, i) for i in range(runs)))
    if not variation.numeric:
        return drawn
    return [drawn[0], min(drawn, key=float), max(drawn, key=float)]


def write_command(campaign: Campaign, one: Draw) -> str:
    """Return the command line that repeats one run bit for bit."""
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
    """Format a value as TOML that parses to exactly the same value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


def build_identity(campaign: Campaign) -> dict[str, Any]:
    """Return what must be equal for two campaigns to have the same rows, most informative first."""
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
    """Return a hash of the user's files on which rows depend; None if there are none.

    These are source files and files of the task, fixed or varied, and varied robots and worlds. A
    fixed robot or world is part of the description.
    """
    folder = find_mission(campaign.mission).path.parent
    names = [f"{path}:" for path in list_sources(campaign.base)]
    names += [str(path) for path in _list_task_files(campaign, folder)]
    texts = [v for x in campaign.variations for v in x.values if isinstance(v, str)]
    names += [v for v in texts if not v.startswith(("[", "{"))]  # a list or a table is no file
    digest, found = hashlib.sha256(), False
    for name in dict.fromkeys(n for n in names if n):
        file = name.rpartition(":")[0] if ".py:" in name else name
        for path in (folder / file, Path(file)):
            for one in sorted(path.glob("*.toml")) if path.is_dir() else [path]:
                if one.is_file():
                    read = read_sources(one) if one.suffix == ".py" else {one: one.read_bytes()}
                    for source, data in sorted(read.items()):
                        digest.update(source.as_posix().encode() + b"\0" + data)
                    found = True
    return digest.hexdigest()[:16] if found else None


def _list_task_files(campaign: Campaign, folder: Path) -> list[Path]:
    """Return the files that the task names, with its fixed and with its varied values.

    Relative paths refer to `folder`.
    """
    task = campaign.base.mission.task
    files = [*task.list_files()]
    for variation in campaign.variations:
        root, _, key = variation.key.rpartition(".")
        if root == "mission.task" and key in type(task).model_fields:
            for value in (v for v in variation.values if isinstance(v, str)):
                varied = task.model_copy(update={key: value})
                files += varied.find_files(folder).list_files()
    return files


def check_unchanged(campaign: Campaign, identity: dict[str, Any]) -> None:
    """Raise InputError if the campaign's files no longer give its `identity`."""
    c = campaign
    try:
        base = load_description(c.mission, c.robot, c.world, c.sets, c.seed)
        why = "" if build_identity(c._replace(base=base)) == identity else "their content differs"
    except InputError as error:
        why = str(error)
    if why:
        raise InputError(
            f"the files of the campaign have changed while it runs ({why}); the finished runs are "
            "kept: restore the files and repeat the command, or give another --out"
        )

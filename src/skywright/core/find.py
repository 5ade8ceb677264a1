"""Finds classes by their kind: built in, in a user's file, or in an installed package.

This module resolves kinds (`kind = "airspeed"`, `kind = "my_sensor.py:Airspeed"`) to classes. A
class states its group (`group = "sensor"`). Lower packages never import the classes that they use.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, NamedTuple

from skywright.core.trust import check_trust
from skywright.core.user_files import load_file
from skywright.errors import InputError, SkywrightError, neighbours


class Group(NamedTuple):
    """Where the classes of one group are searched."""

    what: str  # in messages
    package: str  # of the built-in ones: one module or folder each
    entry_points: str  # group of installed packages


GROUPS = {
    "law": Group("control law", "skywright.vehicle.laws", "skywright.components"),
    "arms_law": Group("arms law", "skywright.vehicle.arms.laws", "skywright.components"),
    "sensor": Group("sensor", "skywright.vehicle.sensors", "skywright.components"),
    "actuator": Group("actuator", "skywright.vehicle.actuators", "skywright.components"),
    "estimator": Group("estimator", "skywright.vehicle.estimators", "skywright.components"),
    "effect": Group("effect", "skywright.vehicle.effects", "skywright.components"),
    "fault": Group("fault", "skywright.vehicle.faults", "skywright.components"),
    "rule": Group("fault rule", "skywright.run.faults", "skywright.components"),
    "thing": Group("thing", "skywright.models.things", "skywright.things"),
    "kind": Group("mission kind", "skywright.missions", "skywright.missions"),
}


class Kind(NamedTuple):
    """A resolved kind: its name (absolute for a file), the class, and the file of a user class."""

    name: str
    cls: Any
    file: Path | None


class Offer(NamedTuple):
    """A kind that is built in, or offered by an installed package."""

    place: str  # in messages
    point: EntryPoint | None  # None: built in


def find(group: str, kind: object, folders: Iterable[Path] = (), key: str = "kind") -> Kind:
    """Return the class of a kind in a group.

    A file is looked up in `folders` (that of the file that names it first), then in the current
    folder. Raises InputError, which begins with `key`, for a kind that is unknown, defined twice or
    of another group, or whose file fails to import.
    """
    if not isinstance(kind, str) or not kind:
        raise InputError(f"{key}: {kind!r} is not a {_what(group)}; valid: {_valid('', group)}")
    if ".py" in kind:
        return _find_in_file(group, kind, folders, key)
    offers = list_offers(group).get(kind, [])
    if len(offers) > 1:
        places = ", ".join(offer.place for offer in offers)
        raise InputError(f"{key}: {_what(group)} {kind!r} is defined twice: {places}")
    for offer in offers:
        if offer.point is None:
            return Kind(kind, load_built_in(group, kind), None)
        try:
            cls = offer.point.load()
        except (Exception, SystemExit) as error:
            raise InputError(f"{key}: importing {offer.place} failed: {explain(error)}") from error
        _check_group(cls, group, offer.place, key)
        return Kind(kind, cls, None)
    raise InputError(f"{key}: {_what(group)} {kind!r} is unknown; valid: {_valid(kind, group)}")


def list_kinds(group: str) -> list[str]:
    """List the kinds of a group by name, built in and installed, without importing them."""
    return sorted(list_offers(group))


@lru_cache
def list_offers(group: str) -> dict[str, list[Offer]]:
    """Return the offers of a group by name, without importing them.

    Components of all groups share one list of entry points: their names are `GROUP.NAME`, such as
    `law.lqr`. A name with more than one offer is refused when it is used.
    """
    found: dict[str, list[Offer]] = {}
    for module in list_modules(group):
        name = module.replace("_", "-") if group == "kind" else module
        found.setdefault(name, []).append(Offer("built in", None))
    shared = GROUPS[group].entry_points == "skywright.components"
    for point in entry_points(group=GROUPS[group].entry_points):
        head, _, name = point.name.partition(".") if shared else (group, "", point.name)
        if head == group:
            package = point.dist.name if point.dist else "a package"
            found.setdefault(name, []).append(Offer(f"{package} ({point.value})", point))
    return found


@lru_cache
def list_modules(group: str) -> tuple[str, ...]:
    """Return the modules in a group's package that define a kind, without importing them."""
    spec = importlib.util.find_spec(GROUPS[group].package)
    if spec is None or spec.submodule_search_locations is None:
        return ()
    found = pkgutil.iter_modules(list(spec.submodule_search_locations))
    return tuple(m.name for m in found if not m.name.startswith("_") and m.name not in SHARED)


SHARED = {"skills"}
"""Modules in a group's package that define no kind; others begin with an underscore."""


@lru_cache
def load_built_in(group: str, kind: str) -> Any:
    """Return the one class of a group that the module of a built-in kind defines."""
    module = importlib.import_module(f"{GROUPS[group].package}.{_module_name(kind)}")
    found = list_classes(module, group)
    assert len(found) == 1, f"{module.__name__} has {len(found)} classes of group {group!r}"
    return found[0]


def list_classes(module: Any, group: str) -> list[Any]:
    """Return the classes of a group that a module, or the modules of a package, define."""
    return [
        cls
        for cls in vars(module).values()
        if isinstance(cls, type)
        and getattr(cls, "group", None) == group
        and (cls.__module__ == module.__name__ or cls.__module__.startswith(module.__name__ + "."))
        and not cls.__name__.startswith("_")
    ]


def _find_in_file(group: str, kind: str, folders: Iterable[Path], key: str) -> Kind:
    file, colon, name = kind.rpartition(":")
    if not colon or not file.endswith(".py") or not name.isidentifier():
        raise InputError(f"{key}: {kind!r}: specify a {_what(group)} in a file as file.py:Class")
    places = [base / Path(file).expanduser() for base in (*folders, Path())]
    path = next((p.resolve() for p in places if p.is_file()), None)
    if path is None:
        raise InputError(
            f"{key}: file {file!r} not found in the folder of the file that names it or in "
            "the current folder"
        )
    check_trust(path)
    try:
        module = load_file(path)
    except (Exception, SystemExit) as error:
        raise InputError(f"{key}: importing {path} failed: {explain(error)}") from error
    cls = getattr(module, name, None)
    if cls is None:
        valid = ", ".join(c.__name__ for c in list_classes(module, group)) or "none"
        raise InputError(f"{key}: {path} has no class {name!r}; its {_what(group)}s: {valid}")
    _check_group(cls, group, str(path), key)
    return Kind(f"{path}:{name}", cls, path)


def _check_group(cls: Any, group: str, where: str, key: str) -> None:
    found = getattr(cls, "group", None)
    if not isinstance(cls, type) or found != group:
        named = getattr(cls, "__name__", repr(cls))
        if not isinstance(cls, type) and callable(cls):
            raise InputError(
                f"{key}: {named} in {where} is a function; a {_what(group)} must be a "
                "class, see docs/howto/your-own-control-law.md"
            )
        says = f"is a {_what(found)}" if found in GROUPS else "is none"
        raise InputError(f"{key}: a {_what(group)} is needed; {named} in {where} {says}")


def explain(error: BaseException) -> str:
    """Describe an error of a user's code with the line of its file where it was raised."""
    if isinstance(error, SyntaxError) and error.filename:
        at = f"line {error.lineno} of {Path(error.filename).name}"
        return f"{type(error).__name__}: {error.msg} ({at})"
    found = traceback.extract_tb(error.__traceback__)
    frames = [f for f in found if not f.filename.startswith("<frozen")]
    at = f" (line {frames[-1].lineno} of {Path(frames[-1].filename).name})" if frames else ""
    return f"{type(error).__name__}: {error}{at}"


@contextmanager
def blame(cls: type, what: str, error: type[SkywrightError] = InputError) -> Iterator[None]:
    """Convert errors raised by a user's class to an `error` with class, line and file.

    Errors of built-in classes are defects of Skywright and are not converted; nor are its own
    errors.
    """
    try:
        yield
    except Exception as found:
        ours = "skywright."
        if cls.__module__.startswith(ours) or type(found).__module__.startswith(ours):
            raise
        raise error(f"{what} of {cls.__qualname__} failed: {explain(found)}") from found


def _module_name(kind: str) -> str:
    return kind.replace("-", "_")


def _what(group: str) -> str:
    return GROUPS[group].what


def _valid(kind: str, group: str) -> str:
    names = list_kinds(group)
    listed = neighbours(kind, names) if kind else ", ".join(names)
    return f"{listed}{', or ' if listed else ''}'file.py:Class'"

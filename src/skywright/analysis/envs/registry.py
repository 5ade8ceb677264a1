"""The environments by name, for `make`, for Gymnasium's own registry and for workers."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium

from skywright.analysis.envs.env import ContactEnv
from skywright.errors import InputError, neighbours

PLACES = {
    "WeldPress": "weld_press", "WallSlide": "wall_slide", "PegInHole": "peg_in_hole",
    "SensorInstall": "sensor_install",
}  # fmt: skip
"""Name of a class -> its module beside this one."""


def find_class(name: str) -> type[ContactEnv]:
    """Return the class of an environment; raises InputError that lists them."""
    if not isinstance(name, str) or name not in PLACES:
        valid = neighbours(str(name), PLACES)
        raise InputError(f"environment {name!r} is unknown; valid: {valid}")
    module = import_module(f"{__package__}.{PLACES[name]}")
    cls: type[ContactEnv] = getattr(module, name)
    return cls


def make(name: str, **options: Any) -> ContactEnv:
    """Build an environment by name; `options` are those of its class.

    Raises InputError for an unknown name or option, and where its class does.
    """
    cls = find_class(name)
    known = [k for k in ContactEnv.__init__.__annotations__ if k != "return"]
    for key in options:
        if key not in known:
            raise InputError(f"environment {name}: option {key!r} is unknown; valid: "
                             f"{', '.join(known)}")  # fmt: skip
    return cls(**options)


def register() -> None:
    """Tell Gymnasium: `gymnasium.make("skywright/WeldPress-v0")`."""
    for name in PLACES:
        where = f"skywright/{name}-v0"
        if where not in gymnasium.registry:
            gymnasium.register(where, entry_point=f"skywright.envs:{name}")

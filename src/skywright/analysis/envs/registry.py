"""Registry of the environments by name, for `make`, Gymnasium and the workers."""

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
"""Name of a class -> module in this package."""


def find_class(name: str) -> type[ContactEnv]:
    """Return the class of an environment. Raises InputError with the valid names."""
    if not isinstance(name, str) or name not in PLACES:
        valid = neighbours(str(name), PLACES)
        raise InputError(f"environment {name!r} is unknown; valid: {valid}")
    module = import_module(f"{__package__}.{PLACES[name]}")
    cls: type[ContactEnv] = getattr(module, name)
    return cls


def make(name: str, **options: Any) -> ContactEnv:
    """Build an environment by name; `options` are the arguments of its class.

    Raises InputError for an unknown name or option, and for invalid values of the options.
    """
    cls = find_class(name)
    known = [k for k in ContactEnv.__init__.__annotations__ if k != "return"]
    for key in options:
        if key not in known:
            raise InputError(f"environment {name}: option {key!r} is unknown; valid: "
                             f"{', '.join(known)}")  # fmt: skip
    return cls(**options)


def register() -> None:
    """Register the environments with Gymnasium: `gymnasium.make("skywright/WeldPress-v0")`."""
    for name in PLACES:
        where = f"skywright/{name}-v0"
        if where not in gymnasium.registry:
            gymnasium.register(where, entry_point=f"skywright.envs:{name}")

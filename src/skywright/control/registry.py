"""Control laws by name or by file.

A built-in law is a module with `step` (compiled) and `step_c` (the same behind the one signature).
A user's law is `file.py:function` with the arguments (par, mem, ref, est, body, cmd), records of
core/types.py: a plain Python function flies in interactive mode, a numba-compiled one in both.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.errors import InputError

LAWS = {
    "push_and_slide": "skywright.control.push_and_slide",
    "thrust_vectoring": "skywright.control.thrust_vectoring",
    "cascade": "skywright.control.cascade",
    "backstepping": "skywright.control.backstepping",
    "model_inversion": "skywright.control.model_inversion",
    # the alternatives that Tognon 2018 argues against
    "joint_space": "skywright.control.joint_space",
    "inverse_kinematics": "skywright.control.inverse_kinematics",
    "tip_pd": "skywright.control.tip_pd",
}
ARMS_LAWS = {
    "compliant": "skywright.control.compliant_arms",
}
"""Laws of arms with position servos: `step_c` reads ref and arms and fills cmd.theta."""
FULLY_ACTUATED = {"backstepping", "push_and_slide", "joint_space", "inverse_kinematics", "tip_pd"}


CASCADED = {"cascade", "model_inversion"}
"""Laws of a platform that leans, with the gains of control/cascade_gains.py."""


class Law(NamedTuple):
    """A law ready to fly."""

    name: str
    step: Callable[..., None]  # called with the (1,) BELIEF array, interactive mode
    compiled: Any  # numba cfunc for the fast mode, or None for a plain Python law


def load_law(name: str, folder: Path | None = None) -> Law:
    """Return the law called `name`, or from `file.py:function` (relative to `folder`, then here).

    Raises InputError for an unknown name, file or function, or a wrong number of arguments.
    """
    if name in LAWS:
        module = importlib.import_module(LAWS[name])
        return Law(name, module.step_belief, module.step_c)
    if ".py" not in name:
        raise InputError(
            f"control law {name!r} is unknown; valid: {', '.join(sorted(LAWS))}, "
            "or 'file.py:function'"
        )
    return _load_user_law(name, folder)


def load_arms_law(name: str) -> Law:
    """Return the law of compliant arms called `name`; raises InputError for an unknown one."""
    if name not in ARMS_LAWS:
        raise InputError(f"arms law {name!r} is unknown; valid: {', '.join(sorted(ARMS_LAWS))}")
    module = importlib.import_module(ARMS_LAWS[name])
    return Law(name, module.step_belief, module.step_c)


def _load_user_law(name: str, folder: Path | None) -> Law:
    file_name, _, function = name.partition(":")
    function = function or "step"
    candidates = [Path(file_name)] if folder is None else [folder / file_name, Path(file_name)]
    path = next((p for p in candidates if p.is_file()), None)
    if path is None:
        raise InputError(f"control law file {file_name!r} was not found")
    spec = importlib.util.spec_from_file_location(f"skywright_user_law_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: importing the control law failed: {error!r}") from error
    step = getattr(module, function, None)
    if not callable(step):
        names = [n for n in vars(module) if callable(getattr(module, n)) and not n.startswith("_")]
        raise InputError(f"{path}: no function {function!r}; it defines: {', '.join(names) or '-'}")
    python = getattr(step, "py_func", step)
    count = getattr(getattr(python, "__code__", None), "co_argcount", 6)
    if count != 6:
        raise InputError(
            f"{path}: {function} takes {count} arguments; a law takes 6: "
            "par, mem, ref, est, body, cmd"
        )

    def step_belief(belief: Any) -> None:
        b = belief.view(np.recarray)[0]  # named fields, as in compiled code
        step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)

    return Law(name, step_belief, _compile(step) if hasattr(step, "py_func") else None)


def _compile(step: Any) -> Any:
    """Put a user's jitted law behind the one signature (in this process only)."""
    from numba import carray, cfunc

    from skywright.control.signature import LAW

    @cfunc(LAW)
    def step_c(belief):  # type: ignore[no-untyped-def]
        b = carray(belief, 1)[0]
        try:
            step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)
        except Exception:  # cannot leave compiled code: becomes a command that is never applied
            b.cmd.f_B[0] = np.nan

    return step_c

"""The trees of bodies in a file, their masses, and the choice of the one that is imported.

A file may hold more than one robot: a table, an object to grasp, a second vehicle. One tree is
imported; the others are left out with a note that names them and their masses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.errors import InputError
from skywright.models.importing.comparing import TOLERANCE
from skywright.models.importing.opening import Opened, compile_spec
from skywright.models.importing.rotors import has_rotors


class Tree(NamedTuple):
    """A child of the world and all bodies below it."""

    body: mujoco.MjsBody
    name: str
    mass: float  # kg


def choose_platform(opened: Opened, wanted: str | None) -> Tree:
    """Return the tree that flies: of several the one with rotors, or the body `wanted`.

    The others are noted in `opened`. Raises InputError if no tree flies, or if the choice is open.
    """
    model = _compile_alone(opened)
    trees = _list_trees(opened, model)
    free = {int(model.jnt_bodyid[j]) for j in range(model.njnt) if _is_free(model, j)}
    flying = [tree for tree in trees if tree.body.id in free]
    if wanted is not None:
        names = ", ".join(tree.name for tree in flying)
        flying = [tree for tree in flying if tree.name == wanted]
        if not flying:
            raise InputError(f"--body {wanted!r} does not fly; valid: {names or 'none'}")
    if not flying:
        raise InputError(
            f"{opened.path}: no body has a free joint: the file holds no robot that flies"
        )
    return _choose(
        opened, trees, flying, lambda tree: has_rotors(opened, model, tree.body.id),
        "have rotors", "choose one with --body NAME",
    )  # fmt: skip


def choose_arm(opened: Opened) -> Tree:
    """Return the tree with joints of a file that holds an arm; free joints do not count.

    The others are noted in `opened`. Raises InputError if the choice is open.
    """
    for joint in list(opened.spec.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            opened.spec.delete(joint)
    model = _compile_alone(opened)
    trees = _list_trees(opened, model)
    if not trees:
        raise InputError(f"{opened.path}: holds no body")
    roots = set(model.body_rootid[model.jnt_bodyid].tolist())
    return _choose(
        opened, trees, trees, lambda tree: tree.body.id in roots,
        "have joints", "write the arm into a file of its own",
    )  # fmt: skip


def _choose(
    opened: Opened, trees: Sequence[Tree], among: Sequence[Tree], good: Callable[[Tree], bool],
    what: str, how: str,
) -> Tree:  # fmt: skip
    """Return the only good tree, and note the others in `opened`; InputError if several are."""
    best = [tree for tree in among if good(tree)] if len(among) > 1 else list(among)
    if len(best) != 1:
        names = ", ".join(repr(tree.name) for tree in best or among)
        said = what if best else f"are there and none of them {what.replace('have', 'has')}"
        raise InputError(
            f"{opened.path}: {len(best or among)} bodies {said} ({names}), and one robot is "
            f"imported: {how}"
        )
    opened.notes.extend(
        f"left out: {tree.name!r} of {opened.path.name} with the links below it, {tree.mass:g} kg: "
        f"it is not connected to {best[0].name!r}"
        for tree in trees if tree is not best[0]
    )  # fmt: skip
    return best[0]


def check_mass(opened: Opened, model: mujoco.MjModel, root: int, trees: Sequence[Tree]) -> None:
    """Raise InputError if the robot does not have the mass (kg) of the trees that it consists of.

    MuJoCo rescales masses if a compiler setting of one file acts on another.
    """
    mass, parts = float(model.body_subtreemass[root]), sum(tree.mass for tree in trees)
    if abs(mass - parts) > TOLERANCE * parts:
        raise InputError(
            f"{opened.path}: the robot has {mass:g} kg, and the bodies that it consists of have "
            f"{parts:g} kg"
        )


def _is_free(model: mujoco.MjModel, joint: int) -> bool:
    return bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def _list_trees(opened: Opened, model: mujoco.MjModel) -> list[Tree]:
    world, out = opened.spec.worldbody, []
    body = world.first_body()
    while body is not None:
        name = body.name or f"body {body.id}"
        out.append(Tree(body, name, float(model.body_subtreemass[body.id])))
        body = world.next_body(body)
    return out


def _compile_alone(opened: Opened) -> mujoco.MjModel:
    """Compile a file alone; InputError if MuJoCo's masses are not those of the XML."""
    if opened.spec.compiler.settotalmass > 0.0:
        _scale(opened)
    model = compile_spec(opened.path, opened.spec)
    written = _sum_masses(opened)
    read = float(np.sum(model.body_mass[1:]))
    if written is not None and abs(read - written) > TOLERANCE * written:
        raise InputError(
            f"{opened.path}: MuJoCo reads {read:g} kg, the links of the file have {written:g} kg"
        )
    return model


def _scale(opened: Opened) -> None:
    """Write the masses that `settotalmass` gives into the bodies.

    MuJoCo would apply the setting to the robot with its arm, and ignore that of the arm's file.
    """
    spec = opened.spec
    total, spec.compiler.settotalmass = spec.compiler.settotalmass, -1.0
    model = compile_spec(opened.path, spec)
    mass = float(np.sum(model.body_mass[1:]))
    if mass <= 0.0:
        return
    for body in spec.bodies:
        at, share = body.id, total / mass
        body.explicitinertial = bool(at and model.body_mass[at] > 0.0)
        if body.explicitinertial:
            body.mass, body.inertia = (
                share * model.body_mass[at], share * model.body_inertia[at]
            )  # fmt: skip
            body.ipos, body.iquat = model.body_ipos[at], model.body_iquat[at]
            body.fullinertia = np.full(6, np.nan)
            body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    compiler = spec.compiler
    compiler.inertiafromgeom, compiler.balanceinertia = 0, 0
    compiler.boundmass = compiler.boundinertia = 0.0


def _sum_masses(opened: Opened) -> float | None:
    """Return the sum (kg) of the masses in the XML of a URDF or SDF file; None for MJCF."""
    if opened.kind == "MJCF":
        return None
    if opened.kind == "SDF":
        texts = [link.findtext("inertial/mass", "1.0") for link in opened.root.findall("link")]
    else:
        masses = [link.find("inertial/mass") for link in opened.root.findall("link")]
        texts = [m.get("value", "0") for m in masses if m is not None]
    return sum(float(text) for text in texts)

"""Mass, centre of mass and inertia of an SDF link: as written, by SDF's defaults, or of its shapes.

`<inertial auto="true">` (SDF 1.11) computes them from the collision shapes and their density
(http://sdformat.org/spec, <inertial>); a <mass> beside it scales the result.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.importing.sdf_frames import Pose, read_pose
from skywright.models.importing.xml_input import read_numbers

DENSITY = 1000.0
"""kg/m^3, SDF's default."""
SHAPES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "ellipsoid": {"radii": 3},
    "cone": {"radius": 1, "length": 1},
}
"""Shapes whose inertia is computed, with their dimensions and the numbers of each."""


class LinkInertia(NamedTuple):
    """Mass (kg), centre of mass (3,) m and inertia (3, 3) kg m^2 about it, in the link's frame."""

    mass: float
    com: Array
    inertia: Array
    assumed: frozenset[str] = frozenset()  # of "mass" and "inertia": what the file does not state
    note: str = ""


def read_inertia(
    link: ET.Element, where: str, place: Callable[[ET.Element | None, str], Pose]
) -> LinkInertia:
    """Return the inertia of a link.

    `place(pose, what)` returns the pose of a part of the link in the link's frame. Raises
    InputError, which names `where`, if a number is invalid or a shape has no closed form.
    """
    inertial, name = link.find("./inertial"), link.get("name", "")
    if inertial is None:
        return LinkInertia(
            1.0, np.zeros(3), np.eye(3), frozenset(("mass", "inertia")),
            f"link {name} has no <inertial>: 1 kg and 1 kg m^2, as SDF says",
        )  # fmt: skip
    mass = _read(inertial, "mass", where)
    if mass is not None and mass < 0.0:
        raise InputError(f"{where}: <mass> is {mass:g} kg; valid: 0 or more")
    if inertial.get("auto") in ("1", "true"):
        return _weigh(link, inertial, mass, where, place)
    terms, missing = {}, []
    for term in ("xx", "yy", "zz", "xy", "xz", "yz"):
        value = _read(inertial, f"inertia/i{term}", where)
        if value is None and term[0] == term[1]:
            missing.append(f"<i{term}>")
        terms[term] = value if value is not None else float(term[0] == term[1])
    tensor = np.array([[terms["".join(sorted(a + b))] for b in "xyz"] for a in "xyz"])
    at = read_pose(inertial.find("pose"), f"{where}: pose of <inertial>")
    assumed, said = set(), []
    if mass is None:
        assumed.add("mass")
        said.append("no <mass> (1 kg, as SDF says)")
    if missing:
        assumed.add("inertia")
        what = "<inertia>" if len(missing) == 3 else " and ".join(missing)
        said.append(f"no {what} (1 kg m^2, as SDF says)")
    note = f"link {name} has {' and '.join(said)}" if said else ""
    mass = 1.0 if mass is None else mass
    return LinkInertia(mass, at.p, at.R @ tensor @ at.R.T, frozenset(assumed), note)


def _weigh(
    link: ET.Element,
    inertial: ET.Element,
    mass: float | None,
    where: str,
    place: Callable[[ET.Element | None, str], Pose],
) -> LinkInertia:
    """Return the inertia of a link's collision shapes, scaled to `mass` unless it is None."""
    shapes = link.findall("collision")
    if not shapes:
        raise InputError(f'{where}: <inertial auto="true"> requires a <collision>; add mass and '
                         "inertia to <inertial>")  # fmt: skip
    common = _read(inertial, "density", where)
    parts, guessed = [], False
    for shape in shapes:
        what = f"{where}: collision {shape.get('name', '')!r}"
        own = _read(shape, "density", what)
        guessed |= own is None and common is None
        density = next(x for x in (own, common, DENSITY) if x is not None)
        if not density > 0.0:
            raise InputError(f"{what}: <density> is {density:g} kg/m^3; valid: above 0")
        volume, up, per_mass = _measure(shape, what)
        at = place(shape.find("pose"), f"{what}: pose")
        com = at.p + at.R @ np.array([0.0, 0.0, up])
        parts.append((density * volume, com, density * volume * at.R @ np.diag(per_mass) @ at.R.T))
    total = sum(m for m, _, _ in parts)
    com = sum((m * p for m, p, _ in parts), np.zeros(3)) / total
    inertia = np.zeros((3, 3))
    for m, p, about in parts:
        d = p - com
        inertia += about + m * (d @ d * np.eye(3) - np.outer(d, d))
    scale = 1.0 if mass is None else mass / total
    density_note = f", with {DENSITY:g} kg/m^3, as SDF says" if guessed and mass is None else ""
    note = f"link {link.get('name', '')}: {scale * total:.4g} kg of its collision shapes"
    assumed = frozenset(("mass", "inertia") if density_note else ())
    return LinkInertia(scale * total, com, scale * inertia, assumed, note + density_note)


def _measure(shape: ET.Element, what: str) -> tuple[float, float, Array]:
    """Return volume (m^3), height (m) of the centre of mass along z, and moments (3,) a mass."""
    element = next(iter(shape.find("geometry") or ()), None)
    tag = "empty" if element is None else element.tag
    if element is None or tag not in SHAPES:
        raise InputError(
            f'{what}: the inertia of <{tag[:40]}> is not computed (<inertial auto="true">); valid: '
            f"{', '.join(SHAPES)}, or mass and inertia in <inertial>"
        )
    values: list[float] = []
    for key, n in SHAPES[tag].items():
        values += read_numbers(element.findtext(key), n, f"{what}: {key} of <{tag}>", [0.0] * n)
    if min(values) <= 0.0:
        raise InputError(f"{what}: the size of <{tag}> is {values}; valid: numbers above 0 (m)")
    if tag == "box":
        x, y, z = (size**2 / 12.0 for size in values)
        return math.prod(values), 0.0, np.array([y + z, x + z, x + y])
    if tag == "ellipsoid" or tag == "sphere":
        a, b, c = values if tag == "ellipsoid" else 3 * values
        round_ = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 5.0
        return 4.0 / 3.0 * math.pi * a * b * c, 0.0, round_
    r, length = values
    rod = math.pi * r**2 * length
    if tag == "cone":  # its apex is at +z, half of the length above its origin
        across = 3.0 / 20.0 * r**2 + 3.0 / 80.0 * length**2
        return rod / 3.0, -length / 4.0, np.array([across, across, 0.3 * r**2])
    across, axial, ends = rod * (length**2 / 12.0 + r**2 / 4.0), rod * r**2 / 2.0, 0.0
    if tag == "capsule":
        ends = 4.0 / 3.0 * math.pi * r**3
        across += ends * (0.4 * r**2 + length**2 / 4.0 + 0.375 * length * r)
        axial += ends * 0.4 * r**2
    return rod + ends, 0.0, np.array([across, across, axial]) / (rod + ends)


def _read(parent: ET.Element, path: str, where: str) -> float | None:
    """Return the number of an element, None without the element; InputError if it is empty."""
    element = parent.find(path)
    if element is None:
        return None
    if not (element.text or "").strip():
        raise InputError(f"{where}: <{element.tag}> is empty; valid: one number, or no such "
                         "element (SDF's default)")  # fmt: skip
    return read_numbers(element.text, 1, f"{where}: {element.tag}", [])[0]

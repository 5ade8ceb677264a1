"""The files that an MJCF file includes or attaches, and the size that MuJoCo expands them to.

MuJoCo's reader follows `<model file=''>` until the stack overflows, and copies the content of a
`<replicate>` one by one. Files and copies are therefore counted before MuJoCo reads them.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from skywright.errors import InputError
from skywright.models.importing.xml_input import MAX_ELEMENTS, MAX_INCLUDES, read_xml

MAX_BODIES = 500
MAX_FILES = 200
"""Files that are read in all; a file counts each time that another one names it."""
COPIED = ("replicate", "composite", "flexcomp")
"""Elements whose `count` multiplies what they contain or make."""
BODIES = ("body", "link")


def check_files(path: Path, root: ET.Element) -> None:
    """Check an MJCF file with all files that it includes or attaches.

    Raises InputError if one of them is missing or circular, or if all of them together have more
    files, elements or bodies than a robot.
    """
    _Reader().measure(path, root, (path.resolve(),))


class _Reader:
    """Reads the files of one robot; each of them once."""

    def __init__(self) -> None:
        self.trees: dict[Path, ET.Element] = {}
        self.files = self.elements = 0

    def measure(self, path: Path, root: ET.Element, above: tuple[Path, ...]) -> tuple[int, int]:
        """Return the numbers of elements and bodies of a model, with all copies."""
        found = list(self._walk(path, root, above))
        elements, bodies = sum(n for _, n in found), sum(n for e, n in found if e.tag in BODIES)
        models = {}
        for element, _ in found:
            if element.tag == "model" and element.get("file"):
                other, tree, chain = self._open(path, element, above)
                size = self.measure(other, tree, chain)
                models[element.get("name") or tree.get("model", "")] = size
        for element, copies in found:
            more = models.get(element.get("model", "")) if element.tag == "attach" else None
            if more is not None:
                elements, bodies = elements + copies * more[0], bodies + copies * more[1]
        for n, most, what in ((elements, MAX_ELEMENTS, "elements"), (bodies, MAX_BODIES, "bodies")):
            if n > most:
                raise InputError(f"{path}: {n} {what} with all copies; at most {most} are read")
        return elements, bodies

    def _walk(
        self, path: Path, root: ET.Element, above: tuple[Path, ...]
    ) -> Iterator[tuple[ET.Element, int]]:
        """Yield the elements of a model and how often each is copied; includes are replaced."""
        todo = [(root, 1, above)]
        while todo:
            element, copies, chain = todo.pop()
            self.elements += 1
            if self.elements > MAX_ELEMENTS:
                raise InputError(
                    f"{path}: more elements than {MAX_ELEMENTS}, the limit for a model with its "
                    "included files"
                )
            if element.tag == "include":
                _, element, chain = self._open(path, element, chain)
            elif element.tag in COPIED:
                copies *= _count(path, element)
                if copies > MAX_BODIES:
                    raise InputError(
                        f"{path}: <{element.tag} count={element.get('count')!r}> makes {copies} "
                        f"copies with those around it; at most {MAX_BODIES} are read"
                    )
            yield element, copies
            todo += [(child, copies, chain) for child in reversed(element)]

    def _open(
        self, path: Path, element: ET.Element, above: tuple[Path, ...]
    ) -> tuple[Path, ET.Element, tuple[Path, ...]]:
        """Return path and root of the file that an element of the model `path` names."""
        name = element.get("file", "")
        if not name:
            raise InputError(f"{path}: an <{element.tag}> without file='...'")
        other = path.absolute().parent / name
        place = other.resolve()
        if place in above:
            verb = "includes" if element.tag == "include" else "attaches"
            raise InputError(f"{path}: {verb} itself by way of {name!r}")
        self.files += 1
        if len(above) >= MAX_INCLUDES:
            raise InputError(f"{path}: more than {MAX_INCLUDES} nested files")
        if self.files > MAX_FILES:
            raise InputError(f"{path}: includes or attaches files more than {MAX_FILES} times")
        if place not in self.trees:
            self.trees[place] = read_xml(other)
        return other, self.trees[place], (*above, place)


def _count(path: Path, element: ET.Element) -> int:
    """Return the product of the numbers of `count`; MuJoCo names those that are invalid."""
    total = 1.0
    for text in (element.get("count") or "1").split():
        try:
            total *= max(float(text), 1.0)
        except ValueError:
            return 1
    if not math.isfinite(total):
        raise InputError(f"{path}: count of <{element.tag}> is {element.get('count')!r:.80}")
    return int(total)

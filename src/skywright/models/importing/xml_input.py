"""Reads XML from untrusted sources: with limits, without entities, with errors that name file and
line."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.core.bounded import read_text
from skywright.errors import InputError

MAX_BYTES = 20_000_000
MAX_ELEMENTS = 200_000
MAX_DEPTH = 200
"""Nested elements; deeper nesting would exhaust the stack of the recursive readers."""
MAX_INCLUDES = 50


def read_xml(path: Path) -> ET.Element:
    """Return the root element of an XML file.

    Raises InputError if the file cannot be read, is larger or deeper than a robot, contains a
    document type or entities (which can expand without end), or is a template.
    """
    return parse_xml(read_text(path, MAX_BYTES), path)


def parse_xml(text: str, path: Path) -> ET.Element:
    """Return the root element of XML text; `path` is named in errors."""
    lower = text.lower()
    if "<!doctype" in lower or "<!entity" in lower:
        raise InputError(f"{path}: a document type or entity declaration is refused; remove it")
    if "{{" in text or "{%" in text:
        raise InputError(f"{path}: is a template ({{{{ or {{%): render it first")
    text = _declare_prefixes(text)
    parser: Any = ET.XMLPullParser(["start", "end"])
    depth = count = 0
    root: ET.Element | None = None
    try:
        for at in range(0, len(text), 65536):
            parser.feed(text[at : at + 65536])
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                count += event == "start"
                if depth > MAX_DEPTH or count > MAX_ELEMENTS:
                    raise InputError(
                        f"{path}: more than {MAX_DEPTH} nested or {MAX_ELEMENTS} elements; a "
                        "robot has fewer"
                    )
        parser.close()
    except ET.ParseError as error:
        raise InputError(f"{path}: not XML: {error}") from None
    if root is None:
        raise InputError(f"{path}: empty")
    for element in root.iter():
        for key, text in element.attrib.items():
            if key != "name" and "nan" in text.lower().split():
                raise InputError(f"{path}: {key} of <{element.tag}> is {text[:80]!r}; not a number")
        if "xacro" in element.tag or any("${" in v or "$(" in v for v in element.attrib.values()):
            raise InputError(
                f"{path}: holds xacro; expand it first, with the packages that it names: "
                f"xacro {path.name} > {path.stem}.urdf"
            )
    return root


def _declare_prefixes(text: str) -> str:
    """Declare prefixes that a file uses without a declaration: Gazebo accepts such files."""
    unknown = set(re.findall(r"<([A-Za-z_][\w.-]*):", text))
    unknown |= set(re.findall(r"\s([A-Za-z_][\w.-]*):[\w.-]+=", text))
    unknown -= {"xml", "xmlns", *re.findall(r"\bxmlns:([\w.-]+)", text)}
    names = "".join(f' xmlns:{name}="{name}"' for name in sorted(unknown))
    return re.sub(r"<[A-Za-z_][\w.-]*", lambda tag: tag[0] + names, text, count=1)


def read_numbers(text: str | None, n: int, what: str, default: Sequence[float]) -> list[float]:
    """Return `n` finite numbers of a text, the default if it is empty; InputError names `what`.

    Without a default, an empty text is an error.
    """
    text = text or ""
    if default and not text.strip():
        return list(default)
    try:
        values = [float(x) for x in text.split()]
    except ValueError:
        values = []
    if len(values) != n or not all(math.isfinite(x) for x in values):
        raise InputError(f"{what} is {text.strip()[:80]!r}; {n} finite number(s) are required")
    return values


def check_span(low: float, high: float, what: str) -> None:
    """Raise InputError if the limits of a joint are reversed."""
    if low > high:
        raise InputError(
            f"{what}: lower limit {low:g} is above upper limit {high:g}; valid: lower <= upper "
            "(equal: locked)"
        )

"""Options of the command `records`: what it lists, and which options are valid for it."""

from __future__ import annotations

from collections.abc import Collection

import click
from click.core import ParameterSource

from skywright.errors import InputError

EXPORTS = {
    "parquet": {"structure", "component", "flight", "spot"},
    "local": {"structure", "component", "flight"},
    "dicom": {"structure", "component", "flight"},
    "report": {"flight"},
}
"""Exports that each list can accompany, and the options that select what they contain."""
NEEDED = {"report": ("flight",), "dicom": ("flight", "component")}
"""Options that an export requires; an import states its flight."""
SELECTION = ("structure", "component", "flight", "spot")
TABLE = ("columns", "lag", "measured", "required", "registration")
"""Options of an imported table."""
_MORE = {*EXPORTS, "deviations"}
VALID = {
    "readings": {"readings", "structure", "component", "flight", "spot", "table", *_MORE},
    "import": {"source", "structure", "component", "table", *TABLE, *_MORE},
    "thickness": {
        "thickness",
        "structure",
        "component",
        "spot",
        "radius",
        *(EXPORTS.keys() - NEEDED.keys()),
    },
    "indications": {"indications", "decide", "who", "structure", "component", "flight", *_MORE},
    "report": {"flight", "component", *_MORE},
    "datums": {"datums", "structure", "flight"},
    "contacts": {"structure", "spot", "at", "radius", "table", "geojson", "origin"},
}
"""Valid options of each list, besides --json."""
LABELS = {"contacts": "contact measurements"}
HINTS = {
    **{("thickness", name): ", which merges the flights" for name in ("flight", *NEEDED)},
    **{("datums", export): "; export in a second command" for export in EXPORTS},
}
"""Reasons in messages, by the list and the option that is not valid for it."""
CHOICES = ("readings", "thickness", "indications", "decide", "source", "datums")
"""Options of which one is valid."""
REQUIRED = {
    "who": ("decide",), "deviations": ("report",), "origin": ("geojson",),
    "radius": ("at", "thickness"), **dict.fromkeys(TABLE, ("source",)),
}  # fmt: skip
"""Options that are valid only with one of others."""


def check_options(context: click.Context) -> tuple[str, set[str]]:
    """Return the list (a key of VALID) and the names of the options on the command line.

    Raises InputError if one of them has no effect on the list or on an export, or if an export
    does not make the same selection as the list.
    """
    given = {
        name for name in context.params
        if context.get_parameter_source(name) == ParameterSource.COMMANDLINE
    } - {"file", "as_json"}  # fmt: skip
    flags = {str(p.name): p.opts[0] for p in context.command.params}
    if len(given.intersection(CHOICES)) > 1:
        shown = [flags[name] for name in CHOICES]
        raise InputError(f"{', '.join(shown[:-1])} and {shown[-1]}: choose one")
    for name, others in REQUIRED.items():
        if name in given and not given.intersection(others):
            raise InputError(
                f"{flags[name]}: valid with {' or '.join(flags[other] for other in others)}"
            )
    listing = choose_listing(given)
    labels = {one: LABELS.get(one, f"--{one}") for one in VALID}
    for name in (name for name in flags if name in given - VALID[listing]):
        valid = ", ".join(labels[one] for one, options in VALID.items() if name in options)
        hint = HINTS.get((listing, name), "")
        raise InputError(f"{flags[name]}: valid for {valid}; not for {labels[listing]}{hint}")
    # an import and a DICOM file state their structure or component
    owner = {"structure", "component"} if listing == "import" else set()
    owner |= {"component"} if "dicom" in given else set()
    for export in (export for export in EXPORTS if export in given):
        for name in SELECTION:
            if name in given - EXPORTS[export] - owner:
                raise InputError(
                    f"{flags[name]}: not valid with {flags[export]}, whose content is selected by "
                    + ", ".join(flags[one] for one in SELECTION if one in EXPORTS[export])
                )
        needed = [n for n in NEEDED.get(export, ()) if n != "flight" or listing != "import"]
        if not given.issuperset(needed):
            raise InputError(f"{flags[export]} requires {' and '.join(flags[n] for n in needed)}")
    return listing, given


def choose_listing(given: Collection[str]) -> str:
    """Return what the command lists with these options: a key of VALID."""
    for name, listing in (
        ("datums", "datums"), ("source", "import"), ("thickness", "thickness"),
        ("readings", "readings"), ("indications", "indications"), ("decide", "indications"),
        ("parquet", "readings"), ("report", "report"), ("local", "indications"),
        ("dicom", "indications"),
    ):  # fmt: skip
        if name in given:
            return listing
    return "contacts"

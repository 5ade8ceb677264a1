"""Names of records that a link carries: one at the end that fills it, one where it arrives."""

NEAR = "near end of the link"


def name_near(name: str) -> str:
    """Return the name of a component's record at the end of a link where it is filled."""
    return f"{name} {NEAR}".strip()


def name_far(name: str) -> str:
    """Return the name of a record at the end of a link where it arrives."""
    return name.removesuffix(NEAR).strip()

"""Names of the records that a link carries, at the sending end and at the receiving end."""

NEAR = "near end of the link"


def name_near(name: str) -> str:
    """Return the name of a component's record at the sending end of a link."""
    return f"{name} {NEAR}".strip()


def name_far(name: str) -> str:
    """Return the name of a record at the receiving end of a link."""
    return name.removesuffix(NEAR).strip()

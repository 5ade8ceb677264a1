"""Load claims files, built-in ones or a user's."""

from pathlib import Path

from pydantic import ValidationError

from skywright.core.bounded import LARGEST_TOML, parse_toml, read_text
from skywright.core.catalog import Entry
from skywright.errors import InputError, neighbours
from skywright.evidence.reproduce.spec import ClaimsFile

DATA = Path(__file__).parent / "claims"


def list_papers() -> list[str]:
    """Return the names of the papers with claims."""
    return sorted(p.stem for p in DATA.glob("*.toml"))


def list_claims() -> list[Entry]:
    """Return every claim as PAPER/CLAIM with its statement."""
    files = [load_claims(name) for name in list_papers()]
    return [Entry(f"{f.paper.id}/{c.id}", c.statement) for f in files for c in f.claims]


def load_claims(paper: str) -> ClaimsFile:
    """Load the claims of a paper: a name of `list_papers`, or a user's file.

    Raises InputError for an unknown name or an invalid file.
    """
    names = list_papers()
    path = DATA / f"{paper}.toml" if paper in names else Path(paper)
    if paper not in names and (path.suffix != ".toml" or not path.is_file()):
        raise InputError(f"unknown paper {paper!r}; valid: {neighbours(paper, names)}")
    label = f"claims of {paper}" if paper in names else str(path)
    tree = parse_toml(read_text(path, LARGEST_TOML, label=label), label)
    try:
        file = ClaimsFile.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{label}: {key}: {first['msg'].removeprefix('Value error, ')}") from None
    _check_measures(file, label)
    return file


def _check_measures(file: ClaimsFile, label: str) -> None:
    from skywright.evidence.reproduce.measures import MEASURES  # the import takes half a second

    for claim in file.claims:
        if claim.measure not in MEASURES:
            raise InputError(
                f"{label}: claim {claim.id!r}: unknown measure {claim.measure!r}; "
                f"valid: {neighbours(claim.measure, MEASURES)}"
            )

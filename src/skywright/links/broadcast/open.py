"""Opens the links of the options `--ros2` and `--foxglove`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.errors import naming_arguments
from skywright.links.broadcast.flight import LiveFlight
from skywright.links.broadcast.options import OPTIONS, Live

if TYPE_CHECKING:
    from skywright.description.loader import Description


@naming_arguments(**OPTIONS)
def open_live(options: Live, description: Description) -> LiveFlight:
    """Return the live link of a flight; raises InputError if it cannot be opened."""
    return LiveFlight(options.check(), description)

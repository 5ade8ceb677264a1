"""The loop of a flight under an autopilot, and its outcome."""

from __future__ import annotations

from collections.abc import Callable

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError, SimulationError
from skywright.links.sitl.plant import SitlPlant


class AutopilotFailed(SimulationError):
    """The autopilot stalled, disconnected, or is another program than expected."""


def fly_to_end(
    plant: SitlPlant, duration_s: float, step: Callable[[], str | None]
) -> tuple[str, str]:
    """Call `step` until the plant's time is `duration_s`, or until it returns the reason of an end.

    Returns the outcome (finished, aborted, diverged, interrupted) and its reason.
    """
    try:
        while plant.t < duration_s - 1e-9:
            check_interrupt()
            if (reason := step()) is not None:
                return "finished", reason
    except KeyboardInterrupt:
        return "finished", "ended by the user"
    except AutopilotFailed as error:
        return "aborted", str(error)
    except SimulationError as error:
        return "diverged", str(error)
    except InputError as error:  # the recording cannot be written: the disk is full
        return "interrupted", str(error)
    return "finished", "the duration is over"

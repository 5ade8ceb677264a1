"""A control link that is silent for so long that the motors' own controllers have stopped them."""

from __future__ import annotations

from skywright.core.spec import NonNegative
from skywright.models.capability import MOTOR_TIMEOUT_S
from skywright.run.faults._rule import Response
from skywright.run.faults.link_silent import LinkSilent


class LinkLost(LinkSilent):
    """Age of the newest inertial sample that came over the link, where nothing is left to do."""

    source = "the motors' controllers stop them after 0.5 s without a command"

    class Table(LinkSilent.Table):
        """Limit (s). A link that comes back starts no motors of a robot that falls."""

        limit: NonNegative = MOTOR_TIMEOUT_S
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

"""A control link that was silent until the motor controllers stopped the motors."""

from __future__ import annotations

from skywright.core.spec import NonNegative
from skywright.models.capability import MOTOR_TIMEOUT_S
from skywright.run.faults._rule import Response
from skywright.run.faults.link_silent import LinkSilent


class LinkLost(LinkSilent):
    """Age of the newest inertial sample over the link, beyond the time-out of the motors."""

    source = "the motor controllers stop the motors after 0.5 s without a command"
    overrides_pilot = True

    class Table(LinkSilent.Table):
        """Limit (s). If the link recovers, the motors of a falling robot are not restarted."""

        limit: NonNegative = MOTOR_TIMEOUT_S
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

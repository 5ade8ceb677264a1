"""The video that a page simulates for the operator: delay and rate of its pictures."""

from __future__ import annotations

from typing import Any

from skywright.description.world.radio import Radio
from skywright.links.radio import OVERHEAD


def describe_video(radio: Radio) -> dict[str, Any] | None:
    """Return delay (s) and rate (Hz) of a radio's pictures as plain JSON; None without a radio.

    Without a video (`video_kbps` 0) the operator sees the robot's states with the radio's delay at
    their rate (`rate_hz` None). Jitter and loss are omitted: the page shows means.
    """
    if not radio.present:
        return None
    if radio.video_kbps <= 0.0:
        return {"delay_s": radio.delay_s, "rate_hz": None}
    size = 125.0 * radio.video_kbps / radio.video_rate_hz + OVERHEAD
    sending = 0.0 if radio.bandwidth_kbps is None else 8e-3 * size / radio.bandwidth_kbps
    return {"delay_s": radio.delay_s + sending, "rate_hz": radio.video_rate_hz}

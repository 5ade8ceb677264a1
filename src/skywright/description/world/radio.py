"""The radio between operator and robot: `[world.radio]`."""

from __future__ import annotations

from pydantic import Field, model_validator

from skywright.core.spec import NonNegative, Positive, Spec


class Radio(Spec):
    """The radio between operator and robot, in each direction; all zero: no radio.

    Commands are sent before states, states before video.
    """

    # mean delay of a packet, in addition to its transmission time
    delay_s: float = Field(default=0.0, ge=0, le=5)
    jitter_s: float = Field(default=0.0, ge=0, le=1)  # standard deviation
    loss_fraction: float = Field(default=0.0, ge=0, lt=1)  # fraction of lost packets
    # in each direction; default: no limit, and no transmission time
    bandwidth_kbps: Positive | None = None
    # of the video to the operator; 0: states are shown instead of a video
    video_kbps: NonNegative = 0.0
    video_rate_hz: float = Field(default=25.0, ge=1, le=50)  # of its images

    @model_validator(mode="after")
    def _video_fits(self) -> Radio:
        if self.bandwidth_kbps is not None and self.video_kbps >= self.bandwidth_kbps:
            raise ValueError(
                f"video_kbps {self.video_kbps:g} must be below bandwidth_kbps "
                f"{self.bandwidth_kbps:g}"
            )
        return self

    @property
    def present(self) -> bool:
        """Whether there is a radio."""
        return self != Radio()

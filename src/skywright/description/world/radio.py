"""The radio between operator and robot: `[world.radio]`."""

from __future__ import annotations

from pydantic import Field, model_validator

from skywright.core.spec import NonNegative, Positive, Spec


class Radio(Spec):
    """The radio between operator and robot, each way; all zero: there is none in between.

    Commands are sent before states, states before video.
    """

    delay_s: float = Field(default=0.0, ge=0, le=5)  # mean of what a packet takes beyond its size
    jitter_s: float = Field(default=0.0, ge=0, le=1)  # standard deviation
    loss_fraction: float = Field(default=0.0, ge=0, lt=1)  # of packets
    bandwidth_kbps: Positive | None = None  # each way; without it size costs no time
    # of the video to the operator; 0: states are shown instead of a video
    video_kbps: NonNegative = 0.0
    video_rate_hz: float = Field(default=25.0, ge=1, le=50)  # of its pictures

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
        """Whether there is a radio at all."""
        return self != Radio()

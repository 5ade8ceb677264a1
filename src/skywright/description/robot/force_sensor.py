"""Keys of a force sensor in the probe's slider: `[robot.force_sensor]`.

A compression spring and a linear potentiometer, read by an analog-to-digital converter. Its
calibration consists of two straight pieces over the count (Sanchez-Cuevas et al. 2020, Table 3).
"""

from __future__ import annotations

from pydantic import Field, model_validator

from skywright.core.spec import NonNegative, Positive, Spec


class ForceSensor(Spec):
    """Force = offset + slope * count; `hard` below `limit_count`, `soft` from there on.

    The count falls while the spring is compressed, so both slopes are negative and a hard press has
    low counts.
    """

    hard_slope_n_per_count: float = Field(lt=0)
    hard_offset_n: Positive
    soft_slope_n_per_count: float = Field(lt=0)
    soft_offset_n: Positive
    limit_count: int = Field(ge=1)
    adc_bits: int = Field(default=12, ge=4, le=24)
    stroke_m: Positive  # of the potentiometer over the converter's whole range
    noise_count: NonNegative = 0.0  # 1 sigma

    @model_validator(mode="after")
    def _is_one_curve(self) -> ForceSensor:
        top = 2**self.adc_bits - 1
        if self.limit_count >= top:
            raise ValueError(f"limit_count {self.limit_count} must be below {top} (adc_bits)")
        at = self.limit_count
        hard = self.hard_offset_n + self.hard_slope_n_per_count * at
        soft = self.soft_offset_n + self.soft_slope_n_per_count * at
        step = max(abs(self.hard_slope_n_per_count), abs(self.soft_slope_n_per_count))
        if abs(hard - soft) > step:
            raise ValueError(
                f"the two pieces give {hard:.3f} and {soft:.3f} N at limit_count {at}: they must "
                f"meet there within one count ({step:.4f} N)"
            )
        if soft <= 0.0:
            raise ValueError(f"the force at limit_count {at} is {soft:.3f} N; it must be above 0")
        return self

    @property
    def knee_n(self) -> float:
        """Force where the pieces meet."""
        return self.soft_offset_n + self.soft_slope_n_per_count * self.limit_count

    @property
    def hard_share(self) -> float:
        """Ratio of the spring's stiffness beyond the knee to that before it."""
        return self.hard_slope_n_per_count / self.soft_slope_n_per_count

    @property
    def stiffness_n_per_m(self) -> float:
        """Stiffness of the spring in the soft piece, which the potentiometer's stroke implies."""
        return -self.soft_slope_n_per_count * 2**self.adc_bits / self.stroke_m

"""Figures of the kind "arm-test-bench"."""

from skywright.missions.bridge_contact.figures import FIGURES

__all__ = ["FIGURES"]

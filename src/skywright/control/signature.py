"""The one compiled signature of a control law: void(BELIEF*), as of all that works on a belief."""

from __future__ import annotations

from skywright.core.signature import BELIEF_TYPE
from skywright.core.signature import ON_BELIEF as LAW

__all__ = ["BELIEF_TYPE", "LAW"]

"""A search for cracks is flown as a scan: touch, slide along the passes, come back."""

from __future__ import annotations

from typing import Any, cast

from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.fly import fly as fly_scan
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor


def fly(s: Supervisor[CrackScan], way: CrackWay) -> Flight:
    """Fly the phases between take-off and landing."""
    return fly_scan(cast(Any, s), way.scan)

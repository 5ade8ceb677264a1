"""An excitation flight: motions from which `skywright identify` estimates a robot's parameters."""

from skywright.missions.excitation.task import ExcitationTask
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

REST_S = 1.0  # s, after each motion


def fly(s: Supervisor[ExcitationTask], way: None) -> Flight:
    for name, table in s.segments.items():
        s.follow(name, table)
        s.begin(f"rest after {name}")
        s.wait(REST_S)
    return Flight(True, "")

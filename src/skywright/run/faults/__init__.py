"""Responses of the robot to faults: one file a rule, `[mission.faults.NAME]`.

A rule monitors a value that is available on board (never the simulator's truth). If the value
exceeds its limit for the hold time, the mission ends and the rule's response is flown until the
robot is down. The author of a rule imports `Rule` and `Response`.
"""

from skywright.run.faults._rule import Response as Response
from skywright.run.faults._rule import Rule as Rule

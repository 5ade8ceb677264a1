"""What the robot does where something goes wrong: one file a rule, `[mission.faults.NAME]`.

A rule watches what the robot knows (never the simulator's truth). Where its value stays beyond its
limit for its hold time, the mission ends and the rule's response is flown until the robot is down.
The author of a rule imports `Rule` and `Response`.
"""

from skywright.run.faults._rule import Response as Response
from skywright.run.faults._rule import Rule as Rule

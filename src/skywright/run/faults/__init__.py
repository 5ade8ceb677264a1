"""What the robot does where something goes wrong: one file a rule, `[mission.faults.NAME]`.

A rule watches what the robot knows (never the simulator's truth). Where its value stays beyond its
limit for its hold time, the mission ends and the rule's response is flown until the robot is down.
"""

"""What a mission of the kind "follow-plan" may say."""

from skywright.description.mission.spec import Task


class FollowPlan(Task):
    """Fly a plan file as it is; the flight starts over its first row."""

    plan_file: str = ""  # plan file (NAME.csv or NAME.toml): docs/howto/plan-a-transport.md

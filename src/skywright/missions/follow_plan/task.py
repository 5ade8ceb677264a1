"""Keys of a mission of the kind "follow-plan"."""

from skywright.description.mission.spec import Task


class FollowPlan(Task):
    """Fly a plan file unchanged; the flight starts above its first row."""

    plan_file: str = ""  # plan file (NAME.csv or NAME.toml): docs/howto/plan-a-transport.md

"""Keys of a mission of the kind "follow-plan"."""

from pathlib import Path

from skywright.description.mission.spec import Task
from skywright.planning.motion.plan_file import name_files


class FollowPlan(Task):
    """Fly a plan file unchanged; the flight starts above its first row."""

    plan_file: str = ""  # plan file (NAME.csv or NAME.toml): docs/howto/plan-a-transport.md

    def list_files(self) -> tuple[Path, ...]:
        """Return the two files of the plan."""
        return name_files(self.plan_file) if self.plan_file else ()

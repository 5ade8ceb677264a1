"""Write the tables of docs/howto/ros2.md from the code that publishes and listens.

python docs/generate_ros2.py     (a test holds the page equal to them)
"""

from __future__ import annotations

from pathlib import Path

from skywright.links.broadcast.present import build_tables

PAGE = Path(__file__).parent / "howto" / "ros2.md"


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    for name, table in build_tables().items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        head, rest = text.split(begin)
        text = head + begin + "\n" + table + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text("utf-8")), encoding="utf-8")

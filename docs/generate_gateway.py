"""Write the tables of docs/howto/gateway.md and the files in examples/gateway from the packets.

python docs/generate_gateway.py     (a test holds page and files equal to them)
"""

from __future__ import annotations

from pathlib import Path

from skywright.links.udp.generate import build_c_header, build_matlab, build_tables

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "howto" / "gateway.md"


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    for name, table in build_tables().items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        head, rest = text.split(begin)
        text = head + begin + "\n" + table + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text("utf-8")), encoding="utf-8")
    folder = ROOT / "examples" / "gateway"
    (folder / "skywright_packets.h").write_text(build_c_header(), encoding="utf-8")
    (folder / "skywright_packets.m").write_text(build_matlab(), encoding="utf-8")

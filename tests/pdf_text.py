"""The text of a PDF that Chromium printed."""

from __future__ import annotations

import re
import unicodedata
import zlib


def read_pdf_text(data: bytes) -> str:
    """Return the text in the order in which it is drawn.

    Chromium writes numbers of glyphs; the table /ToUnicode of each font states their characters.
    """
    streams = dict[bytes, bytes]()
    for found in re.finditer(rb"(\d+) 0 obj\n<<([^>]*)>>\s*stream\r?\n", data):
        length = re.search(rb"/Length (\d+)", found[2])
        assert length is not None
        body = data[found.end() : found.end() + int(length[1])]
        streams[found[1]] = zlib.decompress(body) if b"/FlateDecode" in found[2] else body
    fonts = {
        name: _read_characters(streams[table])
        for name, number in re.findall(rb"/(F\d+) (\d+) 0 R", data)
        for table in re.findall(rb"\n%b 0 obj\n[^>]*/ToUnicode (\d+) 0 R" % number, data)
    }
    said, characters = list[str](), dict[int, str]()
    for body in streams.values():
        for font, glyphs, end in re.findall(rb"/(F\d+) \S+ Tf|<(\w+)> Tj|(\bET)\b", body):
            characters = fonts[font] if font else characters
            numbers = [int(glyphs[i : i + 4], 16) for i in range(0, len(glyphs), 4)]
            said += [characters.get(n, "?") for n in numbers] + [" "] * bool(end)
    text = unicodedata.normalize("NFKC", "".join(said))  # no ligatures
    return " ".join(text.split())


def _read_characters(table: bytes) -> dict[int, str]:
    """Return the characters of a font by the number of their glyph."""
    found = dict[int, str]()
    for kind, inside in re.findall(rb"beginbf(char|range)(.*?)endbf", table, re.DOTALL):
        for line in inside.split(b"\n"):
            words = re.findall(rb"<(\w+)>", line)
            if not words:
                continue
            first, last = int(words[0], 16), int(words[-2 if kind == b"range" else 0], 16)
            text = bytes.fromhex(words[-1].decode()).decode("utf-16-be")
            for n in range(first, last + 1):
                found[n] = text[:-1] + chr(ord(text[-1]) + n - first)
    return found

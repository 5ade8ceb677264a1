"""mkdocs hook: nothing is fetched from elsewhere.

The theme's offline plug-in asks a content network for the script that lets the search run from
disk. Ours, docs/javascripts/worker-from-disk.js, takes its place.
"""

from __future__ import annotations

from typing import Any

from mkdocs.utils import get_relative_url

ELSEWHERE = "https://unpkg.com/iframe-worker/shim"
OURS = "javascripts/worker-from-disk.js"


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Point a page at our script."""
    return output.replace(ELSEWHERE, get_relative_url(OURS, page.url))


def on_post_template(output: str, *, template_name: str, config: Any) -> str:
    """The same for 404.html."""
    return output.replace(ELSEWHERE, OURS)

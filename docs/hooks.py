"""mkdocs hook: nothing is fetched from elsewhere, or the build fails.

The theme's offline plug-in asks a content network for the script that lets the search run from
disk. Ours, docs/javascripts/worker-from-disk.js, takes its place.
"""

from __future__ import annotations

import re
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.utils import get_relative_url

ELSEWHERE = "https://unpkg.com/iframe-worker/shim"
OURS = "javascripts/worker-from-disk.js"
FETCHED = re.compile(r'<(?:script|img|iframe)\b[^>]*\bsrc="(?:https?:)?//|<link\b[^>]*"https?://')


def _localise(html: str, path: str, name: str) -> str:
    html = html.replace(ELSEWHERE, path)
    found = FETCHED.search(html)
    if found:
        raise PluginError(f"{name} fetches something from elsewhere: {found.group()}")
    return html


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Point a page at our script."""
    return _localise(output, get_relative_url(OURS, page.url), page.url)


def on_post_template(output: str, *, template_name: str, config: Any) -> str:
    """The same for 404.html."""
    return _localise(output, OURS, template_name) if template_name.endswith(".html") else output

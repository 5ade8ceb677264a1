"""Access control of the ground station: a layer around the whole application.

HTTP requests and web sockets pass the same checks: the Host must be on a list (this excludes
foreign names that resolve to this address), the Origin of a web socket and of a request from a page
must be the station's own, and a cookie must prove that the browser entered with a token. A token is
used once. A refused request gets 403 and is counted.
"""

from __future__ import annotations

import re
import secrets
import time
from collections import Counter
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from starlette.responses import HTMLResponse, PlainTextResponse

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

INVITED_S = 600.0
"""s of validity of an invitation's token; the first one, on the terminal, is valid until used."""
MOST_SESSIONS = 100
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""Policy of the station's own pages: one script, from this station."""
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Policy of a run's pages, which contain their scripts: no access to the station."""
ENTER = """<!doctype html><meta charset="utf-8"><title>Skywright</title>
<meta http-equiv="refresh" content="0;url=/"><p><a href="/">Ground station</a></p>"""
"""A page instead of a redirect: browsers send no strict cookie after a navigation from another
site."""


class Guard:
    """The layer around the application `app`."""

    def __init__(self, app: App, names: set[str], port: int, *, secure: bool = False) -> None:
        """`names` are the host names of the station, without port."""
        self.app, self.port, self.secure = app, port, secure
        scheme = "https" if secure else "http"
        usual = 443 if secure else 80
        self.hosts = {f"{name}:{port}" for name in names} | (names if port == usual else set())
        self.origins = {f"{scheme}://{host}" for host in self.hosts}
        self.cookie = f"skywright_{port}"  # all ports of a host share its cookies
        self.refused: Counter[str] = Counter()
        self._tokens: dict[str, float] = {}  # time of expiry (s, monotonic)
        self._sessions: dict[str, None] = {}

    def invite(self, good_s: float = INVITED_S) -> str:
        """Return the path of a new one-time entrance, valid for `good_s` (s)."""
        now = time.monotonic()
        self._tokens = {t: end for t, end in self._tokens.items() if end > now}
        token = secrets.token_urlsafe(24)
        self._tokens[token] = now + good_s
        return f"/enter?t={token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = _read_headers(scope)
        why = self._judge(scope, headers)
        if why:
            self.refused[why] += 1
            await _refuse(scope, receive, send)
        elif scope["path"] == "/enter":
            await self._enter(scope, receive, send)
        else:
            await self.app(scope, receive, _add_headers(send))

    def _judge(self, scope: Scope, headers: dict[str, list[str]]) -> str:
        """Return why a request is refused, or ""."""
        host, origin = headers.get("host", []), headers.get("origin", [])
        if len(host) != 1 or host[0].lower() not in self.hosts:
            return "host"
        if scope["type"] == "websocket" and len(origin) != 1:
            return "origin"
        if any(o.lower() not in self.origins for o in origin):
            return "origin"
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            return "method"
        if scope["path"] == "/enter" and scope["type"] == "http":
            return ""
        cookie = re.findall(
            rf"(?:^|;\s*){self.cookie}=([\w-]{{10,64}})(?:;|$)",
            "; ".join(headers.get("cookie", [])),
        )
        return "" if any(c in self._sessions for c in cookie) else "cookie"

    async def _enter(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Exchange a token for a cookie; the token becomes invalid."""
        found = re.fullmatch(rb"t=([\w-]{10,64})", scope["query_string"])
        end = (
            self._tokens.pop(found[1].decode(), 0.0) if found and scope["method"] == "GET" else 0.0
        )
        if end <= time.monotonic():
            self.refused["token"] += 1
            await _refuse(scope, receive, send)
            return
        session = secrets.token_urlsafe(24)
        self._sessions[session] = None
        while len(self._sessions) > MOST_SESSIONS:  # the oldest session ends
            self._sessions.pop(next(iter(self._sessions)))
        answer = HTMLResponse(ENTER)
        answer.set_cookie(
            self.cookie, session, httponly=True, samesite="strict", path="/", secure=self.secure
        )
        await answer(scope, receive, _add_headers(send))


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})  # before it is accepted: 403
        return
    text = (
        "Refused. Open the address that the ground station printed; it can be used once. "
        "Another browser needs an invitation from the page.\n"
    )
    await PlainTextResponse(text, 403)(scope, receive, _add_headers(send))


def _read_headers(scope: Scope) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        out.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return out


def _add_headers(send: Send) -> Send:
    async def add(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message["headers"]}
            more = {
                b"content-security-policy": PAGE_POLICY.encode(),
                b"x-content-type-options": b"nosniff",
                b"referrer-policy": b"no-referrer",
                b"cache-control": b"no-store",
                b"cross-origin-opener-policy": b"same-origin",
                b"cross-origin-resource-policy": b"same-origin",
            }
            message["headers"] = [
                *message["headers"], *((k, v) for k, v in more.items() if k not in given),
            ]  # fmt: skip
        await send(message)

    return add

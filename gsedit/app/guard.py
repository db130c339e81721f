"""Who may reach a page: whoever has the address with the token, and the page itself."""

from __future__ import annotations

import gzip
import hmac
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from gsedit.pictures.viewer.libraries import LOOPBACK, refusal

COOKIE_LETTERS = 6
"""Letters of the token in the name of the cookie: a browser does not part cookies by port, and
several pages may be open."""
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob: data:; connect-src 'self' blob: data: ws://HOST; "
    "frame-ancestors 'none'"
)
"""Sources that the browser may load for the page, and may connect to: nothing of another host."""
NO_ADDRESS = "the page is reached by the address that gsedit app printed, with its token"


@dataclass(frozen=True)
class Guard:
    """Answers or refuses the requests of a page's server."""

    token: str
    page: bytes
    """The HTML of the page."""
    hosts: frozenset[str] = LOOPBACK
    """Names of this machine by which the page may be reached."""

    @property
    def cookie(self) -> str:
        """Name of the cookie that carries the token after the first request."""
        return f"gsedit-{self.token[:COOKIE_LETTERS]}"

    def answer(self, connection: Any, request: Any) -> Any:
        """A response, or None where viser's server goes on with the request."""
        reason = self.refused(request.path, request.headers)
        if reason:
            return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
        if "websocket" in request.headers.get("Upgrade", "").lower():
            return None
        if urlsplit(request.path).path not in ("/", "/index.html"):
            return connection.respond(HTTPStatus.NOT_FOUND, "there is one page here\n")
        return self._page(request.headers)

    def refused(self, path: str, headers: Any) -> str:
        """Say why a request is refused, by its path and HTTP headers; empty where it is not."""
        if reason := refusal(headers, self.hosts):
            return reason
        given = parse_qs(urlsplit(path).query).get("token", [])
        allowed = [*given, *values_of(self.cookie, headers.get_all("Cookie"))]
        if any(_same(each, self.token) for each in allowed):
            return ""
        return NO_ADDRESS

    def _page(self, headers: Any) -> Any:
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        packed = "gzip" in headers.get("Accept-Encoding", "")
        body = gzip.compress(self.page, 1) if packed else self.page
        fields = Headers(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Length": str(len(body)),
                "Content-Security-Policy": POLICY.replace("HOST", headers["Host"]),
                "Cache-Control": "no-store",
                "Referrer-Policy": "no-referrer",
                "Set-Cookie": f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/",
            }
        )
        if packed:
            fields["Content-Encoding"] = "gzip"
        return Response(HTTPStatus.OK.value, "OK", fields, body)


def values_of(name: str, lines: Sequence[str]) -> list[str]:
    """The values of a cookie in Cookie headers."""
    found = []
    for line in lines:
        try:
            jar = SimpleCookie(line)
        except CookieError:
            continue
        if name in jar:
            found.append(jar[name].value)
    return found


def _same(given: str, token: str) -> bool:
    """Whether two texts are equal, in a time that does not tell where they differ."""
    return hmac.compare_digest(given.encode(errors="replace"), token.encode())

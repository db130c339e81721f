"""The page's server: viser behind a guard, with our picture for a background and our panels.

The page is reached by whoever has its address with the token, and by the page itself.
"""

from __future__ import annotations

import gzip
import hmac
import logging
import re
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from gsedit.app.opening import TAKEN
from gsedit.app.page import Page
from gsedit.app.panels import add_panels
from gsedit.app.tab import Tab
from gsedit.pictures.viewer.libraries import LOOPBACK, guarded, import_viser, refusal

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
        token = self.token.encode()  # compared in a time that does not tell where texts differ
        if any(hmac.compare_digest(each.encode(errors="replace"), token) for each in allowed):
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


BRAND = (40, 110, 200)
TITLE = "gsedit"
_SCRIPT, _STYLE = (Path(__file__).with_name(f"page.{kind}") for kind in ("js", "css"))


@dataclass(frozen=True)
class Served:
    """A page that answers."""

    server: Any
    address: str
    """With the token: whoever has it reaches the page."""
    port: int


@contextmanager
def serve(page: Page, host: str = "127.0.0.1", port: int = 8080) -> Iterator[Served]:
    """Serve a page, at the next free port where that one is taken, until the context ends.

    Raises GseditError where viser is missing.
    """
    viser = import_viser()
    token = secrets.token_urlsafe(24)
    hosts = LOOPBACK if host in LOOPBACK else LOOPBACK | {host, *_names(host)}
    guard = Guard(token, html(viser), frozenset(hosts))
    # connections that a browser opens and does not use are told with a traceback each
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with redirect_stdout(StringIO()), guarded(guard.answer):  # it says where it listens, in a box
        server = viser.ViserServer(host=host, port=port, label=TITLE, verbose=False)
    _keep_inside(server)
    _dress(server)
    try:
        tabs: dict[int, Tab] = {}
        server.on_client_connect(partial(_opened, page, tabs))
        server.on_client_disconnect(partial(_closed, page, tabs))
        found = server.get_port()
        shown = "127.0.0.1" if host in ("0.0.0.0", *LOOPBACK) else host
        yield Served(server, f"http://{shown}:{found}/?token={token}", found)
    finally:
        for tab in list(page.tabs):
            page.part(tab)
        with redirect_stdout(StringIO()):  # "Server stopped"
            server.stop()


def html(viser: Any) -> bytes:
    """The page of viser's client, with a title, and our script and style."""
    file = Path(viser.__file__).parent / "client" / "build" / "index.html"
    text = file.read_text(encoding="utf-8")
    text = text.replace("<title>Viser</title>", f"<title>{TITLE}</title>", 1)
    script = _SCRIPT.read_text(encoding="utf-8")
    known = "|".join(re.escape(each.lstrip(".")) for each in TAKEN)
    script = script.replace("SUFFIXES", known, 1)
    style = _STYLE.read_text(encoding="utf-8")
    added = f"<script>{script}</script>\n<style>{style}</style>"
    return text.replace("<head>", f"<head>\n{added}", 1).encode()


def _keep_inside(server: Any) -> None:
    """Take away the request by which a page asks viser to share it through viser's own host."""
    from viser import _messages

    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)


def _dress(server: Any) -> None:
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, brand_color=BRAND,
        control_width="large",
    )  # fmt: skip
    server.gui.main_panel.dock_right()  # beside the picture, not over it
    server.scene.world_axes.visible = False


def _opened(page: Page, tabs: dict[int, Tab], client: Any) -> None:
    tab = tabs[client.client_id] = Tab(page, client)
    page.join(tab)
    tab.start()  # the picture first
    add_panels(page, tab)


def _closed(page: Page, tabs: dict[int, Tab], client: Any) -> None:
    tab = tabs.pop(client.client_id, None)
    if tab is not None:
        page.part(tab)


def _names(host: str) -> set[str]:
    """This machine's own names, where it listens on all of its addresses."""
    import socket

    if host != "0.0.0.0":
        return set()
    name = socket.gethostname()
    try:
        return {name, *socket.gethostbyname_ex(name)[2]}
    except OSError:
        return {name}

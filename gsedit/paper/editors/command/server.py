"""One server over HTTP: requests, forms, and errors in one line. Loads no torch."""

from __future__ import annotations

import base64
import binascii
import ipaddress
import json
import os
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any
from uuid import uuid4

from gsedit.errors import GseditError, UsageError

KEY = "GSEDIT_API_KEY"
LARGEST_REPLY = 64_000_000  # bytes: an edited picture takes a few million
QUOTED = 100  # characters of a reply in a message


class _Stay(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *args: Any, **kwargs: Any) -> None:
        """None: the answer stays an error."""


@dataclass(frozen=True)
class Server:
    """A server at a URL, asked with a time limit. Its methods raise GseditError in one line."""

    url: str
    timeout: float
    """Seconds for a whole answer."""

    def post(self, path: str, data: bytes, kind: str) -> Any:
        """The JSON of the reply to `data` of that content type."""
        return self._json(self._ask(path, data, {"Content-Type": kind}))

    def get(self, path: str) -> Any:
        """The JSON at a path."""
        return self._json(self._ask(path))

    def file(self, path: str) -> bytes:
        """The contents at a path."""
        return self._ask(path)

    def _ask(
        self, path: str, data: bytes | None = None, headers: Mapping[str, str] | None = None
    ) -> bytes:
        deadline = time.monotonic() + self.timeout
        request = urllib.request.Request(self.url + path, data, dict(headers or {}))
        if key := key_of_user():
            request.add_header("Authorization", f"Bearer {key}")
        try:
            with self._opener().open(request, timeout=self.timeout) as reply:
                found = _read_until(reply, deadline)
        except urllib.error.HTTPError as error:
            raise GseditError(
                f"{request.full_url} answered {error.code} ({quoted(error.read(2000))}): does the "
                "server have the model, and is it the server that was named?"
            ) from None
        except TimeoutError:
            raise self.late() from None
        except (urllib.error.URLError, HTTPException, OSError) as error:
            reason = getattr(error, "reason", error)
            if isinstance(reason, TimeoutError):
                raise self.late() from None
            raise GseditError(
                f"{request.full_url} cannot be reached ({reason}): start the server, or correct "
                "the URL"
            ) from None
        if len(found) > LARGEST_REPLY:
            raise GseditError(f"{request.full_url} answered more than 64 MB: is it the right URL?")
        return found

    def late(self) -> GseditError:
        """The error of an answer that does not come."""
        return GseditError(
            f"{self.url} did not answer in {self.timeout:g} s: raise --timeout, or make the "
            "pictures smaller with --size"
        )

    def _opener(self) -> urllib.request.OpenerDirector:
        """Follows no redirection, which could take a key elsewhere; no proxy to this machine."""
        host = urllib.parse.urlsplit(self.url).hostname or ""
        proxies = [urllib.request.ProxyHandler({})] if is_here(host) else []
        return urllib.request.build_opener(_Stay, *proxies)

    def _json(self, found: bytes) -> Any:
        try:
            return json.loads(found)
        except ValueError:
            raise GseditError(
                f"{self.url} answered {quoted(found)}, which is not JSON: is it the server that "
                "was named?"
            ) from None


def _read_until(reply: Any, deadline: float) -> bytes:
    """The body of a reply, of at most one byte more than LARGEST_REPLY.

    The timeout of a connection is for each piece: a server that sends a byte now and then would
    never run into it. Raises TimeoutError after the deadline.
    """
    found = bytearray()
    while len(found) <= LARGEST_REPLY and (piece := reply.read1(1 << 16)):
        found += piece
        if time.monotonic() > deadline:
            raise TimeoutError
    return bytes(found)


def key_of_user() -> str:
    """The key in the environment, empty where there is none. Raises UsageError, which does not
    show it, for one that no header can hold."""
    key = os.environ.get(KEY, "").strip()
    if not (key.isascii() and key.isprintable()):
        raise UsageError(f"{KEY} holds characters that no key has: set it again, on one line")
    return key


def is_here(host: str) -> bool:
    """Whether a host name or address is this machine's loopback."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def part_of(server: Server, answer: Any, *keys: str | int) -> Any:
    """A part of a JSON answer. Raises GseditError where it is missing."""
    part = answer
    for key in keys:
        try:
            part = part[key]
        except (KeyError, IndexError, TypeError):
            raise GseditError(
                f"{server.url} answered {quoted(json.dumps(answer).encode())} without {key!r}: is "
                "it the server that was named?"
            ) from None
    return part


def picture_of(server: Server, text: Any) -> bytes:
    """The file in a base 64 string of an answer. Raises GseditError."""
    try:
        return base64.b64decode(str(text).rpartition(",")[2], validate=True)
    except (binascii.Error, ValueError):
        raise GseditError(f"{server.url} answered a picture that is not in base 64") from None


def quoted(found: bytes) -> str:
    """The beginning of an answer, on one line, for a message."""
    text = " ".join(found.decode("utf-8", "replace").split())
    return repr(text[:QUOTED] + ("..." if len(text) > QUOTED else ""))


def form(
    fields: Mapping[str, Any], files: Mapping[str, bytes], name: str = "view.png"
) -> tuple[bytes, str]:
    """(body, content type) of a form with PNG files (multipart/form-data, RFC 7578).

    Values that are no text are written as JSON: true, not True.
    """
    line = uuid4().hex
    body = b""
    for key, value in fields.items():
        head = f'--{line}\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n'
        text = value if isinstance(value, str) else json.dumps(value)
        body += head.encode() + text.encode() + b"\r\n"
    for key, file in files.items():
        head = (
            f'--{line}\r\nContent-Disposition: form-data; name="{key}"; filename="{name}"\r\n'
            "Content-Type: image/png\r\n\r\n"
        )
        body += head.encode() + file + b"\r\n"
    return body + f"--{line}--\r\n".encode(), f"multipart/form-data; boundary={line}"

"""A hub of models on this machine, for tests: it serves folders, and counts the bytes it sends."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

COMMIT = "a" * 40


class SmallHub(ThreadingHTTPServer):
    """Serves every folder OWNER/NAME below a root as the hub of Hugging Face does."""

    daemon_threads = True

    def __init__(self, root: Path, licence: str = "mit") -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.root, self.licence = root, licence
        self.sent = 0
        self.fetched: list[str] = []
        """Names of the files whose contents were sent."""
        self.revisions: set[str] = set()
        """Branches, tags or commits that were asked for."""

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: SmallHub

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        path = self.path.partition("?")[0].strip("/")
        if path.startswith("api/models/"):
            self._describe(*path.split("/")[2:4], rest=path.split("/")[4:])
        elif path.count("/") < 4:
            self._send(404, b"", {})
        else:
            owner, name, _, revision, file = path.split("/", 4)  # the third is "resolve"
            self.server.revisions.add(revision)
            self._file(self.server.root / owner / name / file)

    def _describe(self, owner: str, name: str, rest: list[str]) -> None:
        folder = self.server.root / owner / name
        if not folder.is_dir():
            self._send(404, b"{}", {"X-Error-Code": "RepoNotFound"})
            return
        files = sorted(each for each in folder.rglob("*") if each.is_file())
        named = {each.relative_to(folder).as_posix(): each.stat().st_size for each in files}
        if rest[:1] == ["tree"]:
            oid = {"type": "file", "oid": "0" * 40}
            body = [{"path": file, "size": size} | oid for file, size in named.items()]
        else:
            body = {
                "id": f"{owner}/{name}",
                "sha": COMMIT,
                "cardData": {"license": self.server.licence},
                "siblings": [{"rfilename": file, "size": size} for file, size in named.items()],
            }
        self._send(200, json.dumps(body).encode(), {"Content-Type": "application/json"})

    def _file(self, path: Path) -> None:
        if not path.is_file():
            self._send(404, b"", {"X-Error-Code": "EntryNotFound"})
            return
        data = path.read_bytes()
        tag = f'"{hashlib.sha256(data).hexdigest()}"'
        if self.command == "GET":
            self.server.fetched.append(path.name)
        self._send(200, data, {"ETag": tag, "X-Repo-Commit": COMMIT})

    def _send(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in (headers | {"Content-Length": str(len(body))}).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command == "GET":
            self.server.sent += len(body)
            self.wfile.write(body)


@contextmanager
def small_hub(root: Path, **options: str) -> Iterator[SmallHub]:
    """A hub that serves while the context lasts."""
    with SmallHub(root, **options) as hub:
        thread = threading.Thread(target=hub.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield hub
        finally:
            hub.shutdown()
            thread.join()

"""A language model of the user's reads a sentence: good answers, and all kinds of bad ones."""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from gsedit.errors import UsageError
from gsedit.words.instruction import Change
from gsedit.words.model import changes_by_model
from gsedit.words.read import read_instruction

GOLD = {"target": "subject", "kind": "material", "name": "gold", "phrase": "the vase"}


@pytest.fixture
def serve():
    """A function that serves one answer, and gives the address and what was asked."""
    servers = []

    def start(content: str | bytes, wait: float = 0.0):
        asked: list[dict] = []

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                length = int(self.headers["Content-Length"])
                asked.append({"path": self.path, **json.loads(self.rfile.read(length))})
                time.sleep(wait)
                body = content if isinstance(content, bytes) else json.dumps(
                    {"choices": [{"message": {"content": content}}]}
                ).encode()  # fmt: skip
                self.send_response(200)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *args):
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}", asked

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize("end", ["", "/", "/v1", "/v1/chat/completions"])
def test_changes_of_a_model_are_those_of_the_sentence(serve, end):
    url, asked = serve(json.dumps({"changes": [GOLD]}))
    text = changes_by_model("gild the vase", url + end)
    (change,) = read_instruction(text).changes
    assert change == Change("subject", "material", "gold", None, None, "material", "the vase")
    (request,) = asked
    assert request["path"] == "/v1/chat/completions"
    assert request["messages"][1]["content"] == "gild the vase"
    assert "gold" in request["messages"][0]["content"]


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("I would gild it!", "no JSON"), ("", "no JSON"), ('{"changes": []}', "no list"),
        (json.dumps({"changes": [{**GOLD, "kind": "magic"}]}), "magic"),
        (b"<html>", "no answer"), (b'{"choices": []}', "no answer"), (b"[1]", "no answer"),
    ],
)  # fmt: skip
def test_an_answer_that_is_no_change_is_told(serve, answer, told):
    url, _ = serve(answer)
    with pytest.raises(UsageError, match=told):
        changes_by_model("gild the vase", url)


def test_a_model_that_loses_what_stays_is_stopped(serve):
    url, _ = serve(json.dumps({"changes": [GOLD]}))
    with pytest.raises(UsageError, match="keep"):
        changes_by_model("gild the vase, keep the handle", url)


def test_a_model_that_hangs_or_is_not_there_is_told(serve):
    url, _ = serve("{}", wait=2.0)
    with pytest.raises(UsageError, match="timed out"):
        changes_by_model("gild the vase", url, seconds=0.2)
    for address in ("http://127.0.0.1:9", "ftp://x", "file:///etc/passwd", "nonsense"):
        with pytest.raises(UsageError, match="leave --reader out"):
            changes_by_model("gild the vase", address, seconds=1.0)

"""The program that sends pictures to a server: each protocol against a stand-in that speaks it."""

import base64
import io
import json
import re
import threading
import time
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import pytest
from PIL import Image, ImageOps

from gsedit.paper.editors.command.http import main

SIZE = (48, 32)
WORKFLOW = {
    "1": {"class_type": "LoadImage", "inputs": {"image": "{image}"}},
    "2": {"class_type": "Edit", "inputs": {"text": "{prompt}, please", "seed": "{seed}"}},
    "3": {"class_type": "SaveImage", "inputs": {"images": ["2", 0]}},
}


def png(image):
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def inverted(file):
    return png(ImageOps.invert(Image.open(io.BytesIO(file)).convert("RGB")))


def parts(body, kind):
    """The fields and files of a multipart form."""
    line = re.search("boundary=(.+)", kind)[1].encode()
    found = {}
    for part in body.split(b"--" + line)[1:-1]:
        head, _, content = part.removesuffix(b"\r\n").partition(b"\r\n\r\n")
        found[re.search(b' name="([^"]+)"', head)[1].decode()] = content
    return found


class StandIn(BaseHTTPRequestHandler):
    """Speaks all protocols; edits by inverting. `answer` overrules every answer."""

    answer = None

    def log_message(self, *words):
        pass

    def reply(self, content, kind="application/json", code=200):
        if not isinstance(content, bytes):
            content = json.dumps(content).encode()
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.end_headers()
        self.wfile.write(content)

    def do_GET(self):
        path = urlsplit(self.path)
        calls, query = self.server.calls, parse_qs(path.query)
        if path.path.startswith("/history/"):
            calls.append(("history", None))
            if calls.count(("history", None)) < 2:
                return self.reply({})
            picture = {"filename": "out.png", "subfolder": "", "type": "output"}
            return self.reply({"7": {"outputs": {"3": {"images": [picture]}}, "status": {}}})
        assert (path.path, query["filename"]) == ("/view", ["out.png"])
        return self.reply(inverted(self.server.upload), "image/png")

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        kind, seen = self.headers["Content-Type"], self.server.asked
        self.server.calls.append((self.path, self.headers.get("Authorization")))
        if self.server.answer is not None:
            return self.server.answer(self)
        if self.path == "/upload/image":
            self.server.upload = parts(body, kind)["image"]
            return self.reply({"name": "in.png", "subfolder": "", "type": "input"})
        if self.path == "/prompt":
            seen.append(json.loads(body)["prompt"])
            return self.reply({"prompt_id": "7", "node_errors": {}})
        if self.path == "/api/generate":
            asked = json.loads(body)
            seen.append(asked)
            edited = inverted(base64.b64decode(asked["init_image"]))
            return self.reply({"latency": 1, "images": [base64.b64encode(edited).decode()]})
        form = parts(body, kind)
        seen.append(form)
        edited = base64.b64encode(inverted(form["image"])).decode()
        return self.reply({"data": [{"b64_json": edited}]})


@contextmanager
def serving(answer=None):
    server = ThreadingHTTPServer(("127.0.0.1", 0), StandIn)
    server.calls, server.asked, server.answer, server.upload = [], [], answer, b""
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    try:
        yield server, f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@pytest.fixture
def folders(tmp_path):
    for name in ("input", "output", "masks"):
        (tmp_path / name).mkdir()
    for i in range(2):
        Image.new("RGB", SIZE, (10, 20 + i, 30)).save(tmp_path / "input" / f"{i:03d}.png")
        Image.new("RGB", SIZE, (255, 255, 255)).save(tmp_path / "masks" / f"{i:03d}.png")
    (tmp_path / "flow.json").write_text(json.dumps(WORKFLOW))
    return tmp_path


def send(folders, name, url, *more):
    where = [str(folders / "input"), str(folders / "output")]
    return main([name, url, *where, "--prompt", "make it snow", "--seed", "5", *more])


def edited(folders):
    return [Image.open(path).getpixel((0, 0)) for path in sorted((folders / "output").iterdir())]


@pytest.mark.parametrize("name", ["openai", "sdcpp", "comfyui", "fastsd"])
def test_every_picture_is_edited(folders, name, monkeypatch):
    monkeypatch.setattr("gsedit.paper.editors.command.http.POLL", 0.01)
    workflow = ["--workflow", str(folders / "flow.json")] if name == "comfyui" else []
    with serving() as (server, url):
        assert send(folders, name, url, *workflow) == 0
    assert edited(folders) == [(245, 235, 225), (245, 234, 225)]
    assert not any(key for _, key in server.calls)


def test_settings_masks_and_seeds_are_sent(folders):
    more = ["--set", "steps=4", "--masks", str(folders / "masks")]
    with serving() as (server, url):
        send(folders, "sdcpp", url, *more)
        form = server.asked[0]
    inside = re.search(b"<sd_cpp_extra_args>(.+)</sd_cpp_extra_args>", form["prompt"])[1]
    assert json.loads(inside) == {"seed": 5, "steps": 4}
    assert form["size"] == b"48x32"
    assert Image.open(io.BytesIO(form["mask"])).size == SIZE


def html(handler):
    handler.reply(b"<html><h1>Welcome</h1></html>", "text/html")


def missing(handler):
    handler.reply({"error": "no such model"}, code=404)


def hanging(handler):
    time.sleep(1)


def dribbling(handler):
    handler.send_response(200)
    handler.end_headers()
    with suppress(OSError):  # whoever asked has gone
        for _ in range(40):
            handler.wfile.write(b" ")
            time.sleep(0.05)


def moved(handler):
    handler.send_response(302)
    handler.send_header("Location", "http://127.0.0.1:1/elsewhere")
    handler.end_headers()


def of_shape(width, height):
    picture = base64.b64encode(png(Image.new("RGB", (width, height)))).decode()
    return lambda handler: handler.reply({"data": [{"b64_json": picture}]})


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (html, "'<html><h1>Welcome</h1></html>', which is not JSON"),
        (missing, 'answered 404 (\'{"error": "no such model"}\')'),
        (hanging, "did not answer in 0.3 s: raise --timeout"),
        (dribbling, "did not answer in 0.3 s: raise --timeout"),
        (moved, "answered 302"),
        (of_shape(32, 32), "a picture of 32x32 pixels to one of 48x32"),
        (lambda handler: handler.reply({"data": []}), "without 0"),
        (lambda handler: handler.reply({"data": [{"b64_json": "?"}]}), "not in base 64"),
        (lambda handler: handler.reply({"data": [{"b64_json": "QUJD"}]}), "is not a picture"),
    ],
    ids=["html", "404", "hangs", "dribbles", "moved", "shape", "empty", "base64", "text"],
)
def test_a_server_that_misbehaves_is_told_in_one_line(folders, answer, message, capsys):
    with serving(answer) as (_, url):
        assert send(folders, "openai", url, "--timeout", "0.3") == 1
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list((folders / "output").iterdir())


def test_a_key_is_sent_to_its_server_and_never_unencrypted_elsewhere(folders, monkeypatch, capsys):
    monkeypatch.setenv("GSEDIT_API_KEY", "secret")
    with serving() as (server, url):
        assert send(folders, "openai", url) == 0
    assert server.calls[0] == ("/v1/images/edits", "Bearer secret")
    assert send(folders, "openai", "http://example.org") == 1
    said = capsys.readouterr().err
    assert "unencrypted" in said
    assert "secret" not in said

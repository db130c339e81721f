"""Who reaches a page, and which files it reaches."""

from __future__ import annotations

import pytest
from websockets.datastructures import Headers

from gsedit.app.places import Places
from gsedit.app.reading import read
from gsedit.app.server import Guard
from gsedit.errors import UsageError

TOKEN = "abcdef0123456789"
GUARD = Guard(TOKEN, b"<html>")


def headers(**given: str) -> Headers:
    own = {"Host": "127.0.0.1:8080"} | {k.replace("_", "-"): v for k, v in given.items()}
    return Headers(own)


@pytest.mark.parametrize(
    ("path", "given"),
    [
        (f"/?token={TOKEN}", {}),
        ("/", {"Cookie": f"other=1; {GUARD.cookie}={TOKEN}"}),
        (f"/?token={TOKEN}", {"Host": "localhost:8080"}),
        ("/", {"Cookie": f"{GUARD.cookie}={TOKEN}", "Upgrade": "websocket",
               "Origin": "http://127.0.0.1:8080"}),
    ],
)  # fmt: skip
def test_the_address_and_the_page_itself_are_answered(path, given):
    assert GUARD.refused(path, headers(**given)) == ""


@pytest.mark.parametrize(
    ("path", "given"),
    [
        ("/", {}),
        ("/?token=", {}),
        (f"/?token={TOKEN}x", {}),
        (f"/{TOKEN}", {}),
        ("/?token=\udcff\u00e9", {}),
        ("/", {"Cookie": f"gsedit={TOKEN}"}),
        ("/", {"Cookie": f"{GUARD.cookie}=other"}),
        (f"/?token={TOKEN}", {"Host": "evil.example"}),
        (f"/?token={TOKEN}", {"Host": "192.168.1.5:8080"}),
        (f"/?token={TOKEN}", {"Origin": "http://evil.example"}),
        (f"/?token={TOKEN}", {"Upgrade": "websocket"}),
        (f"/?token={TOKEN}", {"Upgrade": "websocket", "Origin": "http://127.0.0.1:9"}),
    ],
)
def test_another_token_host_or_origin_is_refused(path, given):
    assert GUARD.refused(path, headers(**given))


def test_places_are_the_given_folders_and_nothing_beside_them(tmp_path):
    given, other = tmp_path / "given", tmp_path / "given-too"
    for folder in (given / "in", other):
        folder.mkdir(parents=True)
    (given / "link").symlink_to(other)
    places = Places((given.resolve(),))
    assert places.check("in/a.ply") == (given / "in" / "a.ply").resolve()
    assert places.check(str(given / "new.ply")) == (given / "new.ply").resolve()
    for outside in (
        "../given-too/a.ply",
        str(other),
        "/etc/passwd",
        "link/a.ply",
        "~",
        "",
        " ",
        "a\0",
        "~nobody-of-this-name/a.ply",
        "a" * 5000,
    ):
        with pytest.raises(UsageError):
            places.check(outside)
    both = Places((given.resolve(), other.resolve()))
    assert both.check("link/a.ply") == (other / "a.ply").resolve()


def test_a_sentence_names_no_file_elsewhere(tmp_path):
    places = Places((tmp_path.resolve(),))
    assert read(f"put '{tmp_path}/hat.ply' on the bear", (), places).steps
    assert "is outside of" in read("put /elsewhere/hat.ply on the bear", (), places).refusal

"""The page through its real websocket, without a browser."""

import http.client
import re
import time
from functools import partial
from urllib.parse import urlsplit

import numpy as np
import pytest
from page_client import PageClient
from pages import served, until
from websockets.exceptions import InvalidStatus

from gsedit.app.opening import open_path


@pytest.fixture
def opened(page, scene):
    open_path(page, scene)
    with served(page) as found:
        yield found.address


def sees_scene(tab):
    return tab.picture and tab.pixels().std() > 20


def has_step(tab, name):
    """Whether the newest step of the strip of pictures has a name, and is shown."""
    return names_of(tab)[-1:] == [(name, True)]


def names_of(tab):
    pages = [str(each["props"].get("content", "")) for each in list(tab.controls.values())]
    found = re.findall(r'class="step( now)?" [^>]*aria-label="([^"]*)"', "".join(pages))
    return [(label, bool(now)) for now, label in found]


def test_two_tabs_share_the_scene_and_not_the_view(opened, page):
    one, other = PageClient(opened, (160, 120)), PageClient(opened, (120, 160))
    for tab in (one, other):
        tab.wait(partial(sees_scene, tab))
    assert one.wait(lambda: one.pixels().shape == (120, 160, 3))
    assert other.wait(lambda: other.pixels().shape == (160, 120, 3))
    page.step("clean", title="clean it")
    for tab in (one, other):
        tab.wait(partial(has_step, tab, "1: clean it"))
    one.set("action", "undo \t1")
    other.wait(lambda: names_of(other) == [("0: bear.ply", True), ("1: clean it", False)])
    one.press("wipe")
    until(lambda: [each.compares for each in page.tabs].count(True) == 1)
    other.wait(lambda: time.perf_counter() - other.pictures[-1][0] > 0.5)
    still = other.picture
    one.look(position=(0.0, -1.5, 2.0))
    one.wait(lambda: len(one.pictures) > 3)
    assert other.picture == still
    until(lambda: page.document.eye and page.document.eye.position == (0.0, -1.5, 2.0))
    for tab in (one, other):
        tab.close()


def test_a_tab_closed_in_the_middle_of_an_edit_does_not_end_it(opened, page):
    tab = PageClient(opened, (64, 48))
    tab.wait(lambda: sees_scene(tab))
    page.step("clean", "--seconds", "1", title="slow")
    tab.wait(lambda: "slow" in tab.text())
    tab.close()
    until(lambda: not page.tabs)
    until(lambda: page.document.current.title == "slow")
    again = PageClient(opened, (64, 48))
    again.wait(lambda: sees_scene(again) and has_step(again, "1: slow"))
    again.close()


def test_a_preview_and_a_new_step_are_seen_in_their_own_colors(opened, page):
    tab = PageClient(opened, (64, 48))
    tab.wait(lambda: sees_scene(tab))
    shown = page.tabs[0]
    tab.wait(lambda: time.perf_counter() - tab.pictures[-1][0] > 0.5)
    own = tab.pixels().astype(int)
    is_own = lambda: np.abs(tab.pixels() - own).mean() < 1  # noqa: E731
    every = page.scene.means[:, 0] > page.scene.means[:, 0].median()
    page.select(every, "half")
    tab.wait(lambda: not is_own())
    shown.preview(page.scene)
    tab.wait(is_own)
    shown.preview(None)
    tab.wait(lambda: not is_own())
    page.step("edit", "clean it", title="clean it")
    tab.wait(lambda: has_step(tab, "1: clean it") and is_own())
    assert page.selection is None
    page.select(every.clone(), "half")
    tab.wait(lambda: not is_own())
    shown.compare(page.scene)
    tab.wait(lambda: np.abs(tab.pixels() - own)[:, :16].mean() < 1)  # no JPEG block of the line
    tab.close()


def test_errors_appear_as_sentences_and_work_can_be_cancelled(opened, page):
    tab = PageClient(opened, (64, 48))
    tab.wait(lambda: sees_scene(tab))
    tab.set("path", "/etc/passwd")
    tab.press("Open")
    told = tab.wait(lambda: tab.notices)
    assert "--allow" in told[0][1]
    assert "Traceback" not in told[0][1]
    page.step("clean", "--seconds", "30", title="slow")
    tab.wait(lambda: "slow" in tab.text())
    tab.press("Cancel")
    tab.wait(lambda: len(tab.notices) == 2 and "cancelled" in tab.notices[1][1])
    tab.wait(lambda: not tab.control("Cancel")["props"]["visible"])
    tab.close()


def test_a_dropped_scene_is_opened(opened, page, scene):
    tab = PageClient(opened, (64, 48))
    tab.wait(lambda: sees_scene(tab))
    before = np.array(tab.pixels())
    tab.upload("Open files, or drop them here", "other.ply", scene.read_bytes())
    tab.wait(lambda: "other" in tab.text())
    assert page.scene_file.name == "other.ply"
    assert before.shape == tab.pixels().shape
    tab.close()


def test_another_token_host_or_origin_is_refused(opened):
    parts = urlsplit(opened)
    with pytest.raises(InvalidStatus, match="403"):
        PageClient(opened.replace("token=", "token=x"))
    asked = [("/", {}), ("/?token=x", {}), (f"/?{parts.query}", {"Host": "evil.example"}),
             (f"/?{parts.query}", {"Origin": "http://evil.example"})]  # fmt: skip
    for path, headers in asked:
        assert status(parts.netloc, path, headers)[0] == 403
    found, told = status(parts.netloc, f"/?{parts.query}", {})
    assert found == 200
    assert "HttpOnly; SameSite=Strict" in told["Set-Cookie"]
    assert "default-src 'self'" in told["Content-Security-Policy"]
    cookie = {"Cookie": told["Set-Cookie"].split(";")[0]}
    assert status(parts.netloc, "/", cookie)[0] == 200
    assert status(parts.netloc, "/bear.ply", cookie)[0] == 404


def status(host, path, headers):
    connection = http.client.HTTPConnection(host)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    connection.close()
    return answer.status, answer.headers

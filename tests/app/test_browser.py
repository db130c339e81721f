"""The page as a person uses it: a real browser, a tiny scene."""

from pathlib import Path
from time import sleep

import pytest
from command_line import answer, names
from page_browser import CTRL, browser, chromium
from pages import served

from gsedit.app.opening import open_path
from gsedit.app.previews import Previewer
from gsedit.formats.scenes import read_scene

pytestmark = pytest.mark.skipif(chromium() is None, reason="there is no Chromium to open")


@pytest.fixture(scope="module")
def opened():
    """One browser for all: it opens a window for a while."""
    with browser() as windows:
        yield windows


def test_open_click_type_apply_undo_and_export(scene, page, tmp_path, opened):
    open_path(page, scene)
    with served(page) as found, opened(found.address) as window:
        window.wait(lambda: "600 Gaussians" in window.text())
        select(window, page)
        edit(window, page)
        window.key("z", CTRL)
        window.wait(lambda: page.document.position == 0)
        window.wait(lambda: "bear.ply" in window.text())
        export(window, page, tmp_path)
        assert not window.errors
        assert not [each for each in window.requests if not inside(each, found.port)]


def select(window, page):
    window.wait(lambda: page.tabs and page.tabs[0].pointer_name == "select")
    x, y = window.wait(lambda: middle(window, "canvas"))
    window.wait(lambda: clicked(window, page, x, y))
    window.wait(lambda: "selected" in window.text())


def clicked(window, page, x, y):
    """Click until something is selected: the first click may come before the picture."""
    window.click(x, y)
    for _ in range(40):
        if page.selection is not None:
            return True
        window.run("1")
        sleep(0.05)
    return False


def edit(window, page):
    window.write("Say what should change", "paint it red")
    window.wait(lambda: "painted red" in window.text())  # how it is understood
    window.press("Apply")
    window.wait(lambda: page.document.position == 1, 40)
    window.wait(lambda: "paint it red" in window.text())
    *command, _ = page.document.current.command
    assert command[0] == "edit"
    answer(*command, page.folder / "again")  # which a stand-in for gsedit was given
    assert {"scene.ply", "edit.json", "region.npy"} <= names(page.folder / "again")


def export(window, page, tmp_path):
    # looks that arrive above move it away from a press
    window.wait(lambda: window.press("File") or sleep(1.0) or "Export" in window.text())
    window.press("Export")
    files = lambda: list((page.folder / "exports").glob("bear*"))  # noqa: E731
    window.wait(lambda: files() and page.busy is None, 40)
    window.wait(lambda: "is downloaded" in window.text())  # an error takes its place
    assert len(read_scene(files()[0]).scene) == 600


def middle(window, what):
    """The middle of the first element of a CSS selector; None where there is none."""
    script = f"""(() => {{ const box = document.querySelector("{what}")?.getBoundingClientRect();
        return box && [box.x + box.width / 2, box.y + box.height / 2]; }})()"""
    return window.run(script)


def inside(address, port):
    return address.startswith(("data:", "blob:", "about:")) or f"://127.0.0.1:{port}" in address


def test_a_sentence_is_outlined_and_ended_by_what_begins(scene, page, monkeypatch, opened):
    half = lambda self, _: self.loaded.scene.means[:, 0] > 0  # noqa: E731
    monkeypatch.setattr(Previewer, "target", half)
    open_path(page, scene)
    with served(page) as found, opened(found.address) as window:
        window.wait(lambda: "600 Gaussians" in window.text())
        tab = page.tabs[0]
        window.write("Say what should change", "paint it red")
        window.wait(lambda: "Not this?" in window.text())
        window.wait(lambda: tab.previews)
        window.wait(lambda: window.run("document.querySelectorAll('#over button').length"))
        window.run("document.querySelector('[data-box]').focus()")
        window.key("Escape")
        window.wait(lambda: not tab.previews)
        assert tab._marked() is not None  # what was named is outlined still
        window.wait(lambda: press_number(window) or page.selection is not None)
        window.wait(lambda: tab.previews)  # the sentence, of what is selected now
        page.select(~page.selection, "the others")
        assert not tab.previews
        assert not window.errors


def press_number(window):
    """Click on a number that lies on the picture, as it may be laid anew meanwhile."""
    if place := middle(window, "#over button"):
        window.click(*place)
    sleep(0.2)


def test_messages_are_one_at_a_time_and_all_controls_have_names(scene, page, opened):
    open_path(page, scene)
    with served(page) as found, opened(found.address) as window:
        window.wait(lambda: "600 Gaussians" in window.text())
        window.wait(lambda: "Save the selection" in window.text())
        page.fail("the first did not work")
        window.wait(lambda: "the first" in window.text())
        page.fail("the second did not work")
        window.wait(lambda: "the second" in window.text() and "the first" not in window.text())
        assert window.run(_NAMELESS) == []
        for heading in ("Tools", "File", "Select"):
            window.press(heading)
            assert window.run(_FAINT) == []
        page.step("clean", "--seconds", "9", title="slow")
        window.wait(lambda: "slow, 2 s" in window.text())  # it is told though nothing is heard
        assert window.run(_FAINT) == []
        window.press("Cancel")
        window.wait(lambda: "nothing has changed" in window.text())
        assert window.run(_FAINT) == []


_FAINT = """(() => {
  const rgb = (text) => text.match(/[\\d.]+/g)?.map(Number) ?? [0, 0, 0, 0];
  const light = (c) => c.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (each) => {
    for (; each; each = each.parentElement) {
      const color = rgb(getComputedStyle(each).backgroundColor);
      if (color.length < 4 || color[3] > 0.9) return color;
    }
    return [36, 36, 36];
  };
  const ratio = (a, b) => [a, b].map(light).sort((x, y) => y - x)
    .map((each) => each + 0.05).reduce((x, y) => x / y);
  const edges = [...document.querySelectorAll("input:not([type=file])")]
    .filter((each) => each.offsetParent && !each.disabled && each.type !== "range")
    .map((each) => [each, rgb(getComputedStyle(each).borderTopColor)])
    .map(([each, edge]) => [ratio(edge, behind(each.parentElement)), each.outerHTML])
    .filter(([value]) => value < 3);
  return edges.concat([...document.querySelectorAll("body *")]
    .filter((each) => each.offsetParent && !each.closest("[disabled]"))
    .filter((each) => [...each.childNodes].some((n) => n.nodeType === 3 && n.data.trim()))
    .map((each) => [ratio(rgb(getComputedStyle(each).color), behind(each)), each.innerText])
    .filter(([value]) => value < 4.5));
})()"""
"""Edges of fields and texts whose contrast is below that of WCAG's AA: 3 and 4.5."""
_APPLY = """[...document.querySelectorAll("button")].find((each) => each.innerText === "Apply")
    ?.getBoundingClientRect().bottom"""
_NAMELESS = """[...document.querySelectorAll("button,input,select,textarea,canvas,[role=tab]")]
    .filter((each) => each.offsetParent !== null && each.type !== "file")
    .filter((each) => !(each.getAttribute("aria-label") || each.innerText?.trim()
        || each.labels?.length || each.title))
    .map((each) => each.outerHTML.slice(0, 200))"""


def test_a_window_as_small_as_a_phone_can_be_used_by_touch(scene, page, opened):
    open_path(page, scene)
    with served(page) as found, opened(found.address, (390, 844)) as window:
        window.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        window.wait(lambda: "600 Gaussians" in window.text())
        window.wait(lambda: 700 < (window.run(_APPLY) or 0) < 844)  # the box has all above it
        window.press("Tools")
        window.wait(lambda: "side by side" in window.text())
        assert window.run("document.documentElement.scrollWidth") <= 390
        x, y = window.wait(lambda: above_the_panel(window))
        eye = page.document.eye
        window.touch(((x, y),), ((x + 30, y),), ((x + 60, y),))
        window.wait(lambda: page.document.eye != eye)
        window.wait(lambda: page.tabs and page.tabs[0].pointer_name == "select")
        window.touch(((x, y),))
        window.wait(lambda: page.selection is not None)


def test_a_folder_of_photos_that_is_dropped_waits_for_its_scene(page, tmp_path, opened):
    photos = tmp_path / "given" / "my photos"
    (photos / "more").mkdir(parents=True)
    for name in ("1.jpg", "2.jpg", "more/3.jpg", "notes.doc", ".hidden.jpg"):
        (photos / name).write_bytes(b"a photo")
    with served(page) as found, opened(found.address) as window:
        window.wait(lambda: "Nothing is open" in window.text())
        window.drop(photos)
        window.wait(lambda: "Make a scene" in window.text())
        assert "my photos, 2 photos" in window.text()
        source = Path(page.document.source)
        kept = [str(each.relative_to(source)) for each in sorted(source.rglob("*.*"))]
        assert kept == ["1.jpg", "2.jpg", "more/3.jpg"]
        assert not window.errors


def above_the_panel(window):
    """The middle of the picture, once it ends where the panel begins."""
    script = """(() => {
        const canvas = document.querySelector("canvas")?.getBoundingClientRect();
        const panel = document.querySelector("#sheet")?.getBoundingClientRect();
        if (!canvas || !panel || Math.abs(canvas.bottom - panel.top) > 1) return null;
        return [canvas.width / 2, canvas.height / 2]; })()"""
    return window.run(script)

"""The page as a person uses it: a real browser, a real worker, a tiny scene."""

from __future__ import annotations

import pytest
from pages import make_page, served
from research.page_browser import CTRL, browser, chromium

from gsedit.app.opening import open_path
from gsedit.app.worker import program_of
from gsedit.formats.scenes import read_scene

pytestmark = pytest.mark.skipif(chromium() is None, reason="there is no Chromium to open")


def test_open_click_type_apply_undo_and_export(scene, tmp_path):
    page = make_page(tmp_path, program_of("gsedit_cli.core.warm"))
    page.warm()
    open_path(page, scene)
    try:
        with served(page) as found, browser() as opened:
            window = opened(found.address)
            window.wait(lambda: "600 Gaussians" in window.text())
            select(window, page)
            edit(window, page)
            window.key("z", CTRL)
            window.wait(lambda: page.document.position == 0)
            window.wait(lambda: "bear.ply" in window.text())
            export(window, page, tmp_path)
            refuse(window)
            assert not window.errors
            assert not [each for each in window.requests if not inside(each, found.port)]
    finally:
        page.close()


def select(window, page):
    window.press("Select")
    window.wait(lambda: page.tabs and page.tabs[0].pointer_name == "select")
    window.wait(lambda: window.run("!!document.querySelector('canvas')"))
    x, y = canvas_middle(window)
    window.wait(lambda: clicked(window, page, x, y))
    window.wait(lambda: "selected" in window.text())


def clicked(window, page, x, y):
    """Click until something is selected: the first click may come before the picture."""
    window.click(x, y)
    for _ in range(40):
        if page.selection is not None:
            return True
        window.run("1")
        window.sleep(0.05)
    return False


def edit(window, page):
    window.press("Say")
    window.write("", "paint it red")
    window.wait(lambda: "about" in window.text())  # how it is understood, and how long it takes
    window.press("Apply")
    window.wait(lambda: page.document.position == 1, 40)
    window.wait(lambda: "paint it red" in window.text())
    assert page.document.current.command[0] == "edit"
    assert (page.scene_file.parent / "edit.json").is_file()


def export(window, page, tmp_path):
    window.press("File")
    window.press("Export")
    files = lambda: list((page.folder / "exports").glob("bear*"))  # noqa: E731
    window.wait(lambda: files() and page.busy is None, 40)
    assert len(read_scene(files()[0]).scene) == 600


def refuse(window):
    window.write("path", "/etc/passwd")
    window.press("Open")
    window.wait(lambda: "--allow" in window.text())
    assert "Traceback" not in window.text()


def canvas_middle(window):
    script = """(() => { const box = document.querySelector("canvas").getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2]; })()"""
    return window.run(script)


def inside(address, port):
    return address.startswith(("data:", "blob:", "about:")) or f"://127.0.0.1:{port}" in address


def test_a_window_as_small_as_a_phone_can_be_used(scene, page):
    open_path(page, scene)
    with served(page) as found, browser() as opened:
        window = opened(found.address, (390, 800))
        window.wait(lambda: "600 Gaussians" in window.text())
        window.press("History")
        window.wait(lambda: "side by side" in window.text())
        assert window.run("document.documentElement.scrollWidth") <= 390

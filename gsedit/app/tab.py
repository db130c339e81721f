"""One browser tab: its camera, what it shows, its pointer, and its notices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from html import escape
from math import atan, tan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from gsedit.app.document import Eye
from gsedit.app.frames import RESTING_QUALITY, DisplayState, LatestOnlyWorker, Painter, Way, picture
from gsedit.app.looking import framed
from gsedit.errors import GseditError, on_page
from gsedit.select.region import tinted
from rasterizer.camera import Camera, pose_of
from rasterizer.numerics import DEFAULT
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.app.loaded import Loaded
    from gsedit.app.page import Page


def camera_of(
    wxyz: np.ndarray, position: np.ndarray, fov: float, size: tuple[int, int], near: float | None
) -> Camera:
    """The camera of a pose (camera to world, OpenCV axes), with a vertical field of view, radians,
    and a picture of `size` (width, height)."""
    width, height = (max(each, 16) for each in size)  # a tab that is being opened has less
    axes, center = (
        torch.tensor([float(each) for each in row]).double() for row in (wxyz, position)
    )
    pose = pose_of(rotation_matrices(axes[None])[0].T, center)
    focal = height / 2 / tan(fov / 2)
    return Camera(pose, focal, focal, width / 2, height / 2, width, height, near=near)


def eye_of(camera: Camera, distance: float) -> Eye:
    """The place of a camera that turns about what is `distance` before it."""
    center, forward = camera.center.double(), camera.forward.double()
    up = -camera.rotation[1].double()
    fov = 2 * atan(camera.height / 2 / camera.fy)
    return Eye(point_of(center), point_of(center + distance * forward), point_of(up), fov)


def handle_eye(handle: Any) -> Eye:
    """The place of a viser camera."""
    position, target, up = handle.position, handle.look_at, handle.up_direction
    fov = widened(float(handle.fov), 1 / height_of(handle))
    return Eye(point_of(position), point_of(target), point_of(up), fov)


def widened(fov: float, factor: float) -> float:
    """The field of view, radians, across so many times the length."""
    return 2 * atan(factor * tan(fov / 2))


def height_of(handle: Any) -> float:
    """Height of a viser camera's picture in its shorter sides."""
    return max(handle.image_height / max(handle.image_width, 1), 1.0)


def point_of(values: Any) -> tuple[float, float, float]:
    """Three numbers of a vector."""
    x, y, z = (float(each) for each in values)
    return x, y, z


ACTION = "action"
"""Label of the field, hidden by page.js, by which the page's own buttons tell what is asked for."""


def button(
    action: str, inner: str, *, label: str = "", kind: str = "chip", style: str = "",
    off: bool = False,
) -> str:  # fmt: skip
    """HTML of a button for an action with its argument ("say make it snow"), which may be `off`;
    `inner` is HTML, the rest is text. Pictures need a `label`."""
    named = f' aria-label="{escape(label)}" title="{escape(label)}"' if label else ""
    shown = (f' style="{escape(style)}"' if style else "") + " disabled" * off
    return (
        f'<button type="button" class="{kind}" data-do="{escape(action)}"{named}{shown}>{inner}'
        "</button>"
    )


WELCOMES = {
    (False, False): "Drop photos of one thing, a video or a scene here.",
    (False, True): "Your photos are here. Now make a scene of them, in the panel.",
    (True, False): "One moment…",
    (True, True): "Your scene appears here as it grows.",
}
"""Words in the place of the picture: by whether work is in hand, and whether photos are there."""
GO = (1.0, 0.25, 0.1)
"""Color of what would go."""


@dataclass(frozen=True)
class Pick:
    """A pixel that was clicked."""

    camera: Camera
    x: float
    """Column, pixels of the camera from its left border."""
    y: float
    modifier: str | None = None
    """Keys held: "shift", "cmd/ctrl", ..."""


@dataclass(frozen=True)
class Box:
    """A rectangle that was drawn; corners in pixels of the camera."""

    camera: Camera
    x0: float
    y0: float
    x1: float
    y1: float


class Tab:
    """One browser tab. Its controls are its own; the scene and the work are the page's."""

    def __init__(self, page: Page, client: Any) -> None:
        """Take a viser client, and begin to draw for it."""
        self.page, self.client, self.gui = page, client, client.gui
        self.closed = False
        self.pointer_name: str | None = None
        self._faced: tuple[Path | None, bool] = (None, False)
        self._shown = DisplayState()
        self._preview: Gaussians | None = None
        self._peek: Gaussians | None = None
        self._rough = self._stands = False
        self._tint: tuple[Tensor, tuple[float, float, float]] | None = None
        self._named: Tensor | None = None
        self._notice: Any = None
        self.rested: Callable[[bool], None] = lambda rests: None
        """Called after each picture: whether it is in full, as the view rests."""
        self.begin: Callable[[], None] = lambda: None
        """Called when something begins that a preview would be in the way of."""
        self.tools: list[Callable[[], None]] = []
        """Each puts a tool away that is in hand: handles, colors of what would go."""
        self._over = self.gui.add_html("")
        self._actions: dict[str, Callable[[str], None]] = {}
        self._asked = self.gui.add_text(ACTION, "")
        self._asked.on_update(self.safely(self._act))
        self.give_back: Callable[[], None] = lambda: None
        """Called by what has had the pointer: clicks select again, if they did."""
        self._pointers: list[tuple[str, Callable[[Any], None]]] = []
        self._latest = LatestOnlyWorker(self.fail)
        self._painter = Painter(self.camera, self.draw, self._send, self._count, self.fail)
        page.listen(self, "scene", self.new_scene)  # before what panels do then
        page.listen(self, "begun", self.hush)
        for what in ("selection", "growing"):
            page.listen(self, what, self.refresh)
        for what in ("document", "growing", "busy"):
            page.listen(self, what, self.welcome)

    def start(self) -> None:
        """Show the page's scene, from where a person last looked at it, and begin to draw."""
        self.refresh()
        self.welcome()
        self.client.camera.on_update(lambda _: self._painter.look())
        self._painter.look()

    # -- camera

    def camera(self, width: int | None = None, height: int | None = None) -> Camera:
        """The view of the tab: a camera of the canvas's size, or of another one."""
        handle = self.client.camera
        size = width or int(handle.image_width), height or int(handle.image_height)
        seen = self.page.visible
        near = None if seen is None else seen.bulk.near
        return camera_of(handle.wxyz, handle.position, handle.fov, size, near)

    def _face(self, loaded: Loaded, *, anew: bool = False) -> None:
        """Turn to a scene: its own upward direction, the remembered view or, `anew`, the first."""
        eye, handle = self.page.document.eye, self.client.camera
        if anew or eye is None or not self.page.has_scene:
            camera, middle = loaded.first_camera(), loaded.middle
            ahead = float((middle - camera.center) @ camera.forward.double())
            eye = eye_of(camera, max(ahead, 0.1 * loaded.bulk.radius))
            if ahead > 0:
                eye = replace(eye, target=point_of(middle))  # which the view turns about
            wide = handle.image_height / max(handle.image_width, 1) * camera.width / camera.height
            fov = widened(eye.fov, max(wide, 1.0))  # a narrow window shows its width
            eye = replace(eye, up=point_of(loaded.up()))
        else:
            fov = widened(eye.fov, height_of(handle))
        with self.client.atomic():
            handle.up_direction, handle.fov = eye.up, fov
            handle.near, handle.far = loaded.bulk.near, 100.0 * loaded.bulk.radius
            handle.position, handle.look_at = eye.position, eye.target

    def frame(self) -> None:
        """Look at what is selected, or named, from where the tab looks now, so that it fills the
        picture; at the middle of the scene where nothing is."""
        seen, handle = self.page.visible, self.client.camera
        if seen is None:
            return
        flags, eye = self._marked(), handle_eye(handle)
        if flags is None or len(flags) != len(seen.scene):
            self._face(seen, anew=True)
        else:
            eye = framed(seen.scene, flags, eye)
            with self.client.atomic():
                handle.position, handle.look_at = eye.position, eye.target
        self._painter.look()

    # -- what is shown

    def refresh(self) -> None:
        """Show the page's scene or the preview, with the selection and the tint."""
        page = self.page
        seen = page.visible
        if seen is not None and self._faced != (page.folder, page.has_scene):
            self._faced = page.folder, page.has_scene
            self._face(seen)
        own = None if seen is None else seen.scene
        shown = next((each for each in (self._peek, self._preview) if each is not None), own)
        flags = self._marked()
        if flags is not None and (shown is None or len(flags) != len(shown)):
            flags = None
        if shown is not None and self._tint is not None and len(self._tint[0]) == len(shown):
            shown = tinted(shown, *self._tint)
        numerics = DEFAULT if seen is None else seen.numerics
        self._shown = replace(self._shown, scene=shown, outlined=flags, numerics=numerics)
        self._painter.again()

    def _marked(self) -> Tensor | None:
        """Flags of what is outlined, what is selected or else named: nothing where the scene itself
        is to be seen, which is in a preview and a comparison."""
        flags = self._named if self.page.selection is None else self.page.selection
        bare = (
            (self._preview is None or self._rough)
            and not self.compares
            and self.page.growing is None
        )
        return flags if bare else None

    def name(self, flags: Tensor | None) -> None:
        """Outline what a sentence names, where nothing is selected; None: no more."""
        if flags is not self._named:
            self._named = flags
            self.refresh()

    def preview(self, scene: Gaussians | None, *, rough: bool = False) -> None:
        """Show this scene in the place of the page's until the next step; None: that one again. In
        a `rough` one what is selected or named stays outlined."""
        self._preview, self._rough, self._stands = scene, rough, False
        self.refresh()

    def peek(self, scene: Gaussians | None) -> None:
        """Show this scene in the place of all, while a key is held; None: no more."""
        self._peek = scene
        self.refresh()

    def still(self, picture: np.ndarray) -> None:
        """Show a picture (h w 3, uint8) of the current view until the view moves."""
        self._stands = True
        self._send(picture, RESTING_QUALITY)

    @property
    def previews(self) -> bool:
        """Whether the tab shows a preview."""
        return self._preview is not None or self._stands

    def tint(self, flags: Tensor | None, color: tuple[float, float, float] = GO) -> None:
        """Color Gaussians beside the selection, as what a cleaning would remove; None: no more."""
        self._tint = None if flags is None else (flags, color)
        self.refresh()

    def compare(self, before: Gaussians | None, way: Way = "wipe", wipe: float = 0.5) -> None:
        """Show another scene on the left of what is shown; None: no more."""
        self._shown = replace(self._shown, before=before, way=way, wipe=min(max(wipe, 0.0), 1.0))
        self.refresh()

    def wipe(self, place: float) -> None:
        """Move the line between two scenes, from 0 at the left to 1 at the right."""
        self._shown = replace(self._shown, wipe=min(max(place, 0.0), 1.0))
        self._painter.again()

    @property
    def compares(self) -> bool:
        """Whether two scenes are shown."""
        return self._shown.before is not None

    def new_scene(self) -> None:
        """Show the page's scene alone: it has changed."""
        self._preview = self._peek = self._tint = self._named = None
        self._shown = replace(self._shown, before=None)
        self.refresh()

    # -- pointer

    def pointer(
        self,
        name: str | None,
        click: Callable[[Pick], None] | None = None,
        box: Callable[[Box], None] | None = None,
        modifiers: Sequence[str | None] = (None,),
    ) -> None:
        """Say what clicks, and boxes drawn with Shift, do from now on; no name: nothing.

        `modifiers` are the keys that may be held at a click. A box takes Shift, as a plain drag
        turns the view.
        """
        scene = self.client.scene
        for kind, function in self._pointers:
            remove = (
                scene.remove_click_callback
                if kind == "click"
                else scene.remove_rect_select_callback
            )
            remove(function)
        self._pointers, self.pointer_name = [], name
        if name is None:
            return
        if click is not None:
            handler = self.safely(lambda event: (self.begin(), click(self._pick(event))))
            for each in modifiers:
                scene.on_click(modifier=each)(handler)
            self._pointers.append(("click", handler))
        if box is not None:
            drawn = self.safely(lambda event: (self.begin(), box(self._box(event))))
            scene.on_rect_select(modifier="shift")(drawn)
            self._pointers.append(("box", drawn))

    def _pick(self, event: Any) -> Pick:
        canvas = self.camera()
        x, y = event.screen_pos
        camera = self._shown.camera(canvas)
        return Pick(camera, x * canvas.width % camera.width, y * camera.height, event.modifier)

    def _box(self, event: Any) -> Box:
        camera = self.camera()
        (x0, y0), (x1, y1) = event.screen_min, event.screen_max
        w, h = camera.width, camera.height
        return Box(camera, x0 * w, y0 * h, x1 * w, y1 * h)

    # -- work and notices

    def drop(self, key: str) -> None:
        """Do not wait for the short work of a key any more: its result is not shown."""
        self._latest.drop(key)

    def soon(self, key: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Do short work in the tab's thread; a newer request of the same key replaces this one."""
        self._latest.ask(key, work, then)

    def safely(self, function: Callable[..., Any]) -> Callable[..., None]:
        """Wrap a callback: what it raises becomes a notice."""

        @wraps(function)
        def called(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as error:
                self.fail(error)

        return called

    def on(self, action: str, function: Callable[[str], None]) -> None:
        """Call a function when what `button` made for an action is pressed, with its argument."""
        self._actions[action] = function

    def _act(self, event: Any) -> None:
        action, _, argument = self._asked.value.partition("\t")[0].partition(" ")
        if event.client is not None and action in self._actions:
            self._actions[action](argument)

    def over(self, html: str) -> None:
        """Lay controls over the picture, at places in shares of its size; "": nothing."""
        bare = "" if self.page.has_scene else " nothing"
        laid = f'<div class="laid{bare}">{html}</div>'  # page.js moves it
        if self._over.content != laid:
            self._over.content = laid

    def welcome(self) -> None:
        """Say in the place of the picture what to do while there is none."""
        page = self.page
        if not page.has_scene:
            told = page.busy is not None, bool(page.document.source)
            html = f'<div class="welcome">{WELCOMES[told]}</div>'
            self.over("" if page.growing is not None else html)

    def tell(self, text: str) -> None:
        """Say something that goes away by itself, in the place of what was said before."""
        self._say("gsedit", text, "blue", 6.0)

    def fail(self, error: Exception | str) -> None:
        """Say what went wrong, in the error's own sentence."""
        known = isinstance(error, (GseditError, str))
        text = str(on_page(error) if isinstance(error, Exception) else error)  # plain, to be sent
        if not known:
            kind = type(error).__name__
            text = f"internal error ({kind}: {text}); what was done before is kept"
        self._say("That did not work", text, "red", 6.0 + 0.06 * len(text))  # as long as one reads

    def _say(self, title: str, text: str, color: Any, seconds: float) -> None:
        if not self.closed:
            self.hush()
            self._notice = self.client.add_notification(
                title, text, color=color, auto_close_seconds=seconds
            )

    def hush(self) -> None:
        """Take away what was said last: something else has begun."""
        notice, self._notice = self._notice, None
        if notice is not None and not self.closed:
            notice.remove()

    def download(self, path: Path) -> None:
        """Offer a file to the browser."""
        self.client.send_file_download(path.name, path.read_bytes(), save_immediately=True)

    def key(
        self, label: str, hotkey: Any, function: Callable[[], None], modifier: Any = None
    ) -> None:
        """Let a key call a function; the command palette (Ctrl-K) lists it under its label."""
        command = self.gui.add_command(label, hotkey=hotkey, modifier=modifier)
        command.on_trigger(self.safely(lambda _: function()))

    def close(self) -> None:
        """End the tab's threads; the browser has closed it."""
        self.closed = True
        self._painter.end()
        self._latest.end()

    # -- pictures

    def _count(self) -> int:
        return self._shown.count

    def draw(self, camera: Camera) -> Any:
        """Draw what the tab shows (h w 3, uint8) by a camera."""
        return picture(self._shown, camera)

    def _send(self, drawn: Any, quality: int) -> None:
        rests = quality == RESTING_QUALITY
        if rests:
            self.page.look(handle_eye(self.client.camera))
        if not self.closed:
            self.client.scene.set_background_image(drawn, format="jpeg", jpeg_quality=quality)
            self.client.flush()
            self.rested(rests)

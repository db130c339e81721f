"""A tab of `gsedit app` without a browser: its websocket, its controls, its pictures.

What viser 1.1's client does of its protocol, as far as the page needs it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from math import radians
from threading import Condition, Thread
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

FIELD_OF_VIEW = radians(50)


@dataclass
class PageClient:
    """One tab, connected to the page at an address."""

    address: str
    size: tuple[int, int] = (640, 480)
    """(width, height) of the canvas."""
    controls: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Messages of the controls by their identity; `props` and `value` follow what is told."""
    notices: list[tuple[str, str]] = field(default_factory=list)
    """(title, text) of every notice, in order."""
    pictures: list[tuple[float, int]] = field(default_factory=list)
    """(time, bytes) of every picture that came."""
    picture: bytes = b""
    """The last one, JPEG."""
    pose: dict[str, Any] = field(default_factory=dict)
    """Position, target and upward direction of the camera."""

    def __post_init__(self) -> None:
        self.pose = {"position": (0.0, -3.0, 0.0), "look_at": (0.0, 0.0, 0.0), "up": (0, 0, 1.0)}
        self._changed = Condition()
        address = self.address.replace("http://", "ws://")
        origin = self.address.split("/?")[0]
        self._socket = connect(
            address, origin=Origin(origin), max_size=None, compression=None,
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        )  # fmt: skip
        self.fov = FIELD_OF_VIEW
        self.look()
        Thread(target=self._read, daemon=True).start()

    def look(self, **pose: Any) -> None:
        """Look from `position` to `look_at`; what is not given stays."""
        self.pose |= {name: tuple(map(float, value)) for name, value in pose.items()}
        width, height = self.size
        self.send(
            "ViewerCameraMessage", wxyz=quaternion(self.pose), position=self.pose["position"],
            fov=self.fov, near=0.01, far=1000.0, image_height=height, image_width=width,
            look_at=self.pose["look_at"], up_direction=self.pose["up"],
        )  # fmt: skip

    def send(self, kind: str, **fields: Any) -> None:
        """Send one message to the page."""
        self._socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def control(self, label: str) -> dict[str, Any]:
        """The control of a label, once it is there. Raises TimeoutError."""
        return self.wait(lambda: self._labelled(label))

    def _labelled(self, label: str) -> dict[str, Any] | None:
        given = list(self.controls.values())
        return next((each for each in given if each["props"].get("label") == label), None)

    def set(self, label: str, value: Any) -> None:
        """Give a control a value, as a person does."""
        found = self.control(label)
        found["value"] = value
        self.send("GuiUpdateMessage", uuid=found["uuid"], updates={"value": value})

    def press(self, label: str) -> None:
        """Press a button, or a button of a group."""
        found = self.wait(lambda: self._group(label) or self._labelled(label))
        value = label if "ButtonGroup" in found["type"] else True
        self.send("GuiUpdateMessage", uuid=found["uuid"], updates={"value": value})

    def _group(self, label: str) -> dict[str, Any] | None:
        groups = [each for each in list(self.controls.values()) if "ButtonGroup" in each["type"]]
        return next((each for each in groups if label in each["props"]["options"]), None)

    def upload(self, label: str, name: str, content: bytes) -> None:
        """Give a file to an upload button."""
        uuid = self.control(label)["uuid"]
        ids = {"source_component_uuid": uuid, "transfer_uuid": name}
        self.send(
            "FileTransferStartUpload", **ids, filename=name, mime_type="", part_count=1,
            size_bytes=len(content),
        )  # fmt: skip
        self.send("FileTransferPart", **ids, part_index=0, content=content)

    def wait(self, happened: Callable[[], Any], seconds: float = 90.0) -> Any:
        """Wait until something holds, and return it. Raises TimeoutError with the notices."""
        ends = time.monotonic() + seconds
        with self._changed:
            while not (value := happened()):
                if (left := ends - time.monotonic()) <= 0:
                    raise TimeoutError(f"did not happen in {seconds:g} s; notices: {self.notices}")
                self._changed.wait(min(left, 0.1))
        return value

    def text(self) -> str:
        """All texts of the controls that are visible, a line each."""
        shown = [e["props"] for e in list(self.controls.values()) if e["props"].get("visible")]
        told = (str(each.get("_markdown") or each.get("content") or "") for each in shown)
        return "\n".join(filter(None, told))

    def pixels(self) -> np.ndarray:
        """The last picture (h, w, 3), uint8."""
        return np.asarray(Image.open(BytesIO(self.picture)).convert("RGB"))

    def close(self) -> None:
        """Close the tab's connection."""
        self._socket.close()

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            for data in self._socket:
                assert isinstance(data, bytes)
                size = int.from_bytes(data[8:16], "little")
                told = msgspec.msgpack.decode(unpack.decompress(data[16 : 16 + size]))
                with self._changed:
                    before = dict(self.pose)
                    for message in told["messages"]:
                        self._take(message)
                    if self.pose != before:
                        self.look()  # as a browser tells where it looks now
                    self._changed.notify_all()
        except ConnectionClosed:
            return

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "BackgroundImageMessage" and message["rgb_data"]:
            self.picture = message["rgb_data"]
            self.pictures.append((time.perf_counter(), len(self.picture)))
        elif kind == "GuiUpdateMessage" and message["uuid"] in self.controls:
            found, updates = self.controls[message["uuid"]], message["updates"]
            found["props"] |= updates
            found["value"] = updates.get("value", found.get("value"))
        elif kind == "GuiRemoveMessage":
            self.controls.pop(message["uuid"], None)
        elif (kind.startswith("Gui") and "props" in message) or kind == "RegisterCommandMessage":
            self.controls[message["uuid"]] = message
        elif kind == "NotificationShowMessage":
            self.notices.append((message["props"]["title"], message["props"]["body"]))
        elif kind.startswith("SetCamera"):
            self._aim(kind, message)

    def _aim(self, kind: str, message: dict[str, Any]) -> None:
        names = {"Position": "position", "LookAt": "look_at", "UpDirection": "up"}
        which = kind.removeprefix("SetCamera").removesuffix("Message")
        if which == "Fov":
            self.fov = message["fov"]
        elif which in names:
            value = message["look_at"] if "look_at" in message else message["position"]
            self.pose[names[which]] = tuple(value)


def quaternion(pose: dict[str, Any]) -> tuple[float, ...]:
    """Rotation from the camera (OpenCV axes) to the world, wxyz."""
    from scipy.spatial.transform import Rotation

    position, target, up = (np.array(pose[name], float) for name in ("position", "look_at", "up"))
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    x, y, z, w = Rotation.from_matrix(
        np.stack((right, np.cross(forward, right), forward), 1)
    ).as_quat()
    return float(w), float(x), float(y), float(z)

"""A program for `--editor command`: it sends every picture to a server that edits pictures.

    gsedit edit scene.ply "make it snow" --data photos/ --editor command --run
    "{python} -m gsedit.paper.editors.command.http sdcpp http://127.0.0.1:1234 {input} {output}
    --prompt {prompt} --seed {seed}"

Servers: `sdcpp` (sd-server of stable-diffusion.cpp), `openai` (any endpoint of the shape of
OpenAI's images/edits), `comfyui` (with a workflow of yours), `fastsd` (FastSD CPU). Nothing is sent
anywhere but to that URL. A key is read from the environment variable GSEDIT_API_KEY. Imports no
torch.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from PIL import Image, UnidentifiedImageError

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.paper.editors.command.server import (
    KEY,
    Server,
    form,
    is_here,
    key_of_user,
    part_of,
    picture_of,
    quoted,
)

ASPECT_ERROR = 0.03
"""Relative difference of width to height up to which a picture of another size is scaled back:
models round sides to multiples of 8 to 32 pixels."""
POLL = 0.5  # seconds between questions whether a queued picture is done


class Job(NamedTuple):
    """One picture that is to be edited."""

    image: bytes
    """The picture as a PNG file."""
    size: tuple[int, int]
    """(width, height) in pixels."""
    mask: bytes | None
    """A PNG file, white where the edit belongs."""
    prompt: str
    seed: int


# ---- the servers: each edits one job -------------------------------------------------------------

Edit = Callable[[Server, Job, argparse.Namespace], bytes]


def openai(server: Server, job: Job, options: argparse.Namespace) -> bytes:
    """An endpoint of the shape of OpenAI's images/edits."""
    width, height = job.size
    fields = {"prompt": job.prompt, "n": "1", "size": f"{width}x{height}"} | options.set
    files = {"image": job.image} | ({"mask": transparent(job.mask)} if job.mask else {})
    return _first(server, server.post("/v1/images/edits", *form(fields, files)))


def sdcpp(server: Server, job: Job, options: argparse.Namespace) -> bytes:
    """The sd-server of stable-diffusion.cpp, which takes its own settings inside the prompt."""
    more = json.dumps({"seed": job.seed} | options.set)
    prompt = f"{job.prompt}<sd_cpp_extra_args>{more}</sd_cpp_extra_args>"
    width, height = job.size
    fields = {"prompt": prompt, "n": "1", "size": f"{width}x{height}"}
    files = {"image": job.image} | ({"mask": job.mask} if job.mask else {})
    return _first(server, server.post("/v1/images/edits", *form(fields, files)))


def fastsd(server: Server, job: Job, options: argparse.Namespace) -> bytes:
    """FastSD CPU, from picture to picture: it draws the prompt over the picture (`strength`)."""
    width, height = job.size
    asked = {
        "diffusion_task": "image_to_image",
        "init_image": base64.b64encode(job.image).decode(),
        "prompt": job.prompt,
        "image_width": width,
        "image_height": height,
        "use_seed": True,
        "seed": job.seed,
        "number_of_images": 1,
    }
    data = json.dumps(asked | options.set).encode()
    answer = server.post("/api/generate", data, "application/json")
    return picture_of(server, part_of(server, answer, "images", 0))


def comfyui(server: Server, job: Job, options: argparse.Namespace) -> bytes:
    """ComfyUI with a workflow in its API format, whose strings hold {image}, {prompt}, {seed}."""
    values: dict[str, Any] = {"{prompt}": job.prompt, "{seed}": job.seed}
    for field, file in (("{image}", job.image), ("{mask}", job.mask)):
        if file and field in json.dumps(options.workflow):
            values[field] = _uploaded(server, file)
    data = json.dumps({"prompt": _filled(options.workflow, values)}).encode()
    number = part_of(server, server.post("/prompt", data, "application/json"), "prompt_id")
    for done in _history(server, str(number)):
        for node in part_of(server, done, "outputs").values():
            for picture in node.get("images", ()):
                return server.file(f"/view?{urllib.parse.urlencode(picture)}")
        raise GseditError(
            f"{server.url}: the workflow ended without a picture "
            f"({quoted(json.dumps(done.get('status', {})).encode())}): run it in ComfyUI first"
        )
    raise server.late()


SERVERS: dict[str, Edit] = {each.__name__: each for each in (openai, sdcpp, comfyui, fastsd)}


def _uploaded(server: Server, file: bytes) -> str:
    """The name under which ComfyUI keeps a picture."""
    kind = form({"overwrite": "true"}, {"image": file}, f"gsedit-{uuid4().hex[:12]}.png")
    answer = server.post("/upload/image", *kind)
    name, folder = part_of(server, answer, "name"), answer.get("subfolder")
    return f"{folder}/{name}" if folder else name


def _history(server: Server, number: str) -> Iterator[dict[str, Any]]:
    """Yield what became of a queued workflow, once it has ended; nothing where that takes too
    long."""
    deadline = time.monotonic() + server.timeout
    while time.monotonic() < deadline:
        history = server.get(f"/history/{urllib.parse.quote(number)}")
        if history != {}:
            yield part_of(server, history, number)
            return
        time.sleep(POLL)


def _filled(workflow: Any, values: Mapping[str, Any]) -> Any:
    """The workflow with every field replaced; a string that is one field becomes its value."""
    if isinstance(workflow, dict):
        return {key: _filled(value, values) for key, value in workflow.items()}
    if isinstance(workflow, list):
        return [_filled(value, values) for value in workflow]
    if not isinstance(workflow, str) or workflow in values:
        return values.get(workflow, workflow) if isinstance(workflow, str) else workflow
    for field, value in values.items():
        workflow = workflow.replace(field, str(value))
    return workflow


def _first(server: Server, answer: Any) -> bytes:
    """The first picture of an answer of OpenAI's shape."""
    return picture_of(server, part_of(server, answer, "data", 0, "b64_json"))


# ---- pictures ------------------------------------------------------------------------------------


def transparent(mask: bytes) -> bytes:
    """The mask as OpenAI has it: transparent where the edit belongs."""
    inside = Image.open(io.BytesIO(mask)).convert("L")
    picture = Image.new("RGBA", inside.size, (0, 0, 0, 255))
    picture.putalpha(Image.eval(inside, lambda value: 255 - value))
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()


def fitted(found: bytes, size: tuple[int, int], who: str) -> Image.Image:
    """The picture of a reply, in the size that was sent. Raises GseditError."""
    try:
        picture = Image.open(io.BytesIO(found)).convert("RGB")
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        raise GseditError(f"{who} answered {quoted(found)}, which is not a picture") from None
    if picture.size == size:
        return picture
    (width, height), (w, h) = size, picture.size
    if abs(w * height / (h * width) - 1) > ASPECT_ERROR:
        raise GseditError(
            f"{who} answered a picture of {w}x{h} pixels to one of {width}x{height}: the shapes "
            "must be equal; choose a --size that the model keeps"
        )
    return picture.resize(size, Image.Resampling.LANCZOS)


# ---- the program ---------------------------------------------------------------------------------


def main(words: list[str] | None = None) -> int:
    """Edit every picture of a folder; one that is in the other folder already is left alone."""
    try:
        options = _options(words)
        server = Server(options.url.rstrip("/"), options.timeout)
        pictures = sorted(options.input.glob("*.png"))
        if not pictures:
            raise InputError(f"{options.input} has no pictures (*.png): name a folder that does")
        for path in pictures:
            if not (options.output / path.name).exists():
                _edit(server, path, options)
    except GseditError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except OSError as error:  # a picture or mask that cannot be read, a full disk
        sys.stderr.write(f"{error}: correct the folders, or make room\n")
        return 1
    return 0


def _edit(server: Server, path: Path, options: argparse.Namespace) -> None:
    mask = None if options.masks is None else (options.masks / path.name).read_bytes()
    with Image.open(path) as picture:
        job = Job(path.read_bytes(), picture.size, mask, options.prompt, options.seed)
    edited = fitted(SERVERS[options.server](server, job, options), job.size, server.url)
    unfinished = options.output / f".{path.name}.part"
    edited.save(unfinished, "PNG")
    unfinished.replace(options.output / path.name)


def _options(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m gsedit.paper.editors.command.http",
        description=(__doc__ or "").split("\n")[0],
    )
    parser.add_argument("server", choices=list(SERVERS))
    parser.add_argument("url", help="where the server listens, as http://127.0.0.1:1234")
    parser.add_argument("input", type=Path, help="folder of the pictures to edit")
    parser.add_argument("output", type=Path, help="folder of the edited pictures")
    parser.add_argument("--prompt", required=True, help="the instruction")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--masks", type=Path, help="folder of masks, white where to edit")
    parser.add_argument("--workflow", type=Path, help="comfyui: a workflow in its API format")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds for one picture")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="one more field to send"
    )
    options = parser.parse_args(words)
    options.set = dict(_setting(each) for each in options.set)
    _check_url(options.url)
    if options.server == "comfyui":
        options.workflow = _workflow(options.workflow)
    return options


def _setting(text: str) -> tuple[str, Any]:
    """(name, value) of NAME=VALUE; a value that is JSON (a number, true) is taken as such."""
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--set {text}: write NAME=VALUE, as in --set steps=4")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def _check_url(url: str) -> None:
    try:
        parts = urllib.parse.urlsplit(url)
        is_url = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # brackets that are left open, a port that is no number
        is_url = False
    if not is_url:
        raise UsageError(f"{url} is no URL of a server: write it as http://127.0.0.1:1234")
    if key_of_user() and parts.scheme == "http" and not is_here(parts.hostname or ""):
        raise UsageError(f"{url} would get the key of {KEY} unencrypted: write https, or unset it")


def _workflow(path: Path | None) -> Any:
    if path is None:
        raise UsageError("comfyui needs --workflow FILE: save one of yours by 'Export (API)'")
    try:
        workflow = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no workflow in JSON ({error}): export it again") from None
    text = json.dumps(workflow)
    for field in ("{image}", "{prompt}"):
        if field not in text:
            raise InputError(
                f"{path} has no {field} in it: write it where the workflow names its picture or "
                "its prompt"
            )
    return workflow


if __name__ == "__main__":
    sys.exit(main())

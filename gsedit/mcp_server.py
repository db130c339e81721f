"""Verbs of gsedit as tools of the Model Context Protocol, for files below given folders only."""

from __future__ import annotations

import functools
import json
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import anyio

from gsedit.app.places import Places
from gsedit.app.worker import failure
from gsedit.errors import GseditError, UsageError
from gsedit.run.environment import load_extra
from gsedit.words.called import FILE

Tool = Callable[..., Awaitable[Any]]
WHOLE = ("auto", "all")
SHAPES = ("box:", "sphere:")
"""Beginnings of regions that name no file."""
PATIENCE = 1.5
"""Seconds that a cancelled command has for its checkpoint before it is killed: a client that leaves
gives its server two."""
INSTRUCTIONS = (
    "Edits captured 3D scenes (Gaussian splats) from a sentence. Paths are files below the folders "
    "that the server was started with; relative ones are below the first. Look at a scene with "
    "`render` before and after an edit. Nothing that exists is replaced."
)


@dataclass(frozen=True)
class Verbs:
    """The tools: each runs one command line in a process of its own, which ends with its call."""

    program: Sequence[str]
    """Words that start gsedit."""
    places: Places

    async def info(self, scene: str) -> dict[str, Any]:
        """Tell what a scene file holds: Gaussians, bounds, colors, format."""
        return await self._run("info", [self._path(scene)])

    async def edit(
        self,
        scene: str,
        sentence: str,
        output: str,
        region: str = "auto",
        accept_unread: bool = False,
    ) -> dict[str, Any]:
        """Edit a scene from a sentence, as in "turn it into bronze"; seconds to minutes.

        `output` is a new folder: scene.ply, before_after.png and edit.json. `region` that may
        change: auto, all, box:x0,y0,z0,x1,y1,z1 or sphere:x,y,z,r. With `accept_unread` words of
        the sentence that are not read stop nothing.
        """
        if region not in WHOLE and not region.startswith(SHAPES):
            raise UsageError("region must be auto, all, box:... or sphere:...")
        self._sentence(sentence)
        options = [f"--output={self._path(output)}", f"--region={region}"]
        options += ["--accept-unread"] * accept_unread
        return await self._run("edit", [self._path(scene), sentence], options)

    async def make(self, photos: str, sentence: str, output: str) -> dict[str, Any]:
        """Make an edited scene from a folder of photos or a video; many minutes.

        `output` is a new folder. An interrupted call goes on where it was.
        """
        self._sentence(sentence)
        words = [self._path(photos), sentence]
        return await self._run("make", words, [f"--output={self._path(output)}"])

    async def convert(self, scene: str, output: str) -> dict[str, Any]:
        """Write a scene in the format of the output's ending: .ply, .spz, .sog, .glb."""
        return await self._run("convert", [self._path(scene)], [f"--output={self._path(output)}"])

    async def render(self, scene: str, view: int = 0, size: int = 512) -> Any:
        """Draw a view of a scene as a picture; `size`: pixels of its longer side, 16 to 2048."""
        if view < 0 or not 16 <= size <= 2048:
            raise UsageError("view must be 0 or more, and size 16 to 2048")
        image = load_extra("mcp.server.mcpserver", "gsedit mcp").Image
        with TemporaryDirectory() as folder:
            picture = Path(folder, "view.png")
            options = [f"--output={picture}", f"--views={view}", f"--size={size}"]
            await self._run("render", [self._path(scene)], options)
            return image(data=picture.read_bytes(), format="png")

    def _path(self, text: str) -> str:
        return str(self.places.check(text))

    def _sentence(self, sentence: str) -> None:
        """Raise UsageError for a sentence that names a file elsewhere ('put hat.ply on it')."""
        for name in FILE.findall(sentence):
            self.places.check(name.strip("\"'"))

    async def _run(
        self, verb: str, words: Sequence[str], options: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Return the results of a command. Raises UsageError with what it says where it fails;
        a cancelled call ends the process."""
        command = [*self.program, verb, *options, "--json", "--", *words]
        code, out, errors = await _ran(command, self.places.folders[0])
        lines = (line for line in out.splitlines(keepends=True) if line[-1] == "\n")  # not cut off
        told = {each.get("type"): each for each in map(json.loads, lines)}
        if code:
            raise UsageError(failure(told.get("error"), errors.splitlines(), code))
        return told.get("result", {})


async def _ran(command: Sequence[str], folder: Path) -> tuple[int | None, str, str]:
    """Return the exit code of a command, and what it wrote to stdout and stderr.

    Where the call is cancelled, the command may write its checkpoint, and is killed if that lasts.
    """
    with TemporaryFile() as out, TemporaryFile() as errors:
        begun = anyio.open_process(command, stdin=DEVNULL, stdout=out, stderr=errors, cwd=folder)
        async with await begun as process:
            try:
                await process.wait()
            finally:
                if process.returncode is None:
                    process.terminate()
                    with anyio.move_on_after(PATIENCE, shield=True):
                        await process.wait()
        written = []
        for file in (out, errors):
            file.seek(0)
            written.append(file.read().decode(errors="replace"))
        return process.returncode, *written


def serve(program: Sequence[str], folders: Sequence[Path]) -> None:
    """Answer on stdin and stdout until stdin closes. Raises GseditError without mcp."""
    library = load_extra("mcp.server.mcpserver", "gsedit mcp")
    server = library.MCPServer("gsedit", instructions=INSTRUCTIONS)
    verbs = Verbs(program, Places(tuple(folder.resolve() for folder in folders)))
    for tool in (verbs.info, verbs.edit, verbs.make, verbs.convert, verbs.render):
        server.tool(description=tool.__doc__)(_told(tool, library.exceptions.ToolError))
    try:
        server.run("stdio")
    except Exception as error:  # anyio's groups of errors have no name before Python 3.11
        if not all(isinstance(each, BrokenPipeError) for each in getattr(error, "exceptions", [0])):
            raise  # else the client is gone


def _told(tool: Tool, failure: type[Exception]) -> Tool:
    """A tool whose errors the client reads."""

    @functools.wraps(tool)
    async def call(*words: Any, **named: Any) -> Any:
        try:
            return await tool(*words, **named)
        except GseditError as error:
            raise failure(str(error)) from None

    return call

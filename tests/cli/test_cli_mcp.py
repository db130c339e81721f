"""`gsedit mcp`, through the client of the official package."""

from __future__ import annotations

import asyncio
import os
import sys

import pytest
from command_line import gsedit


def test_tools_work_below_the_folders_alone(scene, tmp_path):
    mcp = pytest.importorskip("mcp", reason="needs gsedit[mcp]")
    given = tmp_path / "given"
    given.mkdir()
    scene.rename(given / "a.ply")
    (tmp_path / "b.ply").write_bytes((given / "a.ply").read_bytes())
    (given / "link.ply").symlink_to(tmp_path / "b.ply")

    async def converse():
        command = mcp.StdioServerParameters(
            command=sys.executable,
            args=["-m", "gsedit_cli", "mcp", str(given)],
            env=dict(os.environ),
        )
        async with mcp.Client(command) as client:
            names = {tool.name for tool in (await client.list_tools()).tools}
            told = await client.call_tool("info", {"scene": "a.ply"})
            refused = [
                await client.call_tool("info", {"scene": path})
                for path in ("link.ply", "../b.ply", str(tmp_path / "b.ply"), "--help/../../b.ply")
            ]
            for sentence in ("put ../b.ply on it", "put 'link.ply' on it", "undo"):
                given_words = {"scene": "a.ply", "sentence": sentence, "output": "out"}
                refused.append(await client.call_tool("edit", given_words))
            aside = {"scene": "a.ply", "output": "../c.ply"}
            refused.append(await client.call_tool("convert", aside))
            masked = {"scene": "a.ply", "sentence": "red", "output": "out", "region": "../m.png"}
            refused.append(await client.call_tool("edit", masked))
            return names, told, refused

    names, told, refused = asyncio.run(converse())
    assert names == {"info", "edit", "make", "convert", "render"}
    assert not told.is_error, told
    assert told.structured_content["gaussians"] == 5
    assert all(each.is_error for each in refused), refused
    assert "is outside of" in refused[0].content[0].text
    assert "edit: nothing is overwritten" in refused[6].content[0].text
    assert not (tmp_path / "c.ply").exists()
    assert not (given / "out").exists()


STAND_IN = """
import json, signal, sys, time
from pathlib import Path

scene = Path(sys.argv[-1])
signal.signal(signal.SIGTERM, lambda *_: (scene.with_suffix('.ended').touch(), sys.exit(130)))
scene.with_suffix('.begun').touch()
others = [scene.with_name(name) for name in ('one.begun', 'two.begun')]
while scene.stem == 'long' or not all(each.exists() for each in others):
    time.sleep(0.01)
print(json.dumps({'type': 'result', 'scene': scene.stem}))
"""
"""A program that ends when told to, or where both of two calls have begun."""


def test_a_call_ends_with_its_client_and_does_not_hold_up_others(tmp_path):
    mcp = pytest.importorskip("mcp", reason="needs gsedit[mcp]")
    (tmp_path / "stand_in.py").write_text(STAND_IN)
    code = (
        "import sys; from pathlib import Path; from gsedit.mcp_server import serve; "
        "serve([sys.executable, sys.argv[1] + '/stand_in.py'], [Path(sys.argv[1])])"
    )
    command = mcp.StdioServerParameters(command=sys.executable, args=["-c", code, str(tmp_path)])

    async def appears(name: str) -> None:
        while not (tmp_path / name).exists():
            await asyncio.sleep(0.01)
        (tmp_path / name).unlink()

    async def converse():
        async with mcp.Client(command) as client:
            long = asyncio.create_task(client.call_tool("info", {"scene": "long.ply"}))
            await appears("long.begun")
            pair = (client.call_tool("info", {"scene": f"{name}.ply"}) for name in ("one", "two"))
            told = await asyncio.gather(*pair)
            assert not (tmp_path / "long.ended").exists()
            long.cancel()
            await appears("long.ended")
            left = asyncio.create_task(client.call_tool("info", {"scene": "long.ply"}))
            await appears("long.begun")
        await appears("long.ended")
        left.cancel()
        return [each.structured_content["scene"] for each in told]

    assert asyncio.run(asyncio.wait_for(converse(), 60)) == ["one", "two"]


def test_without_the_package_the_extra_is_named(monkeypatch, tmp_path):
    for name in ("mcp", "mcp.server.mcpserver"):
        monkeypatch.setitem(sys.modules, name, None)
    done = gsedit("mcp", tmp_path)
    assert done.exit_code == 1
    assert "pip install 'gsedit[mcp]'" in done.stderr

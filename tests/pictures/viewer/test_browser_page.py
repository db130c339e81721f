"""The page in the browser: all splats inside, no network, the right layers in every state."""

import base64
import json
import re
import socket
import urllib.error
import urllib.request
from dataclasses import replace

import numpy as np
import pytest
import torch
from command_line import gsedit
from point_clouds import ball, cloud
from scipy.spatial.transform import Rotation

from gsedit.errors import UsageError
from gsedit.formats.scenes import save
from gsedit.pictures.viewer import browser
from gsedit.scene.framing import framing_camera
from gsedit.views.viewpoints import Viewpoint
from rasterizer import concatenate


def recolored(scene, rows):
    sh = scene.sh.clone()
    sh[rows] += 0.5
    return replace(scene, sh=sh)


@pytest.fixture
def viser():
    return pytest.importorskip("viser", exc_type=ImportError)


def some_page(**more):
    scene = ball(200)
    rows = torch.arange(200) < 30
    after = recolored(scene, rows)
    return browser.make_page(
        scene, framing_camera(scene, size=(64, 48)), after=after, region=torch.arange(200) < 50,
        **more,
    )  # fmt: skip


def test_covariances_are_those_of_the_gaussians():
    generator = torch.Generator().manual_seed(0)
    scene = ball(5).to(torch.float64).map(lambda f: f + torch.rand(f.shape, generator=generator))
    splats = browser.splats_of(scene)
    turns = Rotation.from_quat(scene.quats.numpy()[:, [1, 2, 3, 0]]).as_matrix()
    expected = turns @ (np.eye(3) * scene.scales.numpy()[:, None] ** 2) @ turns.transpose(0, 2, 1)
    assert np.allclose(splats.covariances, expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("scene", ["before", "after"])
@pytest.mark.parametrize("tinted", [False, True])
def test_every_state_shows_each_gaussian_once(scene, tinted):
    page = some_page()
    shown = browser.shown_layers(page.layers, scene, tinted)
    means = np.concatenate([layer.splats.means for layer in page.layers if layer.name in shown])
    assert sorted(map(tuple, means.tolist())) == sorted(map(tuple, ball(200).means.tolist()))
    # 30 Gaussians changed, all in the region of 50: the other 150 are in the page once
    assert {layer.name: len(layer.splats) for layer in page.layers} == {
        "both_outside": 150, "both_inside": 20, "both_tinted": 20,
        "before_inside": 30, "before_tinted": 30, "after_inside": 30, "after_tinted": 30,
    }  # fmt: skip


def test_far_splats_look_the_same_from_the_middle_and_fit_float16():
    scene = concatenate(ball(200), cloud(torch.tensor([[1e6, 0.0, 0.0]])))
    scene.log_scales[-1] = 9.0
    page = browser.make_page(scene, framing_camera(ball()))
    splats = page.placed(page.layers[0].splats)
    assert np.linalg.norm(splats.means, axis=1).max() <= 1.001 * browser.FARTHEST * browser.RADIUS
    assert np.isfinite(splats.covariances.astype(np.float16)).all()
    angle = np.sqrt(splats.covariances[-1, 0, 0]) / np.linalg.norm(splats.means[-1])
    assert angle == pytest.approx(np.exp(9.0) / 1e6, rel=1e-3)


def test_the_file_holds_all_splats_and_names_no_host(viser, tmp_path):
    import msgspec
    import zstandard

    page = some_page(cameras=[Viewpoint("a", framing_camera(ball()))], title="</title> & co")
    browser.write_page(page, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<title>&lt;/title&gt; &amp; co</title>" in text
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", text)
    assert not re.search(r"(?:fetch|import|Worker|WebSocket)\(\s*[\"'`](?:https?|wss?):", text)
    (embedded,) = re.findall(r'__VISER_EMBED_DATA__="([^"]+)"', text)
    packed = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(embedded)[8:])
    length = int.from_bytes(packed[:8], "little")
    record = msgspec.msgpack.decode(packed[8 : 8 + length])
    splats = [m for _, m in record["messages"] if m["type"] == "GaussianSplatsMessage"]
    assert [m["name"] for m in splats] == [f"/{layer.name}" for layer in page.layers]
    assert sum(record["binaryBufferLengths"]) == 32 * sum(len(each.splats) for each in page.layers)
    (data,) = re.findall(r"const page = (\{.*\});", text)
    data = json.loads(data)
    assert data["cameras"] == 1
    assert data["states"]["before true"] == browser.shown_layers(page.layers, "before", True)
    with pytest.raises(UsageError, match="already exists"):
        browser.write_page(page, tmp_path / "page.html")


def test_the_live_page_answers_no_other_web_site(viser):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    protocol = [f"viser-v{viser.__version__}"]
    with browser.server(some_page(), port=0) as (live, _):
        port = live.get_port()
        for name in ("127.0.0.1", "localhost"):
            own = f"http://{name}:{port}"
            with connect(f"ws://{name}:{port}", origin=own, subprotocols=protocol) as page:
                assert page.recv(5)
        for host, origin in (
            ("127.0.0.1", "http://evil.example"),
            ("127.0.0.1", "http://localhost:3000"),  # another program of this machine
            ("127.0.0.1", "null"),  # a page from a file
            ("127.0.0.1", None),
            ("evil.example", f"http://evil.example:{port}"),  # a name that points here
            ("localhost.evil.example", f"http://localhost.evil.example:{port}"),
        ):
            connection = socket.create_connection(("127.0.0.1", port))
            with pytest.raises(InvalidStatus, match="403"):
                connect(
                    f"ws://{host}:{port}", sock=connection, origin=origin, subprotocols=protocol
                )
        request = urllib.request.Request(
            f"http://127.0.0.1:{port}/", headers={"Host": "evil.example"}
        )
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(request)


def test_view_writes_a_page_with_the_region_of_an_edit(viser, tmp_path):
    scene = ball(200)
    save(scene, tmp_path / "before.ply")
    save(recolored(scene, torch.arange(200) < 30), tmp_path / "edit" / "scene.ply")
    np.save(tmp_path / "edit" / "region.npy", np.arange(200) < 30)
    out = tmp_path / "page.html"
    result = gsedit("view", tmp_path / "before.ply", tmp_path / "edit", "-o", out)
    assert result.exit_code == 0, result.stderr
    assert result.stdout == f"{out}\n"
    assert "region.npy" in result.stderr
    text = out.read_text()
    assert '"after_tinted"' in text
    assert "<title>before.ply | scene.ply</title>" in text

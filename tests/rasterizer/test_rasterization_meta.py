"""Report of `rasterization` on each Gaussian: positions with gradients, radii, what is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from closeness import leaves, relative
from gsplat_call import cloud, gsplat_arguments, loss_of
from scenes import camera, gaussian

from rasterizer import Camera, rasterization
from rasterizer.reference import render_reference


@dataclass(frozen=True, eq=False)
class Watched(Camera):
    """Keeps the centers on the picture that the reference computes, in depth order."""

    def project(self, points):
        xy, z = super().project(points)
        xy.retain_grad()
        CENTERS[:] = [xy]
        return xy, z


CENTERS: list[torch.Tensor] = []


def test_means2d_takes_the_gradient_of_the_centers_on_the_picture():
    scene = leaves(cloud())
    color, alpha, meta = rasterization(**gsplat_arguments(scene, camera()))
    meta["means2d"].retain_grad()  # as gsplat's users write
    loss_of(color[0], alpha[0, ..., 0]).backward()
    view = camera()
    found = render_reference(leaves(cloud()), Watched(**vars(view)))
    loss_of(found.color, found.alpha).backward()
    wanted = torch.empty_like(scene.means[:, :2])
    wanted[scene.means[:, 2].argsort()] = CENTERS[0].grad
    assert meta["means2d"].grad.shape == (1, 60, 2)
    assert relative(meta["means2d"].grad[0], wanted) < 1e-8


def test_meta_serves_densification():
    """gsplat's default strategy reads these after a backward pass with packed=False."""
    scene = leaves(cloud().to(torch.float32))
    views = camera(), replace(camera(), cx=30.0)
    color, _, meta = rasterization(**gsplat_arguments(scene, *views), packed=False)
    color.sum().backward()
    grads = meta["means2d"].grad.clone()
    grads[..., 0] *= meta["width"] / 2 * meta["n_cameras"]
    grads[..., 1] *= meta["height"] / 2 * meta["n_cameras"]
    seen = (meta["radii"] > 0).all(-1)
    assert meta["radii"].shape == (2, 60, 2)
    assert meta["radii"].dtype == torch.int32
    assert 10 < seen[0].sum() < 60
    assert (grads[seen].norm(dim=-1) > 0).float().mean() > 0.8  # the others are hidden, or miss
    assert not grads[~seen].any()
    assert meta["gaussian_ids"] is None


def test_what_is_not_drawn_has_radius_zero():
    rows = [gaussian((0.0, 0.0, z), (0.05,) * 3) for z in (-1.0, 0.005, 2.0, 50.0, 2000.0)]
    aside, faint = gaussian((9.0, 0.0, 2.0)), gaussian((0.0, 0.0, 2.0), opacity=0.003)
    joined = gsplat_arguments(rows[0], camera())
    for name in ("means", "quats", "scales", "opacities", "colors"):
        parts = (gsplat_arguments(r, camera())[name] for r in (*rows, aside, faint))
        joined[name] = torch.cat(list(parts))
    drawn = [False, False, True, True, False, False, False]
    _, _, meta = rasterization(**joined, far_plane=100.0)
    assert (meta["radii"][0] > 0).all(-1).tolist() == drawn
    for name in ("means2d", "depths", "conics", "opacities"):
        assert not meta[name][0, ~torch.tensor(drawn)].any()
    clip = float(meta["radii"][0, 3].max())
    _, _, clipped = rasterization(**joined, far_plane=100.0, radius_clip=clip)
    assert (clipped["radii"][0] > 0).all(-1).tolist() == [False, False, True, *[False] * 4]

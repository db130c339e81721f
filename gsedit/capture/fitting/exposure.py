"""Exposure and white balance of photos: an affine map of colors a photo.

A photo is compared with the render after that map, so that the scene need not explain with floaters
and view-dependent color what the camera did. The map of a photo is the least-squares one from its
render to it, drawn to the identity, and moved there by a part whenever the photo is drawn. The mean
of all maps is undone first: a scene that is too dark is not the photos' fault. Renders of the
fitted scene, and its measurement on held-out photos, have no such map.

`v` photos, of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.run.state import tensor_like
from gsedit.views.dataset import View

TO_IDENTITY = (0.01, 1.0, 0.3)
"""How strongly the map is drawn to the identity, beside a mean squared error: gains of channels,
their mixtures, offsets. Exposure and white balance are gains: freer maps drift with the scene."""
PART = 0.5
"""Share of the way to the least-squares map that a map moves whenever its photo is drawn."""
SPREAD = 0.06
"""Standard deviation over the photos, of what the maps make of mid-grey, above which exposures
differ. The bear's, taken in one light, have at most 0.04 while the scene is unfinished and 0.02 at
the end; gains of 0.15 have 0.15."""
MIN_DRAWS = 2
"""Times that every photo was drawn, before their maps say whether exposures differ."""
MIN_PHOTOS = 10
"""Photos that are trained on, below which maps do not say whether exposures differ: of 7 equally
exposed ones, in 4 of 12 short fits they spread by more than SPREAD for some steps; of 4, in 4 of 6,
and by up to 0.19; of 10, in none of 6."""


class Exposures:
    """The maps of a fit's photos, by name; they change as the fit goes on."""

    def __init__(self, views: Sequence[View], mode: str) -> None:
        """`mode`: on, off, or auto: on while the maps' `spread` is above SPREAD, of at least
        MIN_PHOTOS photos."""
        self.mode = "off" if mode == "auto" and len(views) < MIN_PHOTOS else mode
        self._rows = {view.name: i for i, view in enumerate(views)}
        self.maps = torch.eye(3, 4).repeat(len(views), 1, 1)
        self.moves = torch.zeros_like(self.maps)
        """Moves of the maps in this step, made by `move`."""
        self.seen = torch.zeros(len(views))
        """How many times each photo was drawn; moves with the maps."""
        self._new = torch.zeros_like(self.seen)

    @property
    def spread(self) -> float:
        """Standard deviation over photos of the maps' mid-grey, the mean of the channels'."""
        maps = self._relative(self.maps)
        greys = maps[..., :3].sum(-1) + 2 * maps[..., 3]  # in units of mid-grey
        return float(greys.std(0, correction=0).mean())

    @property
    def active(self) -> bool:
        """Whether photos are compared after their maps."""
        if self.mode != "auto":
            return self.mode == "on"
        return bool(self.seen.min() >= MIN_DRAWS) and self.spread > SPREAD

    def _relative(self, maps: Float[Tensor, "*n 3 4"]) -> Float[Tensor, "*n 3 4"]:
        """Maps after what is common to all photos was undone: that is the scene's to learn."""
        common = self.maps.mean(0)
        gains = maps[..., :3] @ torch.linalg.inv(common[:, :3])
        return torch.cat((gains, maps[..., 3:] - gains @ common[:, 3:]), -1)

    def compensated(
        self, picture: Float[Tensor, "h w 3"], view: View, photo: Float[Tensor, "h w 3"]
    ) -> Float[Tensor, "h w 3"]:
        """The picture of a view as its camera would have taken it. Photos with transparency stay
        as they are."""
        if self.mode == "off" or view.alpha is not None:
            return picture
        row = self._rows[view.name]
        with torch.no_grad():
            self.moves[row] += PART * (_least_squares(picture, photo, view) - self.maps[row])
            self._new[row] += 1
        if not self.active:
            return picture
        affine = self._relative(self.maps[row] + self.moves[row])
        return picture @ affine[:, :3].T.to(picture) + affine[:, 3].to(picture)

    def move(self) -> None:
        """The end of a step: the maps move."""
        self.maps += self.moves
        self.seen += self._new
        self.moves.zero_()
        self._new.zero_()

    def state(self) -> dict[str, Tensor]:
        """Return what changes, without a copy."""
        return {"maps": self.maps, "seen": self.seen}

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on where another was."""
        self.maps = tensor_like(state, "maps", self.maps)
        self.seen = tensor_like(state, "seen", self.seen)


def _least_squares(
    picture: Float[Tensor, "h w 3"], photo: Float[Tensor, "h w 3"], view: View
) -> Float[Tensor, "3 4"]:
    """The affine map from the picture to the photo, inside the mask, drawn to the identity."""
    thin = (slice(None, None, 2), slice(None, None, 2))  # a fourth of the pixels says as much
    x, y = (each.detach()[thin].reshape(-1, 3) for each in (picture, photo))
    if view.mask is not None:
        inside = view.mask[thin].reshape(-1)
        x, y = x[inside], y[inside]
    if not len(x):
        return torch.eye(3, 4)
    x, y = x.clamp(0, 1), y.to(x)
    inner, mean = (x.T @ x / len(x)).double(), x.mean(0).double()
    moments = torch.eye(4, dtype=torch.float64)
    moments[:3, :3], moments[:3, 3], moments[3, :3] = inner, mean, mean
    with_photo = torch.cat((x.T @ y / len(x), y.mean(0)[None])).double()
    gain, mixture, offset = TO_IDENTITY
    weights = torch.full((3, 4), mixture, dtype=torch.float64)
    weights[:, :3].fill_diagonal_(gain)
    weights[:, 3] = offset
    identity = torch.eye(3, 4, dtype=torch.float64)
    system = moments + torch.diag_embed(weights)
    return torch.linalg.solve(system, with_photo.T + weights * identity).float()

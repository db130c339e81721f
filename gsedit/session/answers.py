"""What a 2D editor answered, before anything is made of it. `v` views."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from gsedit.errors import GseditError


def checked(
    images: Float[Tensor, "v y x c"], originals: Float[Tensor, "v h w 3"], names: Sequence[str]
) -> Float[Tensor, "v h w 3"]:
    """The edited views, in [0, 1], as they are; values outside are brought to its ends.

    `names` of the views. Raises GseditError, with the view, for pictures of another number or size
    than the originals, and for one that holds NaN or infinity.
    """
    if images.shape != originals.shape:
        made, given = (" x ".join(map(str, each.shape)) for each in (images, originals))
        raise GseditError(
            f"the 2D editor made pictures of another size: {made} of {given} (views, height, "
            "width, colours); mend the editor, or choose another with --editor"
        )
    for name, image in zip(names, images):
        bad = ~image.isfinite()
        if bad.any():
            y, x, _ = bad.nonzero()[0].tolist()
            raise GseditError(
                f"the 2D editor made a picture of view {name} with {int(bad.sum())} values that "
                f"are not finite numbers, the first at pixel ({x}, {y}): try --precision float32, "
                "another --seed or another --editor"
            )
    return images.clamp(0, 1)

"""Options of mask providers: whoever finds what a phrase names in pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option
from ..core.console import print_message

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from gsedit.select.masked import MaskProvider


@dataclass(frozen=True)
class MaskOptions:
    """Options of the network or program that finds what --phrase names in pictures."""

    masks: str | None = option(
        None,
        "Find the phrase in pictures of the scene. command: by a program of yours (--masks-run); "
        "clipseg, grounded-sam: by networks of transformers (--masks-model); or a name that a "
        "package adds. Without it, by colors, sizes and places alone.",
        "NAME",
    )
    masks_run: str | None = option(
        None,
        'The program of --masks command, as in "my_segmenter {input} {output} {phrase}". It must '
        "write to the folder {output} a mask (PNG, white where it is) for each PNG in {input}. "
        "No shell is involved.",
        "COMMAND",
    )
    masks_model: str | None = option(
        None,
        "Folder of CLIPSeg's weights, or of GroundingDINO's for grounded-sam.",
        "FOLDER",
    )
    masks_sam: str | None = option(None, "Folder of SAM's weights, for grounded-sam.", "FOLDER")

    def check_unused(self) -> None:
        """Raise UsageError where any is given, for a sentence that a 2D editor draws."""
        if any(vars(self).values()):
            raise UsageError(
                "--masks finds what is changed on the Gaussians, and a 2D editor draws this: save "
                "what it finds with gsedit select --phrase ... --as NAME, and add --region NAME"
            )

    def make(self, phrase: str | None) -> MaskProvider | None:
        """Return the provider, which prints a line a picture; None where none is named.

        Raises UsageError for an option that it does not take, one without --masks, and --masks
        without a phrase, or with one that it cannot look for.
        """
        given = {"run": self.masks_run, "model": self.masks_model, "sam": self.masks_sam}
        if self.masks is None:
            for name, value in given.items():
                if value is not None:
                    raise UsageError(f"--masks-{name} is for --masks: add its NAME")
            return None
        if phrase is None:
            raise UsageError('--masks looks for a phrase: add --phrase "the chair"')
        from gsedit.editors import make_masks

        provider = make_masks(self.masks, **given)
        provider.check(phrase)
        return Told(provider)


@dataclass(frozen=True, eq=False)
class Told:
    """A MaskProvider that prints what it does."""

    provider: MaskProvider

    @property
    def name(self) -> str:
        """The name of the provider itself."""
        return self.provider.name

    def check(self, phrase: str) -> None:
        """Raise UsageError as the provider does."""
        self.provider.check(phrase)

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield the masks of the provider."""
        print_message(f"masks: {self.name} looks for {phrase!r} in {len(pictures)} pictures")
        for number, mask in enumerate(self.provider.masks(pictures, phrase), start=1):
            share = float((mask > 0.5).float().mean())  # of soft masks, more may count
            print_message(f"masks: {number}/{len(pictures)} {100 * share:.1f} % of the picture")
            yield mask

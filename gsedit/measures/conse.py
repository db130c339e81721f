"""A second opinion on whether a picture looks like a text, from published weights that install as
packages. It is not CLIP.

ConSE (Norouzi et al. 2014, "Zero-Shot Learning by Convex Combination of Semantic Embeddings",
eq. 2): a picture's vector is the sum over the likeliest classes of ImageNet of probability times
the sentence vector of the class's name, at unit length. The classifier is EfficientNet-Lite0, the
sentence vectors are those that read instructions (gsedit.words). It knows 1000 things and no
colours, materials or weather but through them: coarse, and independent of what was trained here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.measures.efficientnet import load_classifier
from gsedit.words.reader import Reader, load_reader
from gsedit.words.wordpiece import tokenise

NAMES = Path(__file__).with_name("imagenet_classes.txt")
"""The first word of WordNet 3.0 for each class of ImageNet (ILSVRC 2012), in order."""
LIKELIEST = 10
"""Classes that are summed: the T of the paper, whose best value it was."""


Classifier = Callable[[Float[Tensor, "n h w 3"]], Float[Tensor, "n 1000"]]
"""From pictures in [0, 1] to probabilities of ImageNet's classes."""


@dataclass(frozen=True, eq=False)
class Conse:
    """Pictures and texts as vectors of one space, by way of ImageNet's classes."""

    classifier: Classifier
    reader: Reader
    known: dict[int, Float[Tensor, " d"]] = field(default_factory=dict)
    """Vectors of the classes that were met: a name takes the encoder some milliseconds."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the classes, in order."""
        return tuple(NAMES.read_text(encoding="utf-8").splitlines())

    def class_vector(self, index: int) -> Float[Tensor, " d"]:
        """The unit vector of the name of a class."""
        if index not in self.known:
            self.known[index] = self.text(self.names[index])
        return self.known[index]

    @torch.no_grad()
    def text(self, text: str) -> Float[Tensor, " d"]:
        """The unit vector of a text."""
        return self.reader.encoder(torch.tensor([tokenise(text, self.reader.vocabulary)]))[0]

    @torch.no_grad()
    def images(self, pictures: Float[Tensor, "n h w 3"]) -> Float[Tensor, "n d"]:
        """Unit vectors of pictures in [0, 1]."""
        probable = self.classifier(pictures).topk(LIKELIEST)
        vectors = torch.stack(
            [
                torch.stack([self.class_vector(index) for index in row])
                for row in probable.indices.tolist()
            ]
        )
        return F.normalize(torch.einsum("nk,nkd->nd", probable.values, vectors), dim=-1)

    def values(
        self, text: str, edited: Float[Tensor, "h w 3"], unedited: Float[Tensor, "h w 3"] | None
    ) -> dict[str, float]:
        """The cosine of the edited picture and the text, and how much more that is than the
        unedited picture's, where there is one."""
        wanted = self.text(text)
        after = float(self.images(edited[None])[0] @ wanted)
        if unedited is None:
            return {"conse_similarity": after}
        before = float(self.images(unedited[None])[0] @ wanted)
        return {"conse_similarity": after, "conse_rise": after - before}


@lru_cache(maxsize=1)
def load_conse() -> Conse | None:
    """None where the package of the classifier's weights is not installed. Raises InputError."""
    classifier = load_classifier()
    return None if classifier is None else Conse(classifier, load_reader())

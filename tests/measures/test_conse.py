"""ConSE, the second opinion from published weights: its formula, and what it sees in a photo."""

from __future__ import annotations

import pytest
import torch
from shared_data import DATA

from gsedit.files.pictures import read_picture
from gsedit.measures import efficientnet
from gsedit.measures.conse import LIKELIEST, NAMES, Conse, load_conse
from gsedit.words.reader import load_reader


def certain_of(index):
    """A classifier that sees nothing but one class."""

    def classify(pictures):
        return torch.nn.functional.one_hot(torch.tensor([index]), 1000).float()

    return Conse(classify, load_reader())


def test_a_certain_picture_has_the_vector_of_its_class():
    names = NAMES.read_text(encoding="utf-8").splitlines()
    assert len(names) == 1000
    conse = certain_of(names.index("goldfish"))
    picture = torch.zeros(8, 8, 3)
    assert conse.images(picture[None])[0].allclose(conse.text("goldfish"), atol=1e-5)
    values = conse.values("a goldfish", picture, picture)
    assert values["conse_similarity"] > 0.8
    assert values["conse_rise"] == 0
    assert set(conse.values("a goldfish", picture, None)) == {"conse_similarity"}
    assert LIKELIEST == 10


def test_without_the_package_there_is_no_second_opinion(monkeypatch):
    monkeypatch.setattr(efficientnet, "PACKAGE", "no_such_package")
    efficientnet.load_classifier.cache_clear()
    load_conse.cache_clear()
    assert load_conse() is None
    assert not efficientnet.is_installed()
    monkeypatch.undo()
    efficientnet.load_classifier.cache_clear()
    load_conse.cache_clear()


@pytest.mark.skipif(not efficientnet.is_installed(), reason="efficientnet-lite0 is not installed")
def test_a_photo_of_a_bear_looks_more_like_a_bear_than_like_a_ship():
    photos = DATA / "bear" / "images"
    if not photos.is_dir():
        pytest.skip("the photos of the bear are not here")
    conse = load_conse()
    assert conse is not None
    picture = read_picture(sorted(photos.iterdir())[0])
    probabilities = conse.classifier(picture[None])
    assert probabilities.sum().item() == pytest.approx(1, abs=1e-4)
    bear, ship = (
        conse.values(text, picture, None)["conse_similarity"] for text in ("a bear", "a ship")
    )
    assert bear > ship + 0.1

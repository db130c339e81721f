"""Sentences become pieces of a vocabulary as in BERT."""

from __future__ import annotations

import pytest

from gsedit.words.wordpiece import MAX_PIECES, pieces_of, tokenise, words_of

PIECES = ("[UNK]", "[CLS]", "[SEP]", "snow", "make", "it", "##y", "##ing", ",", "!", "café", "cafe")
VOCABULARY = {piece: row for row, piece in enumerate(PIECES)}


def pieces(sentence: str) -> list[str]:
    return [PIECES[row] for row in tokenise(sentence, VOCABULARY)]


def test_case_accents_and_white_space_do_not_matter():
    assert words_of("  Make it\tSNOW,\n Café_1!") == [
        "make",
        "it",
        "snow",
        ",",
        "cafe",
        "_",
        "1",
        "!",
    ]
    assert pieces("MAKE it café") == ["[CLS]", "make", "it", "cafe", "[SEP]"]


def test_a_word_is_its_longest_pieces_or_unknown():
    assert pieces("snowy snowing snowman") == [
        "[CLS]", "snow", "##y", "snow", "##ing", "[UNK]", "[SEP]"
    ]  # fmt: skip
    assert pieces_of("snow" * 30, VOCABULARY) == [0]  # longer than any word


@pytest.mark.parametrize("sentence", ["", "?", "日本語", "snow " * 1000, "\0", "🎉"])
def test_any_text_has_pieces_between_both_ends(sentence):
    rows = tokenise(sentence, VOCABULARY)
    assert 2 <= len(rows) <= MAX_PIECES
    assert (rows[0], rows[-1]) == (1, 2)

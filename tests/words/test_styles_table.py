from collections import Counter

from gsedit.words.lexicon import LONGEST, TABLE, rows_of
from gsedit.words.tokens import tokens

ROWS = rows_of(TABLE.with_name("styles.txt"))


def test_every_number_of_the_network_has_one_name():
    assert {kind for kind, _, _ in ROWS} == {"style"}
    assert sorted(int(value.rpartition(" ")[2]) for _, value, _ in ROWS) == list(range(26))


def test_a_phrase_asks_for_one_style_and_is_spelled_as_sentences_are():
    phrases = Counter(
        phrase for _, value, row in ROWS for phrase in (value.rpartition(" ")[0], *row)
    )
    assert [phrase for phrase, count in phrases.items() if count > 1] == []
    assert [phrase for phrase in phrases if " ".join(tokens(phrase)) != phrase] == []
    assert max(len(phrase.split()) for phrase in phrases) <= LONGEST

from gsedit.paper.editors.painter.drawn import DRAWN
from gsedit.words.lexicon import LIKE, LONGEST, STYLES, names, near_styles, rows_of, style_words
from gsedit.words.scan import scanned, tokens

EVERY = rows_of(STYLES)
ROWS = [row for row in EVERY if row[0] == "style"]


def test_every_number_of_the_network_and_every_rule_has_one_name():
    assert {kind for kind, _, _ in EVERY} == {"style", "near"}
    numbers = {int(number): name for name, _, number in (v.rpartition(" ") for _, v, _ in ROWS)}
    assert sorted(numbers) == [*range(26 + len(DRAWN))] == [*range(len(ROWS))]
    assert {numbers[each] for each in range(26, len(ROWS))} == DRAWN.keys()


def test_a_phrase_is_spelled_as_sentences_are():
    phrases = [each for _, value, row in ROWS for each in (value.rpartition(" ")[0], *row)]
    assert [phrase for phrase in phrases if " ".join(tokens(phrase)) != phrase] == []
    assert max(len(phrase.split()) for phrase in phrases) <= LONGEST


def test_no_phrase_but_a_name_has_another_meaning():
    for phrase, name in style_words().items():
        (word,) = scanned(phrase)
        assert (word.kind, word.value) == ("look", name), phrase


def test_every_look_without_a_route_has_three_near_styles():
    assert near_styles().keys() | {LIKE} >= names("look") >= near_styles().keys()
    assert all(len({*each} & set(style_words().values())) == 3 for each in near_styles().values())

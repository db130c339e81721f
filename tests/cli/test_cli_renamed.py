"""Old verbs and options: each answers with the command line that replaces it."""

from __future__ import annotations

import json
import shlex

import pytest
from command_line import gsedit, one_line

OLD_SELECTIONS = [
    (("--box", "-1,-2,-3,1,2,3"), "box(-1,-2,-3,1,2,3)"),
    (("--box=-1,-2,-3,1,2,3",), "box(-1,-2,-3,1,2,3)"),
    (("--box", "-,-,-,0,-,-"), "x <= 0"),
    (("--oriented-box", "0,0,0,2,2,2,0,0,45"), "oriented_box(0,0,0,2,2,2,rz=45)"),
    (("--sphere", "-1,0,0,1"), "sphere(-1,0,0,1)"),
    (("--ellipsoid", "0,0,0,1,2,3"), "ellipsoid(0,0,0,1,2,3)"),
    (("--cylinder", "0,0,0,0,0,1,2"), "cylinder(0,0,0,0,0,1,2)"),
    (("--half-space", "0,0,0,-1,0,0"), "half_space(0,0,0,-1,0,0)"),
    (("--min-opacity", 0.5), "opacity >= 0.5"),
    (("--max-opacity", 0.5), "opacity <= 0.5"),
    (("--min-size", 1), "size >= 1"),
    (("--max-size", 1), "size <= 1"),
    (("--min-anisotropy", 4), "anisotropy >= 4"),
    (("--max-anisotropy", 4), "anisotropy <= 4"),
    (("--near-color", "#808080,50"), "near(#808080, 50)"),
    (("--near-color", "#888"), "near('888', 10)"),
    (("--largest", "2,opacity"), "largest(2, opacity)"),
    (("--smallest", "40%,distance(0,0,0)"), "smallest('40%', distance(0,0,0))"),
    (("--min-opacity", 0.3, "--max-size", 2), "opacity >= 0.3 and size <= 2"),
    (("--cluster", "largest", "--cluster-gap", 1.5), "cluster(gap=1.5)"),
    (("--cluster", "2"), "cluster(2)"),
    (("--cluster", "-1,0,0", "--cluster-gap", 1), "cluster_at(-1,0,0,1)"),
    (("--largest", "1,x", "--grow", 2), "grow(largest(1,x),2)"),
    (("--largest", "3,x", "--shrink", 1), "shrink(largest(3,x),1)"),
]
"""Old options of a selection, and the expression that says the same."""


def replacement(*words: object) -> list[str]:
    """The command line that gsedit names instead of an old one."""
    done = gsedit(*words)
    assert done.exit_code == 2
    assert one_line(done.stderr)
    program, *new = shlex.split(done.stderr.partition("the new one: ")[2])
    assert program == "gsedit"
    return new


def kept(*words: object) -> int:
    """How many Gaussians a command would keep."""
    done = gsedit(*words, "--dry-run", "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)["gaussians"]


@pytest.mark.parametrize(("words", "text"), OLD_SELECTIONS, ids=lambda each: str(each))
def test_an_old_selection_answers_with_an_expression_that_says_the_same(scene, words, text):
    new = replacement("filter", scene, *words)
    assert new[:3] == ["filter", str(scene), "--where"]
    assert kept(*new) == kept("filter", scene, "--where", text)
    inverted = replacement("filter", scene, *words, "--invert")
    assert kept(*inverted) == 5 - kept(*new)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("crop a.ply --sphere 0,0,0,1 -o b.ply", "filter a.ply -o b.ply --where sphere(0,0,0,1)"),
        ("check a.ply --strict", "info --check a.ply --strict"),
        ("repair a.ply -o b.ply", "clean --repair a.ply -o b.ply"),
        ("order a.ply -o b.ply", "convert a.ply -o b.ply --order morton"),
        ("order a.ply --by importance", "convert a.ply --order importance"),
        ("reduce-sh a.ply --degree 1", "convert a.ply --sh-degree 1"),
        ("edit a.ply gold --rounds 2", "edit a.ply gold --batches 2"),
        ("lod a.ply --share 30% -o out", "decimate a.ply 30% -o out --levels 4"),
        ("recover out -o b.ply", "convert out -o b.ply"),
        ("preview a.ply", "view a.ply --window"),
        ("preview a.ply -o b.png", "view a.ply -o b.png"),
        ("editors --json", "list editors --json"),
        ("settings edit", "list settings edit"),
        ("remove-background a.ply --data b", "filter a.ply --data b --where subject()"),
        ("remove-background a.ply --within 0.6", "filter a.ply --where middle(0.6)"),
        ("merge a.ply b.ply then order", "merge a.ply b.ply then convert --order morton"),
    ],
)
def test_an_old_verb_answers_with_the_new_one(old, new):
    assert " ".join(replacement(*old.split())) == new


def test_arguments_are_quoted_and_other_selections_kept():
    words = ("select", "a b.ply", "--where", "x > 1 or y > 1", "--grow", 2, "-o", "c.npy")
    expected = ["select", "a b.ply", "-o", "c.npy", "--where", "grow(x > 1 or y > 1, 2)"]
    assert replacement(*words) == expected
    words = ("recolor", "a.ply", "--min-size", 1, "--where", "x > 1 or y > 1")
    assert replacement(*words)[-1] == "size >= 1 and (x > 1 or y > 1)"
    words = ("select", "a.ply", "--region", "auto", "--prompt", "as gold", "--invert")
    assert replacement(*words)[-1] == "not (subject('as gold'))"
    words = ("filter", "a.ply", "--region", "b.npy", "--shrink", 1)
    assert replacement(*words)[-1] == "shrink(flags('b.npy'), 1)"


def test_new_command_lines_and_sentences_are_left_alone(scene, tmp_path):
    for words in (("edit", scene, "order", "--min-size"), ("view", "--min-opacity", 0.5)):
        assert "the new one" not in gsedit(*words).stderr

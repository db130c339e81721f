"""The bootstrap over views: coverage, views as the unit, pairs of views, and few views."""

import numpy as np

from gsedit.measures.formulas import FEWEST_VIEWS, interval, mean_interval


def ratio(sums):
    return sums[0] / sums[1]


def test_the_interval_covers_a_known_mean_about_as_often_as_it_says():
    random = np.random.default_rng(0)
    for views in (5, 20):
        trials = [mean_interval(random.normal(3, 1, views).tolist()) for _ in range(150)]
        covered = np.mean([low <= 3 <= high for low, high in trials])
        assert 0.9 < covered < 0.99


def test_what_belongs_to_one_view_is_drawn_together():
    """A hundred pixels of each of ten views that share an error tell no more than ten."""
    random = np.random.default_rng(1)
    views = np.repeat(np.arange(10), 100)
    values = random.normal(0, 1, 10)[views] + random.normal(0, 0.1, 1000)
    rows = [(value, 1.0) for value in values]
    by_view = interval(rows, [(v,) for v in views.tolist()], ratio)
    by_pixel = interval(rows, [(i,) for i in range(1000)], ratio)
    assert by_view[1] - by_view[0] > 5 * (by_pixel[1] - by_pixel[0])


def test_pairs_that_share_a_view_are_not_independent():
    random = np.random.default_rng(2)
    pairs = [(a, b) for a in range(8) for b in range(a)]
    shift = random.normal(0, 1, 8)
    rows = [(shift[a] + shift[b], 1.0) for a, b in pairs]
    together = interval(rows, pairs, ratio)
    alone = interval(rows, [(i,) for i in range(len(pairs))], ratio)
    assert together[1] - together[0] > 1.3 * (alone[1] - alone[0])


def test_equal_views_have_no_width_and_few_have_no_interval():
    assert mean_interval([2.0] * 5) == (2.0, 2.0)
    assert mean_interval([1.0] * (FEWEST_VIEWS - 1)) is None
    assert mean_interval([1.0, 2.0, 3.0, 5.0]) == mean_interval([1.0, 2.0, 3.0, 5.0])
    low, high = mean_interval([1.0, 2.0, 3.0, 6.0])
    assert low < 3 < high

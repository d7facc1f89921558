"""Priors against sizes and masses that were collected apart from the lexicon, from pages that it does not cite."""

from pathlib import Path
from urllib.parse import urldefrag

from dcap.evaluation.prior_scores import MASS_FACTOR, SIZE_FACTOR, misses, prior_score, read_published, share_within
from dcap.language.offline.lexicon import things

PUBLISHED = read_published(Path(__file__).parents[1] / "published_sizes.csv")


def pages(source: str) -> set[str]:
    """Pages of a cell: one for both, or one for the size and one for the mass; a place in a page is the page."""
    return {urldefrag(address).url for address in source.split()}


def test_the_two_collections_share_no_page():
    """What the lexicon was made from can't judge it."""
    cited = {
        page for thing in things().values() for cell in (thing.size_source, thing.mass_source) for page in pages(cell)
    }
    judging = [pages(row.source) for row in PUBLISHED]
    assert all(judging)
    assert any(len(both) == 2 for both in judging)
    assert cited & set().union(*judging) == set()


def test_priors_are_right_for_nine_in_ten():
    """Sizes within a factor of 1.5, masses within 2; unknown things count as wrong."""
    scores = [prior_score(row) for row in PUBLISHED]
    sizes, masses = [one.size_ratio for one in scores], [one.mass_ratio for one in scores]
    assert sum(one is not None for one in sizes) >= 90
    assert sum(one is not None for one in masses) >= 50
    assert share_within(sizes, SIZE_FACTOR) >= 0.9, misses(scores)
    assert share_within(masses, MASS_FACTOR) >= 0.9, misses(scores)

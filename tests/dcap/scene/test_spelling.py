"""A word that is none of a closed list is told with the list, and with what it may have been meant to be."""

import pytest

from dcap.scene.text import not_one_of


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("opnai", "is not one of offline, openai; did you mean 'openai'?"),
        ("nobody", "is not one of offline, openai"),
        (7, "is not one of offline, openai"),
    ],
)
def test_words_of_a_closed_list(word: object, said: str) -> None:
    """The nearest one is named if one is near."""
    assert not_one_of(word, ["offline", "openai"]) == said

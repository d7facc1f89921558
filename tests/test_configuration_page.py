"""docs/configuration.md lists every setting that there is, from the code."""

from pathlib import Path

import pytest

from flows.place import PlaceConfig
from flows.settings.own import OWN
from flows.settings.table import key_table, setting_keys

PAGE = Path(__file__).resolve().parent.parent / "docs" / "configuration.md"
SECTIONS = [*OWN, *(name for name in PlaceConfig.model_fields if name not in ("measured", "compared"))]


@pytest.mark.parametrize("name", SECTIONS)
def test_every_setting_is_in_the_page(name: str) -> None:
    """The table of each section is the one that the code gives: key, default, option and meaning."""
    assert f"## `{name}`\n\n{key_table(name)}" in PAGE.read_text()


def test_every_setting_has_a_meaning() -> None:
    """Each is explained where it is declared."""
    assert [one.key for one in setting_keys() if not one.meaning] == []

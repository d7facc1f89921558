"""docs/configuration.md lists every setting that there is, from the code."""

import re
import runpy

from dcap.packages import ROOT
from flows.given_settings import section_of
from flows.settings import setting_keys

PAGE = ROOT / "docs" / "configuration.md"


def test_the_tables_are_those_of_the_code() -> None:
    """Key, default, option and meaning of every setting; `python docs/make_settings.py` writes them."""
    page = PAGE.read_text()
    with_tables = runpy.run_path(str(ROOT / "docs" / "make_settings.py"))["page_with_tables"]
    assert with_tables(page) == page
    assert with_tables(page[: page.index("\n## `drift`\n")]) == page  # a section that is new
    assert set(re.findall(r"^## `(\w+)`$", page, re.MULTILINE)) == {section_of(one.key) for one in setting_keys()}


def test_every_setting_has_a_meaning() -> None:
    """Each is explained where it is declared."""
    assert [one.key for one in setting_keys() if not one.meaning] == []

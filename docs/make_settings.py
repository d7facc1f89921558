"""Writes the tables of docs/configuration.md: `python docs/make_settings.py`, after a change of options or settings."""

import json
import re
from pathlib import Path

from flows.given_settings import section_of
from flows.settings import setting_keys

PAGE = Path(__file__).with_name("configuration.md")
HEAD = "| key | default | meaning |\n|---|---|---|\n"
TABLE = re.compile(r"(?<=^## `)(\w+)`\n\n(?:\|.*\n)*", re.MULTILINE)
TWINS = {"object_mesh.": "scene_mesh.", "drift.solver.": "drop.solver."}
"""Beginnings of keys whose settings are those of other keys, but for some defaults."""


def page_with_tables(page: str) -> str:
    """Return the page with the settings that there are in the table below the heading of each section; a section that
    it has not yet comes at its end."""
    known = TABLE.sub(lambda found: f"{found[1]}`\n\n{section_table(found[1])}", page)
    sections = dict.fromkeys(section_of(one.key) for one in setting_keys())
    return known + "".join(f"\n## `{one}`\n\n{section_table(one)}" for one in sections if f"## `{one}`\n" not in page)


def section_table(section: str) -> str:
    """Return the settings of a section as a table; one row stands for all that equal those of a twin."""
    known = {one.key: one for one in setting_keys()}
    twins = {new: old for new, old in TWINS.items() if new.startswith(f"{section}.")}
    equal = {
        new + key.removeprefix(old)
        for new, old in twins.items()
        for key, one in known.items()
        if key.startswith(old) and (twin := known.get(new + key.removeprefix(old))) and twin.default == one.default
    }
    rows = [one for one in known.values() if section_of(one.key) == section and one.key not in equal]
    return (
        HEAD
        + "".join(f"| `{new}*` | | as `{old}*`, unless listed below |\n" for new, old in twins.items())
        + "".join(
            f"| `{one.key}` | {in_code(one.default)} | {option(one.option)}{escaped(one.meaning)} |\n" for one in rows
        )
    )


def option(name: str) -> str:
    """Return the option of a setting before its meaning; nothing if it has none."""
    return name and f"{in_code(name)}: "


def in_code(value: object) -> str:
    """Return a value as YAML has it; nothing for an empty text."""
    return "" if value == "" else f"`{value if isinstance(value, str) else json.dumps(value)}`"


def escaped(text: str) -> str:
    """Return text for a cell: a bar would end it."""
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page_with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

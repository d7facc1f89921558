"""Whatever an id is, its folder has a name that any file system takes and that stays in the run."""

import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.run_folder import LONGEST, folder_name, same_folder, sample_folder

HOSTILE = (
    "a" * 300, "\u00e9" * 5000, "\U0001f600" * 99, "../../x", "/etc/passwd", "C:\\x", "CON", "nul.txt", "Com1", "aux",
    "a.", "a ", "-rf", ".hidden", "..", "x\ny", "%s%n", "\u202eabc", "a\0b", "a:b", 'a"b', "a*?b", "\ud800",
)  # fmt: skip


@given(st.one_of(st.sampled_from(HOSTILE), st.text(min_size=1, max_size=200)))
def test_a_name_is_safe_everywhere(one: str) -> None:
    """Letters, digits and three signs; no device, no option, nothing hidden, no dot at the end, and not too long."""
    name = folder_name(one)
    assert all(c.isalnum() or c in "-_." for c in name)
    assert 0 < len(name.encode()) <= LONGEST
    assert name[0] not in "-."
    assert name[-1] != "."
    assert name.partition(".")[0].lower() not in {"con", "prn", "aux", "nul", "com1", "lpt9"}
    assert sample_folder(Path("/run"), one).is_relative_to("/run")


@pytest.mark.parametrize("plain", ["bedroom_01-ball-centre", "a", "room.7", "zimmer_\u00e4", "x" * LONGEST])
def test_a_plain_id_is_its_folder(plain: str) -> None:
    """Names that are safe are kept: a run of an earlier version is found again."""
    assert folder_name(plain) == plain


def test_long_ids_that_differ_have_folders_that_differ() -> None:
    """By the digest of the whole id, wherever they differ."""
    ids = [
        "a" * 300,
        "a" * 301,
        "a" * 299 + "b",
        "b" + "a" * 299,
        "a" * 150 + "/" + "a" * 149,
        "a" * 150 + "_" + "a" * 149,
    ]
    assert len({folder_name(one) for one in ids}) == len(ids)


def test_names_that_some_file_systems_confuse_are_known() -> None:
    """Case and the composition of letters do not count on the disks of many laptops."""
    composed = "caf\u00e9"
    assert same_folder("Mug") == same_folder("mUG")
    assert same_folder(composed) == same_folder(unicodedata.normalize("NFD", composed))
    assert same_folder("mug") != same_folder("mug_")

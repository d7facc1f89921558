"""The Makefile's targets act where the data is."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize(
    ("target", "words"), [("clean", '"/far away/cache"'), ("demo", '"/far away/rooms/bedroom_01"')]
)
def test_targets_follow_the_data_folder(target: str, words: str) -> None:
    """With $DCAP_DATA set, make clean empties that cache and make demo reads those rooms."""
    environment = os.environ | {"DCAP_DATA": "/far away"}
    command = ["make", "--dry-run", "--old-file=.venv/.ready", target]
    said = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout
    assert words in said
    assert " data/" not in said

"""The documents beside the code name what is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DECISIONS = ROOT / "docs" / "decisions"
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
LINK = re.compile(r"\]\((?!https?://|#)([^)#\s]+)(?:#[^)]*)?\)")
NAMED = re.compile(r"`((?:dcap|tasks|solver|flows|tests|perf|data|prompts)/[\w./-]*[\w/])`")
PLACEHOLDER = "NAME"
GENERATED = ("data/cache", "data/runs", "data/replies", "data/rooms", "data/objects")


def test_every_decision_has_its_line_in_the_index() -> None:
    """Each file is linked once, in the order of the numbers, and no number is taken twice."""
    files = sorted(path.name for path in DECISIONS.glob("[0-9]*.md"))
    linked = re.findall(r"^\| \[(\d{3})\]\((\d{3})([^)]*)\) \| \S", (DECISIONS / "README.md").read_text(), re.MULTILINE)
    assert [number + rest for _, number, rest in linked] == files
    assert all(shown == number for shown, number, _ in linked)
    assert len({name[:3] for name in files}) == len(files)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link of a document is a file or folder of the project."""
    missing = [target for target in LINK.findall(page.read_text()) if not (page.parent / target).exists()]
    assert missing == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent != DECISIONS and page.name != "CHANGELOG.md"],
                         ids=lambda page: str(page.relative_to(ROOT)))  # fmt: skip
def test_files_that_are_named_are_there(page: Path) -> None:
    """Every file or folder that a document names in backticks exists, but for what runs generate and any NAME."""
    named = [name for name in NAMED.findall(page.read_text()) if not name.startswith(GENERATED)]
    assert [name for name in named if PLACEHOLDER not in name and not (ROOT / name).exists()] == []


def test_the_changelog_has_the_version_of_the_package() -> None:
    """The newest release of the changelog is that of pyproject.toml and CITATION.cff; what follows stands above it."""
    version = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert version is not None
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[:2] == ["Unreleased", version[1]]
    assert f"\nversion: {version[1]}\n" in (ROOT / "CITATION.cff").read_text()


def test_sources_of_the_physics_are_cited_and_listed() -> None:
    """Each [X00] in docs/physics.md is in its list of sources, and each of these is cited."""
    text, _, sources = (ROOT / "docs" / "physics.md").read_text().partition("## Sources")
    cited = set(re.findall(r"\[(d?[A-Z]{1,2}\d\d)[\],]", text))
    assert cited == set(re.findall(r"^- \[(\w+)\] \S", sources, re.MULTILINE))
    assert len(cited) > 10

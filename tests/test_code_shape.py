"""What holds for the code as a whole."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("dcap", "tasks", "solver", "flows", "perf")
MOST_LINES = 450
TEXT_ARGUMENTS = {"read_text": 0, "write_text": 1}
"""Methods of `Path`, and how many arguments of theirs stand before the encoding."""


def test_a_class_name_stands_for_one_thing() -> None:
    """No two classes of our packages have the same name, private ones included."""
    places = defaultdict(list)
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_texts_are_in_one_encoding() -> None:
    """Every file that we read or write as text says in which encoding: that of the locale is another elsewhere."""
    silent = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and len(node.args) <= TEXT_ARGUMENTS.get(node.func.attr, -1)
        and "encoding" not in {word.arg for word in node.keywords}
    ]
    assert silent == []


def test_no_file_is_longer_than_its_idea() -> None:
    """No Python file, tests included, has more than 450 lines."""
    paths = [path for package in (*PACKAGES, "tests") for path in (ROOT / package).rglob("*.py")]
    lengths = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in paths}
    assert {name: length for name, length in lengths.items() if length > MOST_LINES} == {}

"""Where the values of a JSON file stand in its text."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st
from json_trees import Tree, trees

from dcap.scene.checks.findings import json_lines, json_places, repeated_keys


@given(trees, st.sampled_from([0, 1, 3]))
@settings(max_examples=30)
def test_places_have_their_lines(tree: Tree, indent: int) -> None:
    """Every value of any tree is found, once, on the line where a printer that counts lines puts it."""
    text = json.dumps(tree, indent=indent)
    expected: dict[tuple[str | int, ...], int] = {}

    def walk(value: Tree, place: tuple[str | int, ...], line: int) -> int:
        expected[place] = line
        children = (
            list(value.items())
            if isinstance(value, dict)
            else list(enumerate(value))
            if isinstance(value, list)
            else []
        )
        for key, child in children:
            line = walk(child, (*place, key), line + 1)
        return line + bool(children)

    walk(tree, (), 1)
    assert {place: line for place, line, _ in json_places(text)} == expected
    assert not list(repeated_keys(text))
    lines = json_lines(text)
    assert all(lines(place) == line for place, line in expected.items())
    assert lines(("no", "such", 1)) == 1

"""YAML 1.2 of people's files: safe values only, and mappings that do not grow without end."""

from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode

MOST_KEYS = 10_000
"""More keys than anyone writes in one mapping; merges that repeat each other make any number of a short file."""
BROKEN_YAML = (YAMLError, ValueError, RecursionError)
"""Errors that `parse_yaml` raises for text that is not YAML."""


class BoundedMerges(SafeConstructor):
    """Refuses mappings that grow without end by merging (`<<`) each other."""

    def flatten_mapping(self, node: MappingNode) -> None:
        """Put the keys of merged mappings into a mapping."""
        super().flatten_mapping(node)
        if len(node.value) > MOST_KEYS:
            what = f"merging makes {len(node.value)} keys of one mapping, expected at most {MOST_KEYS}"
            raise ConstructorError(None, None, what, node.start_mark)


def yaml_fault(broken: Exception) -> str:
    """Fault in a text that `parse_yaml` refuses, and its place, in one line."""
    if not isinstance(broken, MarkedYAMLError) or broken.problem_mark is None:
        return " ".join(str(broken).split())
    mark, what = broken.problem_mark, ": ".join(one for one in (broken.context, broken.problem) if one)
    return f"line {mark.line + 1}, column {mark.column + 1}: {' '.join(what.split())}"


def parse_yaml(text: str) -> object:
    """The tree of a YAML 1.2 text; its parts may be shared, so that written out it may be without end."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = BoundedMerges
    tree: object = yaml.load(text)
    return tree

"""Reads YAML 1.2 safely: plain values only, and never more of them than somebody has written."""

from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode

from dcap.scene.errors import InputError

MOST_KEYS = 10_000
"""More keys than anyone writes in one mapping; merges that repeat each other make any number of a short file."""


class BoundedMerges(SafeConstructor):
    """Refuses mappings that grow without end by merging (`<<`) each other."""

    def flatten_mapping(self, node: MappingNode) -> None:
        """Put the keys of merged mappings into a mapping."""
        super().flatten_mapping(node)
        if len(node.value) > MOST_KEYS:
            what = f"merging makes {len(node.value)} keys of one mapping, expected at most {MOST_KEYS}"
            raise ConstructorError(None, None, what, node.start_mark)


def yaml_file(path: Path) -> object:
    """The tree of a YAML file that is there."""
    try:
        return yaml_text(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, YAMLError) as broken:
        raise InputError(f"{path}: cannot be read as YAML: {broken}") from broken


def yaml_text(text: str) -> object:
    """The tree of YAML text; ValueError, RecursionError or YAMLError where it is none."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = BoundedMerges
    tree: object = yaml.load(text)
    return tree

"""Random trees of JSON."""

from typing import Any

from hypothesis import strategies as st

Tree = Any
"""A tree of JSON."""

trees = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)

"""Names of artifacts: what a stage hands to the next one instead of the value itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from dcap.scene.types.outcome import Infeasible

ValueT_co = TypeVar("ValueT_co", covariant=True)


@dataclass(frozen=True, slots=True, order=True)
class Ref(Generic[ValueT_co]):
    """Name of an artifact: what it is and the digest of its bytes.

    `Ref[Intent]` names an intent, or the reason why there is none: an Infeasible takes the place of any value.
    """

    kind: str
    """Type of the value: Scan, Segmentation, ..., Infeasible, Source."""
    sha256: str
    """Digest over the names and contents of its files, 64 hex digits."""

    @property
    def infeasible(self) -> bool:
        """Whether it names the reason why there is no value."""
        return self.kind == Infeasible.__name__

    def to_json(self) -> dict[str, str]:
        """Plain form for records and cache keys."""
        return {"kind": self.kind, "sha256": self.sha256}

    @classmethod
    def from_json(cls, tree: Mapping[str, object]) -> "Ref[Any]":
        """The reference that `to_json` wrote; what it names is known when it is loaded."""
        return Ref(str(tree["kind"]), str(tree["sha256"]))

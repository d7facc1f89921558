"""`measures.json` of a sample: measurements of its final state, by any method."""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from dcap.evaluation.run_folder import sample_folder
from dcap.scene.json_tree import JsonObject, JsonValue, object_to_json, write_whole
from dcap.scene.types.measures import Drift, Indentation, Measures, RefereeMeasures
from flows.find_run import read_keys
from flows.output import load, readable_json
from flows.sample_run import FinishedSample
from tasks.artifact import Store

MEASURES = "measures.json"


def write_measures(finished: FinishedSample, out: Path) -> JsonObject | None:
    """Write the measurements next to placement.json; None without any, after removing an earlier file."""
    refs, store = finished.placement, Store.default()
    path = out / MEASURES
    if refs.measures is None:
        path.unlink(missing_ok=True)
        return None
    kinds = (("measures", refs.measures, Measures), ("indentation", refs.indentation, Indentation),
             ("drift", refs.drift, Drift), ("referee", refs.referee, RefereeMeasures))  # fmt: skip
    found = {name: load(store, ref, kind) if ref else None for name, ref, kind in kinds}
    tree = object_to_json({"scene": refs.scene.to_json(), "intent": refs.intent.to_json(), **found})
    write_whole(path, readable_json(tree))
    return tree


def fingerprint(folder: Path) -> str:
    """Digest of the measurements of a final state, which tells two final states apart; empty without measurements."""
    path = folder / MEASURES
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def states_of(run: Path, names: Iterable[str]) -> dict[str, str]:
    """Fingerprints of samples of a run by their names, METHOD/SAMPLE."""
    return {name: fingerprint(sample_folder(run, name)) for name in names}


def changed_since(run: Path, states: Mapping[str, str]) -> tuple[str, ...]:
    """Samples of a run whose final states differ from the fingerprints in `states`."""
    now = states_of(run, states)
    return tuple(name for name, state in states.items() if now[name] != state)


def read_measures(out: Path) -> Mapping[str, JsonValue]:
    """Read the file of `write_measures`; empty without one, InputError where it is damaged."""
    path = out / MEASURES
    return read_keys(path) if path.is_file() else {}

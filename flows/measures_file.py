"""`measures.json` of a sample: what was measured of its final state, whoever made it."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

from dcap.scene.json_tree import JsonObject, JsonValue, object_to_json
from dcap.scene.types.judged_views import JudgedViews
from dcap.scene.types.measures import Drift, Indentation, Measures
from dcap.scene.whole_files import write_whole
from flows.find_run import read_keys
from flows.output import load, readable_json
from flows.sample_run import FinishedSample
from tasks.artifact import Store

MEASURES, VIEWS = "measures.json", "views"


def write_measures(finished: FinishedSample, out: Path) -> JsonObject | None:
    """Write what was measured beside placement.json; None where nothing was, and an earlier file is removed."""
    refs, store = finished.placement, Store.default()
    path = out / MEASURES
    if refs.measures is None:
        path.unlink(missing_ok=True)
        return None
    kinds = (("measures", refs.measures, Measures), ("indentation", refs.indentation, Indentation),
             ("drift", refs.drift, Drift))  # fmt: skip
    found = {name: load(store, ref, kind) if ref else None for name, ref, kind in kinds}
    tree = object_to_json({"scene": refs.scene.to_json(), "intent": refs.intent.to_json(), **found})
    write_whole(path, readable_json(tree))
    if refs.views is not None:
        (out / VIEWS).mkdir(exist_ok=True)
        for one in fields(JudgedViews):
            view = store.folder(refs.views) / f"{one.name}.png"
            write_whole(out / VIEWS / view.name, view.read_bytes())
    return tree


def read_measures(out: Path) -> Mapping[str, JsonValue]:
    """Read what `write_measures` wrote; empty where there is nothing, InputError where it is damaged."""
    path = out / MEASURES
    return read_keys(path) if path.is_file() else {}

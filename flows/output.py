"""Writes what a placement returned into a folder: placement.json, object.ply, scene.glb and pictures."""

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from dcap.scene.json_tree import JsonObject, JsonValue
from dcap.scene.readers.scenes.placed_scene import DEFORMED, FACTS
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ply import mesh_to_ply
from dcap.scene.store.ref import Ref
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import Particles
from dcap.scene.types.renders import Renders
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from flows.next_scene import next_scene_files
from flows.placement_json import AT_REST, Values, placement_json
from flows.placement_schema import placement_schema
from flows.sample_run import FinishedSample
from tasks.render.settled_meshes import settled_item, settled_scene

SCHEMA = "placement.schema.json"
"""The JSON Schema of placement.json, beside it."""
PICTURES = ("clean", "asked", "settled", "closeup", "candidates", "hole")
OWNED = frozenset({"object.ply", "scene.glb", *(f"{name}.png" for name in PICTURES)})

Kind = TypeVar("Kind")


def load_values(finished: FinishedSample, store: Store) -> Values:
    """Load the values behind a placement's references."""
    placement = finished.placement
    return Values(
        scan=load(store, placement.scene_scan, Scan),
        object_scan=load(store, placement.object_scan, Scan),
        scene=load(store, placement.scene, Segmentation),
        item=load(store, placement.item, Segmentation),
        intent=load(store, placement.intent, Intent),
        anchor=load(store, placement.anchor, Anchor),
        materials=load(store, placement.materials, PartMaterials),
        particles=load(store, placement.particles, Particles),
        settled=load(store, placement.settled, Settled),
        renders=load(store, placement.renders, Renders),
        infeasible=load(store, placement.renders, Infeasible),
    )


def load(store: Store, ref: Ref[object], kind: type[Kind]) -> Kind | None:
    """The value of a reference if it is of this kind."""
    if ref.kind != kind.__name__:
        return None
    value = store.load(ref)
    assert isinstance(value, kind)
    return value


def write_placement(finished: FinishedSample, out: Path) -> JsonObject:
    """Write all files of a placement into `out` and return what placement.json holds.

    The files are written beside and moved in, placement.json last: whoever sees it sees everything.
    """
    store = Store.default()
    values = load_values(finished, store)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out, prefix=".writing-") as draft_name:
        draft = Path(draft_name)
        artifacts = write_geometry(values, draft) | copy_pictures(finished, store, draft)
        beside = next_scene_files(values, finished.sample.prompt)
        for name, data in beside.items():
            (draft / name).write_bytes(data)
        tree = placement_json(finished, values, artifacts)
        (draft / SCHEMA).write_bytes(readable_json(placement_schema()))
        os.replace(draft / SCHEMA, out / SCHEMA)
        (out / "placement.json").unlink(missing_ok=True)
        old = {FACTS, *OWNED, *(path.name for path in out.glob(DEFORMED))}
        for name in old.difference(artifacts.values()):  # of an earlier result in the same folder
            (out / name).unlink(missing_ok=True)
        for name in (*artifacts.values(), *beside):
            os.replace(draft / name, out / name)
        (draft / "placement.json").write_bytes(readable_json(tree))
        os.replace(draft / "placement.json", out / "placement.json")
    return tree


def readable_json(tree: object) -> bytes:
    """JSON in the given order of keys, for people."""
    return (json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


def write_geometry(values: Values, folder: Path) -> dict[str, str]:
    """object.ply and scene.glb, as far as there is something to write."""
    if values.scene is None:
        return {}
    scene, thing = values.scene, None
    if values.settled and values.anchor and values.item and values.settled.bodies:
        scene = settled_scene(values.scene, values.settled, values.anchor.base_id).scene
        thing = settled_item(values.item, values.anchor, values.settled.bodies[0])
        (folder / "object.ply").write_bytes(mesh_to_ply(thing))
    (folder / "scene.glb").write_bytes(scene_glb(scene, thing))
    return ({"object": "object.ply"} if thing else {}) | {"scene": "scene.glb"}


def scene_glb(scene: Segmentation, thing: Mesh | None) -> bytes:
    """The scene, below it a node per instance and part, and the object at rest in it."""
    nodes = [Node("scene", children=tuple(labelled_nodes(scene)))]
    return glb_bytes(nodes + ([] if thing is None else [Node("object", thing)]))


def copy_pictures(finished: FinishedSample, store: Store, folder: Path) -> dict[str, str]:
    """The pictures as they lie in the store."""
    source = store.folder(finished.placement.overview or finished.placement.renders)
    names = [name for name in PICTURES if (source / f"{name}.png").is_file()]
    for name in names:
        shutil.copyfile(source / f"{name}.png", folder / f"{name}.png")
    return {name: f"{name}.png" for name in names}


def result_line(tree: Mapping[str, JsonValue]) -> str:
    """One line for a person."""
    base = tree["base"]
    where = f" on {base['label']} ({tree['part']})" if isinstance(base, Mapping) else ""
    if tree["verdict"] == AT_REST:
        return f"at rest{where}"
    return f"infeasible: {tree['reason']}{where}; {tree['message'] or ''}".rstrip("; ")

"""Writes the results of a placement into a folder: geometry, pictures, placement.json, records and settled splats.

`records.json` lists the keys of the stages' records, by which the cache keeps them, and as `inputs` artifacts that no
stage made (source files, labels). `scene_settled.ply` has the Gaussians of a splat scene with the placement in them:
plain 3DGS in the scene file's own frame and unit, so that it can replace the input file.
"""

import json
import logging
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dcap.geometry.distance import sampler
from dcap.geometry.rendering.painted import painted, surface_colors
from dcap.geometry.rendering.surface import ShadingNormals
from dcap.scene.errors import DcapError, InputError
from dcap.scene.readers.scenes.placed_scene import DEFORMED, FACTS
from dcap.scene.readers.scenes.sugar import find_splats
from dcap.scene.readers.splats.formats import is_splats, read_gaussians
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import Particles
from dcap.scene.types.pictures import Renders
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from dcap.scene.writers.gaussians import write_splat_parts
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from dcap.scene.writers.meshes import mesh_to_ply
from dcap.scene.writers.placed_scene import copy_earlier, note_files
from dcap.scene.written_files import JsonObject, JsonValue, draft_folder
from flows.next_scene import next_scene_files
from flows.placement_json import AS_POSED, AT_REST, Values, placement_json
from flows.results import placement_schema
from flows.sample_run import FinishedSample
from tasks.artifact import Ref, Source, Store
from tasks.code import code_of
from tasks.records import refs_in
from tasks.render.particle_table import distances, iso_surface, particle_columns, soft_bodies
from tasks.render.settled_meshes import contact_nodes, object_at_rest, scene_at_rest, settled_item
from tasks.render.settled_splats import SettledSplats, settled_splats

RECORDS = "records.json"
VERSION = 1
LOG = logging.getLogger(__name__)

SETTLED_SPLATS = "scene_settled.ply"
DEGREE = 3
"""Degree of the file's harmonics, as 3DGS and SuGaR read it; lower degrees are padded with zeros."""
RESULT, SCHEMA = "placement.json", "placement.schema.json"
"""The result, and the JSON Schema of its keys."""
PARTICLES, ISO = "particles.parquet", "iso.glb"
PICTURES = ("clean", "asked", "settled", "closeup", "before_after", "contact", "profile", "candidates", "hole")
GEOMETRY = ("object.ply", "object.glb", "contacts.glb", "scene.glb", PARTICLES, SETTLED_SPLATS)
OWNED = frozenset({*GEOMETRY, *(f"{name}.png" for name in PICTURES)})

Kind = TypeVar("Kind")


def records_json(finished: FinishedSample) -> JsonObject:
    """Return the content of records.json."""
    made = {one.ref for one in finished.results}
    given = {ref for one in finished.results for ref in refs_in(one.record.recipe)} - made
    rows = [{"stage": one.stage, "key": one.record.key, **one.ref.to_json()} for one in finished.results]
    return {"version": VERSION, "records": rows, "inputs": [dict(ref.to_json()) for ref in sorted(given)]}


def read_needs(folder: Path) -> set[Ref[Any]] | None:
    """Return the artifacts that the placement in a folder needs; None where the file is missing or damaged."""
    try:
        tree = json.loads((folder / RECORDS).read_bytes())
        return {Ref.from_json(row) for row in (*tree["records"], *tree["inputs"])}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def splats_of(given: str) -> Path | None:
    """The file of Gaussians of an input scene, None without one. InputError if there are several."""
    path = Path(given)
    return find_splats(path) if path.is_dir() else path if is_splats(path) else None


def splat_artifact(finished: FinishedSample, values: Values, folder: Path) -> dict[str, str]:
    """Write the file if the scene has Gaussians and something rests in it; a failure is only reported."""
    try:
        if values.settled is None or splats_of(finished.sample.scene) is None:
            return {}
        made = settled_scene_splats(finished, values)
    except DcapError as error:  # the placement is sound without it
        LOG.warning("no %s: %s", SETTLED_SPLATS, error)
        return {}
    write_made(made, folder)
    return {"splats": SETTLED_SPLATS}


def settled_scene_splats(finished: FinishedSample, values: Values) -> SettledSplats:
    """Content of the file. InputError if the scene has no Gaussians, or the placement no rest state."""
    sample = finished.sample
    if splats_of(sample.scene) is None:
        raise InputError(f"{sample.scene}: no Gaussian splats; --format splats takes a placement in a scene of splats")
    final = values.need_final(f"{sample.id} has no settled splats")
    store = Store.default()
    source = store.load(store.add_source(sample.scene))  # the file at the time of the placement
    assert isinstance(source, Source)
    kept = splats_of(str(source.path))
    assert kept is not None
    assert values.scan is not None
    colors = partial(surface_colors, painted(final.item.mesh, values.object_surface))
    return settled_splats(
        read_gaussians(kept), values.scan.world_from_file, final.scene, final.item, final.anchor, final.settled,
        colors=colors,
    )  # fmt: skip


def write_made(made: SettledSplats, folder: Path) -> None:
    """Write the file into a folder."""
    write_splat_parts(folder / SETTLED_SPLATS, made.parts(), len(made), DEGREE, made.comments)


def load_values(finished: FinishedSample, store: Store) -> Values:
    """Load the values behind a placement's references."""
    placement = finished.placement
    return Values(
        scan=load(store, placement.scene_scan, Scan),
        object_scan=load(store, placement.object_scan, Scan),
        scene_surface=load(store, placement.scene_surface, SourceSurface) or SourceSurface.untextured(),
        object_surface=load(store, placement.object_surface, SourceSurface) or SourceSurface.untextured(),
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

    The files are written as drafts and moved in, placement.json last: once it is there, everything is. They are copied
    from an earlier folder of the same placement, if there is one.
    """
    with draft_folder(out) as draft:
        key = placement_key(finished)
        files = copy_earlier(key, draft) or write_files(finished, draft)
        names = [name for name in files.values() if name != RESULT]
        (out / RESULT).unlink(missing_ok=True)
        old = {FACTS, *OWNED, *(path.name for path in out.glob(DEFORMED))}
        for name in old.difference(names):  # of an earlier result in the same folder
            (out / name).unlink(missing_ok=True)
        for name in (*names, RESULT):
            os.replace(draft / name, out / name)
    note_files(key, out, files)
    tree: JsonObject = json.loads((out / RESULT).read_bytes())
    return tree


def write_files(finished: FinishedSample, draft: Path) -> dict[str, str]:
    """Write all files of a placement; returns their names by kind."""
    store = Store.default()
    values = load_values(finished, store)
    next_scene = next_scene_files(values, finished.sample.prompt)
    for name, data in next_scene.items():
        (draft / name).write_bytes(data)
    artifacts = (
        write_geometry(values, draft) | copy_pictures(finished, store, draft) | splat_artifact(finished, values, draft)
    )
    for name, tree in (
        (SCHEMA, placement_schema()),
        (RECORDS, records_json(finished)),
        (RESULT, placement_json(finished, values, artifacts)),
    ):
        (draft / name).write_bytes(readable_json(tree))
    return artifacts | {name: name for name in (*next_scene, SCHEMA, RECORDS, RESULT)}


def placement_key(finished: FinishedSample) -> str:
    """Return the key of a placement's files: digest of its request, its records, and the code that writes them."""
    code = code_of(Path(__file__).resolve())
    records = [(one.record.key, one.record.seconds, *one.ref.to_json().values()) for one in finished.results]
    return json.dumps([asdict(finished.sample), records, code.digest, dict(code.libraries)], sort_keys=True)


def readable_json(tree: object) -> bytes:
    """JSON in the given order of keys, for people."""
    return (json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


def write_geometry(values: Values, folder: Path) -> dict[str, str]:
    """Write object.ply, object.glb, contacts.glb and scene.glb, each if there is something to write."""
    if values.scene is None:
        return {}
    anchor, final = values.anchor, values.final
    settled = final.settled if final else None
    around, look = scene_at_rest(values.scene, values.scene_surface, settled, anchor.base_id if anchor else "")
    normals = corner_normals(around.scene.mesh)  # so that it looks alike in any viewer, with textures too
    nodes = [Node("scene", children=tuple(labelled_nodes(around.scene, look.paint, normals)))]
    files = {"scene": "scene.glb"}
    if final and settled:
        (folder / "object.ply").write_bytes(mesh_to_ply(settled_item(final.item, final.anchor, final.body)))
        thing = object_at_rest(final.item, values.object_surface, final.anchor, final.body)
        node = Node("object", thing.mesh, paint=thing.paint, normals=corner_normals(thing.mesh))
        nodes.append(node)
        (folder / "object.glb").write_bytes(glb_bytes([node]))
        (folder / "contacts.glb").write_bytes(glb_bytes(contact_nodes(settled)))
        if soft_bodies(settled) and values.particles:
            columns = particle_columns(settled, values.particles)
            pq.write_table(pa.table({name: pa.array(column) for name, column in columns.items()}), folder / PARTICLES)
            files["particles"] = PARTICLES
        files |= {"object": "object.ply", "object_glb": "object.glb", "contacts": "contacts.glb"}
    (folder / "scene.glb").write_bytes(glb_bytes(nodes))
    return files


def iso_glb(settled: Settled, particles: Particles) -> bytes:
    """The surfaces around the material points of the soft bodies at rest, with their distances to them."""
    nodes = []
    for number, one in soft_bodies(settled):
        surface = iso_surface(one, sampler(particles.bodies[number].distance))
        node = Node(
            settled.bodies[number].name, surface, normals=corner_normals(surface), extras=distances(surface, one)
        )
        nodes.append(node)
    return glb_bytes([Node("material", children=tuple(nodes))])


def corner_normals(mesh: Mesh) -> NDArray[np.float32]:
    """Unit shading normals at the corners of all faces, shape (m, 3, 3)."""
    return ShadingNormals(mesh).of_corners(np.arange(len(mesh.faces)))


def copy_pictures(finished: FinishedSample, store: Store, folder: Path) -> dict[str, str]:
    """Copy the pictures from the store."""
    source = store.folder(finished.placement.overview or finished.placement.renders)
    names = [name for name in PICTURES if (source / f"{name}.png").is_file()]
    for name in names:
        shutil.copyfile(source / f"{name}.png", folder / f"{name}.png")
    return {name: f"{name}.png" for name in names}


def result_line(tree: Mapping[str, JsonValue]) -> str:
    """One line for a person."""
    base = tree["base"]
    part = f" ({tree['part']})" if tree["part"] else ""
    where = f" on {base['label']}{part}" if isinstance(base, Mapping) else ""
    if tree["verdict"] == AT_REST:
        return f"at rest{where}"
    if tree["verdict"] == AS_POSED:
        return f"as posed{where}"
    return f"infeasible: {tree['reason']}{where}; {tree['message'] or ''}".rstrip("; ")

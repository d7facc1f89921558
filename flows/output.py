"""Writes what a placement returned into a folder: placement.json, object.ply, scene.glb and pictures."""

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.evaluation.region import region_missed
from dcap.scene.store.artifacts import Store
from dcap.scene.store.codec import to_tree
from dcap.scene.store.ply import mesh_to_ply
from dcap.scene.store.ref import Ref
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import Particles
from dcap.scene.types.renders import Renders
from dcap.scene.types.repair_report import BodyGeometry
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from flows.sample_run import FinishedSample
from tasks.render.stage import settled_item, settled_scene

AT_REST = "at_rest"
PICTURES = ("clean", "asked", "settled", "closeup")
OWNED = frozenset({"object.ply", "scene.glb", *(f"{name}.png" for name in PICTURES)})

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True)
class Values:
    """What the stages returned, as far as they got."""

    scan: Scan | None
    object_scan: Scan | None
    scene: Segmentation | None
    item: Segmentation | None
    intent: Intent | None
    anchor: Anchor | None
    materials: PartMaterials | None
    particles: Particles | None
    settled: Settled | None
    renders: Renders | None
    infeasible: Infeasible | None


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


def write_placement(finished: FinishedSample, out: Path) -> dict[str, object]:
    """Write all files of a placement into `out` and return what placement.json holds.

    The files are written beside and moved in, placement.json last: whoever sees it sees everything.
    """
    store = Store.default()
    values = load_values(finished, store)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out, prefix=".writing-") as draft_name:
        draft = Path(draft_name)
        artifacts = write_geometry(values, draft) | copy_pictures(finished, store, draft)
        tree = placement_tree(finished, values, artifacts)
        (out / "placement.json").unlink(missing_ok=True)
        for name in OWNED.difference(artifacts.values()):  # of an earlier result in the same folder
            (out / name).unlink(missing_ok=True)
        for name in artifacts.values():
            os.replace(draft / name, out / name)
        (draft / "placement.json").write_bytes(readable_json(tree))
        os.replace(draft / "placement.json", out / "placement.json")
    return tree


def readable_json(tree: object) -> bytes:
    """JSON in the given order of keys, for people."""
    return (json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


def placement_tree(finished: FinishedSample, values: Values, artifacts: Mapping[str, str]) -> dict[str, object]:
    """The content of placement.json."""
    intent, anchor, settled = values.intent, values.anchor, values.settled
    body = object_body(settled)
    verdict, reason = verdict_of(values)
    tree: dict[str, object] = {
        "verdict": verdict,
        "reason": reason,
        "message": values.infeasible.message if values.infeasible else None,
        "prompt": finished.sample.prompt,
        "base": base_of(values),
        "part": anchor.part if anchor else None,
        "region": anchor.region if anchor else None,
        "region_missed": region_missed(support_point(settled, body), anchor.region_polygon)
        if anchor and settled and body
        else None,
        "scale": intent.scale if intent else None,
        "mass": mass_of(values),
        "world_from_file": values.scan.world_from_file.tolist() if values.scan else None,
        "object_from_file": values.object_scan.world_from_file.tolist() if values.object_scan else None,
        "pre_drop": pose_of(anchor.world_from_object) if anchor else None,
        "pose": pose_of(world_from_start(body) @ anchor.world_from_object) if anchor and body else None,
        "object_aabb": body.surface.bounds.tolist() if body else None,
        "contacts": list(settled.contacts) if settled else from_evidence(values, "contacts", []),
        "materials": [material_row(row) for row in values.materials.rows] if values.materials else [],
        "geometry": [geometry_row(one) for one in values.particles.geometry] if values.particles else [],
        "certificate": certificate_of(values),
        "visible_fraction": values.renders.visible_fraction if values.renders else None,
        "warnings": warnings_of(values),
        "timings": timings_of(finished),
        "artifacts": dict(artifacts),
    }
    plain = to_tree(tree, "", {})
    assert isinstance(plain, dict)
    return plain


def base_of(values: Values) -> dict[str, str] | None:
    """What carries the object: the anchor's instance, perhaps a rug on the floor asked for; else the asked one."""
    intent, anchor = values.intent, values.anchor
    if anchor and values.scene:
        return {"id": anchor.base_id, "label": values.scene.instances[values.scene.index_of(anchor.base_id)].label}
    return {"id": intent.base_id, "label": intent.base_label} if intent else None


def mass_of(values: Values) -> float | None:
    """Mass that was simulated [kg], or the prior if nothing was."""
    if values.particles:
        return values.particles.bodies[0].inertial.mass
    return values.intent.mass if values.intent else None


def verdict_of(values: Values) -> tuple[str, str | None]:
    """Contract verdict and reason code."""
    if values.infeasible is not None:
        return "infeasible", str(values.infeasible.reason)
    assert values.settled is not None
    if values.settled.verdict == AT_REST:
        return AT_REST, None
    return "infeasible", values.settled.verdict


def certificate_of(values: Values) -> dict[str, object] | None:
    """The solver's certificate, or the evidence of the stage that found no way."""
    if values.settled is not None:
        return dict(values.settled.certificate)
    if values.infeasible is None:
        return None
    evidence = dict(values.infeasible.evidence)
    certificate = evidence.pop("certificate", {})
    assert isinstance(certificate, dict)
    for key in ("contacts", "warnings"):  # keys of their own
        evidence.pop(key, None)
    return certificate | evidence


def from_evidence(values: Values, key: str, otherwise: Any) -> Any:
    """What an infeasible drop says about its last state; `otherwise` if there is nothing."""
    return values.infeasible.evidence.get(key, otherwise) if values.infeasible else otherwise


def warnings_of(values: Values) -> list[str]:
    """What a reader should know, in the order of the stages, each once."""
    found: list[str] = list(values.scan.notes) if values.scan else []
    found += [f"object: {note}" for note in values.object_scan.notes] if values.object_scan else []
    if values.intent:
        found += values.intent.notes
        if values.intent.not_understood:
            found.append(f"not understood: {', '.join(values.intent.not_understood)}")
    found += values.particles.notes if values.particles else ()
    found += values.settled.warnings if values.settled else from_evidence(values, "warnings", [])
    return list(dict.fromkeys(found))


def timings_of(finished: FinishedSample) -> dict[str, float]:
    """Seconds that each stage took when it was computed; repeated stages are summed."""
    seconds: dict[str, float] = {}
    for stage, record, _ in finished.records:
        seconds[stage] = round(seconds.get(stage, 0.0) + record.seconds, 3)
    return seconds


def material_row(row: PartMaterial) -> dict[str, object]:
    """One row of `materials`."""
    return {
        "body": row.body,
        "part": row.part,
        "material": row.material.id,
        "model": str(row.model),
        "reason": row.reason,
        "density": row.material.density,
        "youngs_modulus": row.material.youngs_modulus,
        "poisson_ratio": row.material.poisson_ratio,
        "static_friction": row.material.static_friction,
        "dynamic_friction": row.material.dynamic_friction,
        "source": row.material.source,
    }


def geometry_row(one: BodyGeometry) -> dict[str, object]:
    """One row of `geometry`."""
    report = one.report
    return {
        "body": one.body,
        "part": one.part,
        "method": str(report.method),
        "closed": report.closed,
        "sides_agree": report.agreement,
        "hausdorff_m": report.hausdorff,
        "mean_m": report.mean,
        "tolerance_m": report.tolerance,
        "region_m": [list(report.region[:3]), list(report.region[3:])] if report.region else None,
        "volume_m3": report.volume,
        "repairs": list(report.repairs),
        "problem": report.problem or None,
    }


def object_body(settled: Settled | None) -> SettledBody | None:
    """The placed object among the settled bodies."""
    return next((one for one in settled.bodies if one.name == "object"), None) if settled else None


def world_from_start(body: SettledBody) -> NDArray[np.float64]:
    """Rigid map from the start of the drop to rest, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Turn.from_quat(body.quaternion, scalar_first=True).as_matrix()
    matrix[:3, 3] = body.position
    return matrix


def pose_of(world_from_object: NDArray[np.float64]) -> dict[str, object]:
    """Position of the object's origin [m] and its quaternion (w, x, y, z with w >= 0); the scale is left out."""
    linear = world_from_object[:3, :3]
    turn = Turn.from_matrix(linear / np.cbrt(np.linalg.det(linear)))
    return {
        "position": world_from_object[:3, 3].tolist(),
        "quaternion": turn.as_quat(canonical=True, scalar_first=True).tolist(),
    }


def support_point(settled: Settled, body: SettledBody) -> NDArray[np.float64]:
    """Middle of the contact patch seen from above [m], of the object's box if nothing touches, shape (2,)."""
    points = settled.contact_points if len(settled.contact_points) else body.surface.bounds
    middle: NDArray[np.float64] = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle[:2]


def write_geometry(values: Values, folder: Path) -> dict[str, str]:
    """object.ply and scene.glb, as far as there is something to write."""
    if values.scene is None:
        return {}
    scene, thing = values.scene, None
    if values.settled and values.anchor and values.item and values.settled.bodies:
        scene = settled_scene(values.scene, values.settled, values.anchor.base_id)
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
    source = store.folder(finished.overview or finished.placement.renders)
    names = [name for name in PICTURES if (source / f"{name}.png").is_file()]
    for name in names:
        shutil.copyfile(source / f"{name}.png", folder / f"{name}.png")
    return {name: f"{name}.png" for name in names}


def result_line(tree: Mapping[str, object]) -> str:
    """One line for a person."""
    base = tree["base"]
    where = f" on {base['label']} ({tree['part']})" if isinstance(base, Mapping) else ""
    if tree["verdict"] == AT_REST:
        return f"at rest{where}"
    return f"infeasible: {tree['reason']}{where}; {tree['message'] or ''}".rstrip("; ")

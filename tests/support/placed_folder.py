"""A folder as a placement writes it, made of the ball in the dented bed without running a drop."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from dented_bed import anchor, ball, scene_of, settled
from rest_records import CONTACT

from dcap.knowledge.material_table import load_materials
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from dcap.scene.writers.meshes import mesh_to_ply
from flows.next_scene import next_scene_files
from flows.placement_json import FinalState
from tasks.render.settled_meshes import settled_item, settled_scene

MASS = 0.4
"""Of the ball [kg]."""
PROMPT = "put the ball on the bed"


def values(**more: Mesh) -> Any:
    """What the stages of that placement returned, as far as it is asked for; further things stand in the room."""
    library = load_materials()
    rows = (
        PartMaterial("object", "body", 0, library["rubber_soft"], BodyModel.MPM, "a ball"),
        PartMaterial("bed", "body", 0, library["foam_mattress"], BodyModel.MPM, "a bed"),
    )
    bodies = (
        SimpleNamespace(name="object", instance="object", fixed=False, inertial=SimpleNamespace(mass=MASS)),
        SimpleNamespace(name="bed", instance="bed", fixed=True),
    )
    rest = settled()
    told = SimpleNamespace(
        scan=None, scene=scene_of(**more), item=ball(), anchor=anchor(), materials=SimpleNamespace(rows=rows),
        intent=SimpleNamespace(object_name="ball"), particles=SimpleNamespace(bodies=bodies),
        settled=SimpleNamespace(
            bodies=rest.bodies, contacts=(CONTACT,), contact_points=rest.contact_points, verdict=rest.verdict
        ),
    )  # fmt: skip
    told.final = FinalState(told.scene, told.item, told.anchor, told.settled)
    return told


def placed_folder(folder: Path, **more: Mesh) -> Path:
    """The files of its scene, a picture and a result."""
    told = values(**more)
    folder.mkdir(parents=True, exist_ok=True)
    thing = settled_item(told.item, told.anchor, told.settled.bodies[0])
    after = settled_scene(told.scene, told.settled, "bed").scene
    nodes = [Node("scene", children=tuple(labelled_nodes(after))), Node("object", thing)]
    (folder / "scene.glb").write_bytes(glb_bytes(nodes))
    (folder / "object.ply").write_bytes(mesh_to_ply(thing))
    for name, data in next_scene_files(told, PROMPT).items():
        (folder / name).write_bytes(data)
    (folder / "placement.json").write_text('{"base": {"id": "bed", "label": "bed"}}')
    (folder / "settled.png").write_bytes(b"")
    return folder


def read_placed(folder: Path) -> Scan:
    """The folder as a scene."""
    return read_scan(folder, SourceOptions(), Role.SCENE)

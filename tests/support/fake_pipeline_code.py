"""A pipeline of cheap stages that returns what a real one does, as the code of a module; and a data set for it."""

PIPELINE = """
from pathlib import Path
import numpy as np
from pydantic import BaseModel
from flows.place import PlacementRefs
from dcap.scene.types.choices import Anchor
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.errors import GeometryError
from dcap.scene.types.choices import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import Material, BodyModel, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, NotInScene, Reason
from dcap.scene.types.particles import Particles
from dcap.scene.types.pictures import Renders, Visibility
from dcap.scene.types.choices import Rotation
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from solver.certificate import Verdict
from tasks.artifact import Source, Store
from rest_records import history, implicit_certificate
from tasks.overview import overview_task
from tasks.cache import stage

MESH = Mesh.of(np.random.default_rng(0).random((30, 3)), np.arange(30).reshape(10, 3))
BOX = OrientedBox(np.zeros(3), np.eye(3), np.ones(3))
DOWN = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 2.0], [0, 0, 0, 1.0]])

def mesh(source: Source) -> Scan:
    if source.path.read_text() == "broken":
        raise GeometryError(f"{source.path}: broken on purpose")
    return Scan(MESH, np.full(10, -1, np.int32), (), (), (), "", np.eye(4), "z", 1.0, "format", ("welded",))

def segment(scan: Scan) -> Segmentation:
    one = Instance("7", "table", BOX, (Part("top", BOX, 1.0),), None)
    return Segmentation(scan.mesh, (one,), np.zeros(10, np.int32), np.zeros(10, np.int32))

def intent(scene: Segmentation, prompt: str) -> Intent | Infeasible:
    if "piano" in prompt:
        return Infeasible(Reason.TARGET_NOT_FOUND, "no piano; there is table", NotInScene("piano", ("table",), "ball"))
    region = RegionRequest("", ("center",), (), "")
    return Intent("7", "table", "ball", np.ones(3), 0.5, False, 1.0, OrientationRequest("any", "", ""), region, (), ())

def anchor(intent: Intent) -> Anchor:
    square = np.array([[-5.0, -5], [5, -5], [5, 5], [-5, 5]])
    return Anchor("7", "top", 0, "center", np.zeros(2), np.zeros(3), DOWN, 0.01, square, "")

def drop(anchor: Anchor, seed: int) -> Settled:
    lower = 0.1 if Path(__file__).with_name("nudged").exists() else 0.0  # as of a library that computes otherwise now
    body = SettledBody("object", MESH, np.array([0, 0, -1.0 - lower]), np.array([1.0, 0, 0, 0]), np.zeros((30, 3)))
    return Settled(
        Verdict.AT_REST, (body,), (), np.zeros((0, 3)), implicit_certificate(), history(2), seed, 0.5, ()
    )

def render(settled: Settled) -> Renders:
    picture = np.full((8, 8, 3), 100, np.uint8)
    seen = Visibility(np.array([[0.0, 15.0, 0.5, 0.5]]), 0.4)
    return Renders(picture, picture, picture, 0.5, np.array([3.0, -2.0, 1.5]), np.zeros(3), *[picture] * 3, seen)

stages = [stage(one) for one in (mesh, segment, intent, anchor, drop, render)]

def place(sample, config):
    read, divide, understand, aim, settle, paint = stages
    scan = read(Store.default().add_source(sample.scene))
    scene = divide(scan)
    wish = understand(scene, sample.prompt)
    target = aim(wish)
    settled = settle(target, sample.seed)
    pictures = paint(settled)
    return PlacementRefs(
        scene_scan=scan, object_scan=scan, scene_surface=scan, object_surface=scan, scene=scene,
        item=scene, intent=wish, rotation=wish, anchor=target,
        materials=wish, particles=settled, settled=settled, renders=pictures,
        overview=overview_task(scene, scene, None, None) if pictures.infeasible else None,
    )
"""
DATASET = """
- {id: good, scene: fine.ply, object: fine.ply, prompt: put the ball on the table, seed: 1}
- {id: none, scene: fine.ply, object: fine.ply, prompt: put the ball on the piano}
- {id: bad, scene: broken.ply, object: fine.ply, prompt: put the ball on the table}
- {id: "gone: {x}", scene: gone.ply, object: fine.ply, prompt: put the ball on the table}
"""
TRUTH = """
good: {base: table, part: top, feasible: true}
none: {feasible: false, reason: target_not_found}
bad: {base: table, part: top, feasible: true}
"""

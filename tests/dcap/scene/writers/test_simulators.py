"""Exported scenes as simulators read them: a ball in a dent of a bed stays there."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from dented_bed import RADIUS, TOP, anchor, ball, scene_of, settled
from dented_export import BALL, BED, MASS, PAIR, exported, particles
from rested import drift, written

from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.particles import GRAVITY
from dcap.scene.writers.mjcf import mjcf_files
from dcap.scene.writers.urdf import urdf_files
from dcap.scene.writers.usda import usda_files
from tasks.export.settled_export import export_scene, pairs_of

STAYS = 2e-3
"""How far a settled object may move in two seconds [m]."""


@pytest.fixture(scope="module")
def scene_xml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The ball in the dent as MJCF."""
    return written(tmp_path_factory.mktemp("mjcf"), mjcf_files(exported())) / "scene.xml"


def test_the_ball_stays_in_its_dent(scene_xml: Path) -> None:
    """Two seconds later its centre is within 2 mm of where it settled, far below the top of the bed plus its radius."""
    model = mujoco.MjModel.from_xml_path(str(scene_xml))
    assert drift(model, 2.0) < STAYS


def test_without_the_dent_it_would_not(scene_xml: Path) -> None:
    """The check can fail: on the hull of the bed's surface, which fills the dent, the ball is thrown out."""
    spec = mujoco.MjSpec.from_file(str(scene_xml))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.8, 1.0, TOP / 2], pos=[0, 0, TOP / 2])
    assert drift(spec.compile(), 2.0) > 5 * STAYS


def test_the_body_in_mujoco(scene_xml: Path) -> None:
    """Mass, inertia, centre of mass, gravity and the friction of the pair are those of the drop."""
    model = mujoco.MjModel.from_xml_path(str(scene_xml))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    body = model.body("object").id
    assert model.body_mass[body] == pytest.approx(MASS)
    assert model.body_inertia[body] == pytest.approx(np.full(3, 0.4 * MASS * RADIUS**2))
    np.testing.assert_allclose(data.xipos[body], settled().bodies[0].surface.bounds.mean(axis=0), atol=1e-6)
    assert model.opt.gravity[2] == -GRAVITY
    assert data.ncon > 0
    for contact in data.contact:
        assert contact.friction[0] == pytest.approx(PAIR.static)
        assert contact.friction[3] == pytest.approx(PAIR.rolling_resistance)
    names = {model.body(index).name for index in range(model.nbody)}
    assert {"object", "bed", "floor", "wall_back"} <= names
    assert model.geom("bed/body").contype == 0  # seen, and no collider


def test_a_part_of_the_object_with_another_friction() -> None:
    """Contacts of either half of the ball have the geometric mean of that half's friction and the bed's."""
    other = ContactFriction(0.1, 0.05, 0.001)
    scene = export_scene(scene_of(), ball(), anchor(), None, particles(other), settled())
    assert len(scene.thing.pieces) == 1
    # the ball is one convex piece, so one half decides; take the other for the whole of it
    piece = replace(scene.thing.pieces[0], friction=other)
    assert scene.thing.pieces[0].friction in (BALL, other)
    changed = replace(scene.thing, pieces=(piece,))
    full = replace(scene, thing=changed, pairs=pairs_of(changed, list(scene.fixed)))
    assert full.pairs
    model = mujoco.MjModel.from_xml_string(*as_string(mjcf_files(full)))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    pairs = [tuple(sorted(contact.geom.tolist())) for contact in data.contact]
    for contact in data.contact:
        assert contact.friction[0] == pytest.approx((other.static * BED.static) ** 0.5)
    assert drift(model, 0.2) < STAYS
    assert max(pairs.count(one) for one in set(pairs)) <= 5  # of an explicit pair and of its shapes not both


def as_string(files: dict[str, bytes]) -> tuple[str, dict[str, bytes]]:
    """MJCF with its files in memory."""
    return files["scene.xml"].decode(), {name: content for name, content in files.items() if name != "scene.xml"}


def test_urdf_is_read_by_mujoco(tmp_path: Path) -> None:
    """The object has its inertia and pieces, the scene its things as links that stand still; frames are the world's."""
    folder = written(tmp_path, urdf_files(exported()))
    for name in ("object", "scene"):
        tree = ElementTree.parse(folder / f"{name}.urdf")
        for mesh in tree.iter("mesh"):
            assert (folder / mesh.attrib["filename"]).is_file()
    compiler = '<mujoco><compiler strippath="false" discardvisual="true" fusestatic="false"/></mujoco></robot>'
    for name in ("object", "scene"):
        path = folder / f"{name}.urdf"
        path.write_text(path.read_text().replace("</robot>", compiler))
    thing = mujoco.MjModel.from_xml_path(str(folder / "object.urdf"))
    assert thing.ngeom == len(exported().thing.pieces)
    tree = ElementTree.parse(folder / "object.urdf")
    (mass,) = (float(one.attrib["value"]) for one in tree.iter("mass"))
    assert mass == pytest.approx(MASS)
    room = mujoco.MjModel.from_xml_path(str(folder / "scene.urdf"))
    assert room.nv == 0
    expected = sum(len(one.pieces) + sum(len(p.prisms) for p in one.patches) for one in exported().fixed)
    assert room.ngeom == expected
    position = " ".join(f"{number:.9g}" for number in exported().thing.position)
    assert position in (folder / "README.txt").read_text()


def test_usd_is_read_by_pixar(tmp_path: Path) -> None:
    """Units, axes, schemas, masses, colliders and bound friction are there for USD's own library."""
    pxr = pytest.importorskip("pxr")
    from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade

    assert pxr is not None
    stage = Usd.Stage.Open(str(written(tmp_path, usda_files(exported())) / "scene.usda"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    thing = stage.GetPrimAtPath("/World/object")
    assert thing.HasAPI(UsdPhysics.RigidBodyAPI)
    mass = UsdPhysics.MassAPI(thing)
    assert mass.GetMassAttr().Get() == pytest.approx(MASS)
    assert np.array(mass.GetDiagonalInertiaAttr().Get()) == pytest.approx(np.full(3, 0.4 * MASS * RADIUS**2))
    center = (
        UsdGeom.Xformable(thing).ComputeLocalToWorldTransform(0).Transform(Gf.Vec3d(mass.GetCenterOfMassAttr().Get()))
    )
    np.testing.assert_allclose(center, settled().bodies[0].surface.bounds.mean(axis=0), atol=1e-6)
    patch = stage.GetPrimAtPath("/World/bed/collision/contact")
    assert UsdPhysics.MeshCollisionAPI(patch).GetApproximationAttr().Get() == "none"
    assert min(point[2] for point in UsdGeom.Mesh(patch).GetPointsAttr().Get()) < TOP - 0.02
    bound, _ = UsdShade.MaterialBindingAPI(patch).ComputeBoundMaterial("physics")
    friction = UsdPhysics.MaterialAPI(bound.GetPrim())
    assert friction.GetStaticFrictionAttr().Get() == pytest.approx(PAIR.static)
    assert friction.GetDynamicFrictionAttr().Get() == pytest.approx(PAIR.dynamic)
    colliders = [one for one in stage.Traverse() if one.HasAPI(UsdPhysics.CollisionAPI)]
    expected = sum(len(one.pieces) + len(one.patches) for one in exported().fixed) + len(exported().thing.pieces)
    assert len(colliders) == expected
    shown = [one for one in stage.Traverse() if one.IsA(UsdGeom.Mesh) and not one.HasAPI(UsdPhysics.CollisionAPI)]
    assert all(len(UsdGeom.Gprim(one).GetDisplayColorAttr().Get()) > 0 for one in shown)


@pytest.mark.parametrize("write", [mjcf_files, urdf_files, usda_files])
def test_the_same_scene_is_the_same_bytes(write) -> None:
    again = export_scene(scene_of(), ball(), anchor(), None, particles(), settled())
    assert write(again) == write(exported())

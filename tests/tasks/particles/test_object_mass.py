"""What a closed mesh weighs in the drop: hollow things as such things do, not density times volume."""

import pytest
import trimesh
from box_rooms import segmentation

from dcap.language.offline.client import OfflineClient
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.materials.stage import MaterialsConfig, materials
from tasks.particles.config import ParticlesConfig
from tasks.particles.stage import particles
from tasks.rotation.stage import RotationConfig, rotation


def one(label: str, part: str, shape: trimesh.Trimesh) -> Segmentation:
    """One thing of one part."""
    return segmentation({label: (label, None, [(part, Mesh.of(shape.vertices, shape.faces))])})


TABLE = one("table", "top", trimesh.creation.box(bounds=[(-0.6, -0.4, 0.7), (0.6, 0.4, 0.74)]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "shape", "usual", "solid"),
    [
        ("basketball", trimesh.creation.icosphere(3, 0.12), 0.62, 0.5),
        ("vase", trimesh.creation.cylinder(0.07, 0.26, sections=32), 0.95, 5.0),
        ("laptop", trimesh.creation.box((0.35, 0.24, 0.02)), 1.9, 3.0),
    ],
)
def test_hollow_things_weigh_what_such_things_weigh(label, shape, usual, solid):
    """Within 15 % of the usual mass (the mesh is about, not exactly, of the usual size), and the effective density is
    said; `solid` is what the library's density would make of the closed mesh, at least."""
    item = one(label, "body", shape)
    meant = intent(
        SegmentedScene(TABLE),
        SegmentedObject(item),
        f"put the {label} on the table",
        None,
        IntentConfig(),
        OfflineClient(),
    )
    assert isinstance(meant, Intent)
    assert (meant.scale, meant.hollow) == (1.0, True)
    turned = rotation(
        SegmentedScene(TABLE), SegmentedObject(item), meant, "", RotationConfig(picture_size=64), OfflineClient()
    )
    assert isinstance(turned, Rotation)
    found = anchor(SegmentedScene(TABLE), SegmentedObject(item), meant, turned, "", AnchorConfig(), OfflineClient())
    assert isinstance(found, Anchor)
    rows = materials(SegmentedScene(TABLE), SegmentedObject(item), meant, found, "", MaterialsConfig(), OfflineClient())
    filled = particles(TABLE, item, meant, found, rows, ParticlesConfig(base_cells=500, object_cells=1000))  # type: ignore[arg-type]
    assert isinstance(filled, Particles)
    body = filled.bodies[0]
    assert body.inertial.mass == pytest.approx(usual, rel=0.15)
    assert "density is set" in rows.rows[0].reason  # type: ignore[union-attr]
    assert rows.rows[0].material.density * shape.volume > solid  # type: ignore[union-attr]
    assert any(f"so that it weighs {meant.mass:.3g} kg" in note for note in filled.notes)

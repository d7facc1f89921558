"""Writes an `ExportScene` as URDF: the object and, as a fixed robot, the scene, with their meshes.

Same input, same bytes. Source: the XML specification of URDF (ROS wiki). URDF has no free bodies, no poses of robots in
a world and no friction: README.txt states the pose, and <gazebo> tags carry the friction.
"""

from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dcap.scene.types.export_scene import ExportScene, FixedBody, FreeBody, SeenPart
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.meshes import obj_bytes, shape_bytes
from dcap.scene.writers.mjcf import constants_of, numbers, plain

OBJECT, SCENE, README = "object.urdf", "scene.urdf", "README.txt"
ROOT = "scene"


def urdf_files(scene: ExportScene) -> dict[str, bytes]:
    """The files, by their paths in the folder."""
    files: dict[str, bytes] = {}
    thing = [*header("object"), *free_link(scene, files), "</robot>"]
    room = [*header("scene"), f'  <link name="{ROOT}"/>']
    for body in scene.fixed:
        room += fixed_link(body, files)
    files[OBJECT] = text(thing)
    files[SCENE] = text([*room, "</robot>"])
    files[README] = text(readme(scene))
    return files


def text(lines: list[str]) -> bytes:
    """Lines as the bytes of a file."""
    return ("\n".join(lines) + "\n").encode()


def header(name: str) -> list[str]:
    """First lines of a robot."""
    return ['<?xml version="1.0" encoding="utf-8"?>', f'<robot name="{name}">']


def free_link(scene: ExportScene, files: dict[str, bytes]) -> Iterator[str]:
    """The object as one link."""
    body: FreeBody = scene.thing
    own, tensor = body.inertial, body.inertial.inertia
    yield f"  <!-- {comment(body.label)} -->"
    yield f'  <link name="{body.name}">'
    yield "    <inertial>"
    yield f'      <origin xyz="{numbers(own.center_of_mass)}" rpy="0 0 0"/>'
    yield f'      <mass value="{own.mass:.9g}"/>'
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    yield "      <inertia " + " ".join(f'{name}="{tensor[at]:.9g}"' for name, at in names.items()) + "/>"
    yield "    </inertial>"
    yield from seen(body.name, body.parts, files)
    for piece in body.pieces:
        yield from collision(piece.name, piece.mesh, files)
    yield "  </link>"
    yield from gazebo(body.name, scene.resting)


def fixed_link(body: FixedBody, files: dict[str, bytes]) -> Iterator[str]:
    """A thing of the scene as a link that is fixed to the root."""
    name = quoteattr(body.name)
    if body.label:
        yield f"  <!-- {comment(body.label)} -->"
    yield f"  <link name={name}>"
    yield from seen(body.name, body.parts, files)
    for patch in body.patches:
        for index, prism in enumerate(patch.prisms):
            yield from collision(f"{patch.name}/{index:04d}", prism, files)
    for piece in body.pieces:
        yield from collision(piece.name, piece.mesh, files)
    yield "  </link>"
    yield f'  <joint name={quoteattr(body.name + "_fixed")} type="fixed">'
    yield f'    <parent link="{ROOT}"/>'
    yield f"    <child link={name}/>"
    yield "  </joint>"
    frictions = [patch.friction for patch in body.patches] or [piece.friction for piece in body.pieces]
    if frictions:
        yield from gazebo(body.name, frictions[0])


def seen(body: str, parts: tuple[SeenPart, ...], files: dict[str, bytes]) -> Iterator[str]:
    """Visible meshes of a body."""
    for part in parts:
        path = f"meshes/{len(files):05d}_{plain(f'{body}/{part.name}')}.obj"
        files[path] = obj_bytes(part.mesh)
        if part.material is not None:
            yield f"    <!-- {comment(constants_of(part.material))} -->"
        name = quoteattr(f"{body}/{part.name}")
        yield f"    <visual name={name}>"
        yield f'      <geometry><mesh filename="{path}"/></geometry>'
        color = numbers(np.append(part.mesh.colors.mean(axis=0) / 255.0, 1.0), 3)
        yield f'      <material name={name}><color rgba="{color}"/></material>'
        yield "    </visual>"


def collision(name: str, mesh: Mesh, files: dict[str, bytes]) -> Iterator[str]:
    """A convex shape."""
    path = f"meshes/{len(files):05d}_{plain(name)}.obj"
    files[path] = shape_bytes(mesh)
    yield (f'    <collision name={quoteattr(name)}><geometry><mesh filename="{path}"/></geometry></collision>')


def gazebo(link: str, friction: ContactFriction) -> Iterator[str]:
    """A Gazebo tag with the friction."""
    yield f"  <gazebo reference={quoteattr(link)}>"
    yield f"    <mu1>{friction.static:.6g}</mu1><mu2>{friction.static:.6g}</mu2>"
    yield "  </gazebo>"


def readme(scene: ExportScene) -> list[str]:
    """README with the facts that URDF cannot express."""
    thing = scene.thing
    lines = [
        f"{OBJECT}: the object; {SCENE}: the scene as a fixed robot. Metres, kilograms, z up.",
        "",
        f"Load {SCENE} at the origin, fixed, and {OBJECT} free, with its origin at",
        f"  xyz {numbers(thing.position)}",
        f"  quaternion (w, x, y, z) {numbers(thing.quaternion)}",
        "",
        *(f"- {note}." for note in scene.notes),
        "",
        "URDF cannot express the following:",
        "- the pose of a robot in the world: see above.",
        "- friction: <gazebo> tags carry static coefficients: the object's is that of the pair in which it rests, a",
        "  thing's that of its pair with the object. Gazebo takes the smaller of two; other readers ignore the tags.",
    ]
    for body in scene.fixed:
        for patch in body.patches:
            friction = patch.friction
            lines.append(
                f"    {thing.name} on {patch.name}: static {friction.static:.4g}, dynamic {friction.dynamic:.4g}, "
                f"rolling resistance {friction.rolling_resistance:.4g} m"
            )
    lines += [
        "- density, Young's modulus and Poisson ratio: comments at each part.",
        "- gravity, time step, contact stiffness: set them in your simulator.",
    ]
    return lines


def comment(words: str) -> str:
    """Text that is valid in an XML comment."""
    return escape(words).replace("--", "-")

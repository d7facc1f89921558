"""Writes an `ExportScene` as one USD text file with UsdGeom meshes and UsdPhysics schemas; needs no USD library.

Same input, same bytes. Metres, kilograms, z up. Sources: OpenUSD's documentation of the text format, UsdGeom, UsdShade
and UsdPhysics. Visible meshes do not collide: colliders are separate meshes of purpose `guide`. Near the object they
are the settled triangles themselves (approximation `none`), elsewhere convex pieces (`convexHull`).
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.export_scene import ExportScene, FixedBody, FreeBody, SeenPart, replace_friction
from dcap.scene.types.materials import ContactFriction, Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY

SCENE = "scene.usda"
WORLD, LOOKS = "/World", "/World/Materials"


def usda_files(scene: ExportScene) -> dict[str, bytes]:
    """The file, by its path in the folder."""
    return {SCENE: _UsdaWriter(scene).text().encode()}


class _UsdaWriter:
    """Collects prims and the physics materials to which they are bound."""

    def __init__(self, scene: ExportScene) -> None:
        self.scene = scene
        self.frictions: dict[ContactFriction, str] = {}
        self.constants: dict[Material, str] = {}
        self.names = _Names()

    def text(self) -> str:
        """The file."""
        notes = "\n".join([*(f"{one}." for one in self.scene.notes), FRICTION_NOTE])
        bodies = [*self.free(self.scene.thing)]
        for one in self.scene.fixed:
            bodies += self.fixed(one)
        lines = [
            "#usda 1.0",
            "(",
            '    defaultPrim = "World"',
            f"    doc = {quoted(notes)}",
            "    kilogramsPerUnit = 1",
            "    metersPerUnit = 1",
            '    upAxis = "Z"',
            ")",
            "",
            'def Xform "World"',
            "{",
            '    def PhysicsScene "PhysicsScene"',
            "    {",
            "        vector3f physics:gravityDirection = (0, 0, -1)",
            f"        float physics:gravityMagnitude = {GRAVITY}",
            "    }",
            *indented(bodies),
            *indented(self.materials()),
            "}",
        ]
        return "\n".join(lines) + "\n"

    def free(self, body: FreeBody) -> Iterator[str]:
        """The object."""
        own = body.inertial
        moments, axes = principal(own.inertia)
        yield f'def Xform "{self.names.of(WORLD, body.name)}" ('
        yield '    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]'
        yield ")"
        yield "{"
        yield f"    custom string dcap:label = {quoted(body.label)}"
        yield f"    point3f physics:centerOfMass = {tuple_of(own.center_of_mass)}"
        yield f"    float3 physics:diagonalInertia = {tuple_of(moments)}"
        yield f"    float physics:mass = {own.mass:.9g}"
        yield f"    quatf physics:principalAxes = {tuple_of(axes)}"
        yield f"    quatd xformOp:orient = {tuple_of(body.quaternion, 17)}"
        yield f"    double3 xformOp:translate = {tuple_of(body.position, 17)}"
        yield '    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
        resting = self.scene.resting
        shapes = [
            (
                piece.name.split("/")[-1],
                piece.mesh,
                "convexHull",
                replace_friction(resting, body.friction, piece.friction),
            )
            for piece in body.pieces
        ]
        yield from indented(self.inner(f"{WORLD}/{body.name}", body.parts, shapes))
        yield "}"

    def fixed(self, body: FixedBody) -> Iterator[str]:
        """A thing of the scene."""
        name = self.names.of(WORLD, body.name)
        shapes = [(patch.name.split("/")[-1], patch.surface, "none", patch.friction) for patch in body.patches]
        shapes += [(piece.name.split("/")[-1], piece.mesh, "convexHull", piece.friction) for piece in body.pieces]
        yield f'def Xform "{name}"'
        yield "{"
        yield f"    custom string dcap:id = {quoted(body.name)}"
        yield f"    custom string dcap:label = {quoted(body.label)}"
        yield from indented(self.inner(f"{WORLD}/{name}", body.parts, shapes))
        yield "}"

    def inner(
        self, path: str, parts: Sequence[SeenPart], shapes: Sequence[tuple[str, Mesh, str, ContactFriction]]
    ) -> Iterator[str]:
        """Visible meshes of a body, and its colliders."""
        for part in parts:
            yield f'def Mesh "{self.names.of(path, part.name)}"' + head_of(self.look(part.material))
            yield "{"
            yield f"    custom string dcap:part = {quoted(part.name)}"
            yield from indented(geometry(part.mesh))
            yield f"    color3f[] primvars:displayColor = {array_of(part.mesh.colors / 255.0, 3)} ("
            yield '        interpolation = "vertex"'
            yield "    )"
            yield from indented(bound(self.look(part.material), ""))
            yield "}"
        if not shapes:
            return
        own = self.names.of(path, "collision")
        yield f'def Scope "{own}"'
        yield "{"
        for name, mesh, approximation, friction in shapes:
            yield f'    def Mesh "{self.names.of(f"{path}/{own}", name)}" ('
            yield (
                '        prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI"]'
            )
            yield "    )"
            yield "    {"
            yield f'        uniform token physics:approximation = "{approximation}"'
            yield '        uniform token purpose = "guide"'
            yield from indented(geometry(mesh), 2)
            yield from indented(bound(self.slip(friction), ":physics"), 2)
            yield "    }"
        yield "}"

    def slip(self, friction: ContactFriction) -> str:
        """Name of the physics material with a friction."""
        if friction not in self.frictions:
            self.frictions[friction] = self.names.of(LOOKS, f"friction_{len(self.frictions)}")
        return self.frictions[friction]

    def look(self, material: Material | None) -> str:
        """Name of the material with constants; empty for none."""
        if material is None:
            return ""
        if material not in self.constants:
            self.constants[material] = self.names.of(LOOKS, material.id)
        return self.constants[material]

    def materials(self) -> Iterator[str]:
        """All materials in use."""
        yield 'def Scope "Materials"'
        yield "{"
        for friction, name in self.frictions.items():
            yield f'    def Material "{name}" ('
            yield '        prepend apiSchemas = ["PhysicsMaterialAPI"]'
            yield "    )"
            yield "    {"
            yield f"        custom float dcap:rollingResistance = {friction.rolling_resistance:.9g}"
            yield f"        float physics:dynamicFriction = {friction.dynamic:.9g}"
            yield "        float physics:restitution = 0"
            yield f"        float physics:staticFriction = {friction.static:.9g}"
            yield "    }"
        for material, name in self.constants.items():
            yield f'    def Material "{name}" ('
            yield '        prepend apiSchemas = ["PhysicsMaterialAPI"]'
            yield "    )"
            yield "    {"
            yield f"        custom float dcap:poissonRatio = {material.poisson_ratio:.9g}"
            yield f"        custom float dcap:rollingResistance = {material.rolling_resistance:.9g}"
            yield f"        custom float dcap:youngsModulus = {material.youngs_modulus:.9g}"
            yield f"        float physics:density = {material.density:.9g}"
            yield f"        float physics:dynamicFriction = {material.dynamic_friction:.9g}"
            yield f"        float physics:staticFriction = {material.static_friction:.9g}"
            yield "    }"
        yield "}"


FRICTION_NOTE = (
    "Simulators combine the friction of two materials by a rule of their own. Each collider of the scene has the "
    "friction of its pair with the object, and the object that of the pair where it rests: mean, smaller and larger of "
    "the two are what the drop had there."
)


class _Names:
    """Names of prims: letters, digits and underscores, unique among their siblings."""

    def __init__(self) -> None:
        self.used: set[tuple[str, str]] = set()

    def of(self, parent: str, name: str) -> str:
        """An unused name below a parent."""
        plain = "".join(one if one.isascii() and (one.isalnum() or one == "_") else "_" for one in name) or "_"
        plain = f"_{plain}" if plain[0].isdigit() else plain
        found, number = plain, 2
        while (parent, found) in self.used:
            found, number = f"{plain}_{number}", number + 1
        self.used.add((parent, found))
        return found


def head_of(material: str) -> str:
    """The head of a prim with a bound material."""
    return ' (\n    prepend apiSchemas = ["MaterialBindingAPI"]\n)' if material else ""


def bound(material: str, purpose: str) -> Iterator[str]:
    """The relation to a material; empty without one."""
    if material:
        yield f"    rel material:binding{purpose} = <{LOOKS}/{material}>"


def principal(inertia: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Principal moments [kg m^2] and the body-from-principal rotation (w, x, y, z) of a tensor (3, 3)."""
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return moments, np.asarray(Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True))


def geometry(mesh: Mesh) -> Iterator[str]:
    """Attributes of a triangle mesh."""
    yield f"    float3[] extent = {array_of(mesh.bounds, 7)}"
    yield f"    int[] faceVertexCounts = [{', '.join(['3'] * len(mesh.faces))}]"
    yield f"    int[] faceVertexIndices = [{', '.join(map(str, mesh.faces.ravel().tolist()))}]"
    yield f"    point3f[] points = {array_of(mesh.vertices, 7)}"
    yield '    uniform token subdivisionScheme = "none"'


def array_of(rows: NDArray[np.floating], digits: int) -> str:
    """Rows of three numbers."""
    return "[" + ", ".join(f"(%.{digits}g, %.{digits}g, %.{digits}g)" % tuple(row) for row in rows.tolist()) + "]"


def tuple_of(values: NDArray[np.float64], digits: int = 9) -> str:
    """Numbers in brackets."""
    return "(" + ", ".join(f"{value:.{digits}g}" for value in values.tolist()) + ")"


def quoted(words: str) -> str:
    """A string."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def indented(lines: Iterator[str] | Sequence[str], times: int = 1) -> Iterator[str]:
    """Lines inside a prim, indented."""
    return ("    " * times + one for one in lines)

"""Writes an `ExportScene` as one USD text file with UsdGeom meshes and UsdPhysics schemas; needs no USD library.

Same input, same bytes. Metres, kilograms, z up. Sources: OpenUSD's documentation of the text format, UsdGeom, UsdShade
and UsdPhysics. Visible meshes do not collide: colliders are separate meshes of purpose `guide`. Near the object they
are the settled triangles themselves (approximation `none`), elsewhere convex pieces (`convexHull`).
"""

from collections.abc import Iterable, Iterator, Sequence

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
        gravity = ["vector3f physics:gravityDirection = (0, 0, -1)", f"float physics:gravityMagnitude = {GRAVITY}"]
        content = [*prim("PhysicsScene", "PhysicsScene", gravity), *self.free(self.scene.thing)]
        for one in self.scene.fixed:
            content += self.fixed(one)
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
            *prim("Xform", "World", [*content, *self.materials()]),
        ]
        return "\n".join(lines) + "\n"

    def free(self, body: FreeBody) -> Iterator[str]:
        """The object."""
        own = body.inertial
        moments, axes = principal(own.inertia)
        resting = self.scene.resting
        shapes = [
            (piece.name, piece.mesh, "convexHull", replace_friction(resting, body.friction, piece.friction))
            for piece in body.pieces
        ]
        name = self.names.of(WORLD, body.name)
        lines = [
            f"custom string dcap:label = {quoted(body.label)}",
            f"point3f physics:centerOfMass = {tuple_of(own.center_of_mass)}",
            f"float3 physics:diagonalInertia = {tuple_of(moments)}",
            f"float physics:mass = {own.mass:.9g}",
            f"quatf physics:principalAxes = {tuple_of(axes)}",
            f"quatd xformOp:orient = {tuple_of(body.quaternion, 17)}",
            f"double3 xformOp:translate = {tuple_of(body.position, 17)}",
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]',
            *self.inner(f"{WORLD}/{name}", body.parts, shapes),
        ]
        yield from prim("Xform", name, lines, "PhysicsRigidBodyAPI", "PhysicsMassAPI")

    def fixed(self, body: FixedBody) -> Iterator[str]:
        """A thing of the scene."""
        name = self.names.of(WORLD, body.name)
        shapes = [(patch.name, patch.surface, "none", patch.friction) for patch in body.patches]
        shapes += [(piece.name, piece.mesh, "convexHull", piece.friction) for piece in body.pieces]
        lines = [
            f"custom string dcap:id = {quoted(body.name)}",
            f"custom string dcap:label = {quoted(body.label)}",
            *self.inner(f"{WORLD}/{name}", body.parts, shapes),
        ]
        yield from prim("Xform", name, lines)

    def inner(
        self, path: str, parts: Sequence[SeenPart], shapes: Sequence[tuple[str, Mesh, str, ContactFriction]]
    ) -> Iterator[str]:
        """Visible meshes of a body, and its colliders."""
        for part in parts:
            look = self.look(part.material)
            lines = [
                f"custom string dcap:part = {quoted(part.name)}",
                *geometry(part.mesh),
                f"color3f[] primvars:displayColor = {array_of(part.mesh.colors / 255.0, 3)} (",
                '    interpolation = "vertex"',
                ")",
                *([f"rel material:binding = <{LOOKS}/{look}>"] if look else []),
            ]
            apis = ["MaterialBindingAPI"] if look else []
            yield from prim("Mesh", self.names.of(path, part.name), lines, *apis)
        if shapes:
            own = self.names.of(path, "collision")
            colliders = (line for shape in shapes for line in self.collider(f"{path}/{own}", *shape))
            yield from prim("Scope", own, colliders)

    def collider(
        self, path: str, name: str, mesh: Mesh, approximation: str, friction: ContactFriction
    ) -> Iterator[str]:
        """A collision shape below a path."""
        if friction not in self.frictions:
            self.frictions[friction] = self.names.of(LOOKS, f"friction_{len(self.frictions)}")
        lines = [
            f'uniform token physics:approximation = "{approximation}"',
            'uniform token purpose = "guide"',
            *geometry(mesh),
            f"rel material:binding:physics = <{LOOKS}/{self.frictions[friction]}>",
        ]
        apis = ("PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI")
        yield from prim("Mesh", self.names.of(path, name.split("/")[-1]), lines, *apis)

    def look(self, material: Material | None) -> str:
        """Name of the material with constants; empty for none."""
        if material is None:
            return ""
        if material not in self.constants:
            self.constants[material] = self.names.of(LOOKS, material.id)
        return self.constants[material]

    def materials(self) -> Iterator[str]:
        """All materials in use."""
        found: list[str] = []
        for friction, name in self.frictions.items():
            lines = [
                f"custom float dcap:rollingResistance = {friction.rolling_resistance:.9g}",
                f"float physics:dynamicFriction = {friction.dynamic:.9g}",
                "float physics:restitution = 0",
                f"float physics:staticFriction = {friction.static:.9g}",
            ]
            found += prim("Material", name, lines, "PhysicsMaterialAPI")
        for material, name in self.constants.items():
            lines = [
                f"custom float dcap:poissonRatio = {material.poisson_ratio:.9g}",
                f"custom float dcap:rollingResistance = {material.rolling_resistance:.9g}",
                f"custom float dcap:youngsModulus = {material.youngs_modulus:.9g}",
                f"float physics:density = {material.density:.9g}",
                f"float physics:dynamicFriction = {material.dynamic_friction:.9g}",
                f"float physics:staticFriction = {material.static_friction:.9g}",
            ]
            found += prim("Material", name, lines, "PhysicsMaterialAPI")
        yield from prim("Scope", "Materials", found)


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


def prim(kind: str, name: str, lines: Iterable[str], *apis: str) -> Iterator[str]:
    """A prim with its content and the schemas that are applied to it."""
    yield f'def {kind} "{name}"' + (" (" if apis else "")
    if apis:
        yield f"    prepend apiSchemas = [{', '.join(quoted(one) for one in apis)}]"
        yield ")"
    yield "{"
    yield from (f"    {line}" for line in lines)
    yield "}"


def principal(inertia: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Principal moments [kg m^2] and the body-from-principal rotation (w, x, y, z) of a tensor (3, 3)."""
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return moments, np.asarray(Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True))


def geometry(mesh: Mesh) -> list[str]:
    """Attributes of a triangle mesh."""
    return [
        f"float3[] extent = {array_of(mesh.bounds, 7)}",
        f"int[] faceVertexCounts = [{', '.join(['3'] * len(mesh.faces))}]",
        f"int[] faceVertexIndices = [{', '.join(map(str, mesh.faces.ravel().tolist()))}]",
        f"point3f[] points = {array_of(mesh.vertices, 7)}",
        'uniform token subdivisionScheme = "none"',
    ]


def array_of(rows: NDArray[np.floating], digits: int) -> str:
    """Rows of three numbers."""
    return "[" + ", ".join(f"(%.{digits}g, %.{digits}g, %.{digits}g)" % tuple(row) for row in rows.tolist()) + "]"


def tuple_of(values: NDArray[np.float64], digits: int = 9) -> str:
    """Numbers in brackets."""
    return "(" + ", ".join(f"{value:.{digits}g}" for value in values.tolist()) + ")"


def quoted(words: str) -> str:
    """A string."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'

"""Writes an `ExportScene` as MJCF, MuJoCo's own format: `scene.xml` and its meshes.

Same input, same bytes. Source: MuJoCo's XML reference. MuJoCo takes the larger friction of two shapes, unless one has a
higher priority: the fixed shapes have it, with the friction of the pair; a piece of the object whose friction differs
from the main one has explicit pairs. MuJoCo has a single coefficient: it gets the static one, which holds things at
rest.
"""

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.export_scene import ExportScene, FixedBody, FreeBody, SeenPart
from dcap.scene.types.materials import ContactFriction, Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY
from dcap.scene.writers.meshes import obj_bytes, shape_bytes

SCENE = "scene.xml"
TIMESTEP = 0.002
"""Time step [s]."""
SOLREF = "0.005 1"
"""Time constant [s] (at least two steps) and damping ratio of contacts: a body at rest sinks in by micrometres."""
SOLIMP = "0.95 0.99 0.0005"
"""Impedance at the surface, at depth, and the depth of the transition [m]."""
TORSION = 0.001
"""Torsional friction [m], which the drop lacks: that of contact points a millimetre apart."""
UP = np.array([0.0, 0.0, 1.0])
LEAST = 1e-5
"""Least friction that MuJoCo accepts."""


def mjcf_files(scene: ExportScene) -> dict[str, bytes]:
    """The files, by their paths in the folder."""
    writer = _MjcfWriter(scene)
    return {**writer.files, SCENE: writer.text().encode()}


class _MjcfWriter:
    """Collects meshes, bodies and pairs."""

    def __init__(self, scene: ExportScene) -> None:
        self.scene = scene
        self.files: dict[str, bytes] = {}
        self.assets: list[str] = []
        self.texts: list[str] = []
        self.bodies = [line for one in scene.fixed for line in self.fixed(one)]
        self.bodies += self.free(scene.thing)

    def text(self) -> str:
        """scene.xml."""
        thing = self.scene.thing
        low, high = zip(*(part.mesh.bounds for part in thing.parts), strict=True)
        extent = float(np.linalg.norm(np.max(high, axis=0) - np.min(low, axis=0)))
        comment = [*(note.replace("--", "-") for note in self.scene.notes)]
        lines = [
            '<?xml version="1.0" encoding="utf-8"?>',
            "<!--",
            "  Metres, kilograms, seconds, z up. " + " ".join(f"{one}." for one in comment).strip(),
            f"  Contacts: solref {SOLREF}, solimp {SOLIMP}, elliptic cones, impratio 10, step {TIMESTEP} s: rigid",
            "  contact sinks in by less than 0.05 mm, and friction does not creep. Friction: the static coefficient of",
            "  the pair; the dynamic one and other constants of the materials are in <custom>.",
            "-->",
            '<mujoco model="dcap">',
            '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>',
            f'  <option timestep="{TIMESTEP}" gravity="0 0 {-GRAVITY}" integrator="implicitfast" cone="elliptic"',
            '    solver="Newton" iterations="100" tolerance="1e-10" impratio="10">',
            '    <flag multiccd="enable"/>',
            "  </option>",
            '  <size memory="256M"/>',
            f'  <statistic center="{numbers(thing.position)}" extent="{extent:.4g}"/>',
            "  <default>",
            f'    <geom solref="{SOLREF}" solimp="{SOLIMP}"/>',
            f'    <pair solref="{SOLREF}" solimp="{SOLIMP}"/>',
            '    <default class="visual">',
            '      <geom type="mesh" contype="0" conaffinity="0" group="2" mass="0"/>',
            "    </default>",
            '    <default class="collision">',
            '      <geom type="mesh" group="3" mass="0" rgba="0.4 0.6 0.9 0.5"/>',
            "    </default>",
            "  </default>",
            "  <custom>",
            *self.texts,
            "  </custom>",
            "  <asset>",
            *self.assets,
            "  </asset>",
            "  <worldbody>",
            f'    <light pos="{numbers(thing.position + 2.0 * UP)}" dir="0 0 -1" directional="true"/>',
            *self.bodies,
            "  </worldbody>",
            *self.contacts(),
            "  <keyframe>",
            f'    <key name="settled" qpos="{numbers(thing.position)} {numbers(thing.quaternion)}"/>',
            "  </keyframe>",
            "</mujoco>",
        ]
        return "\n".join(lines) + "\n"

    def fixed(self, body: FixedBody) -> Iterator[str]:
        """Lines of a thing of the scene."""
        self.say(f"label/{body.name}", body.label)
        yield f"    <body name={quoteattr(body.name)}>"
        yield from self.seen(body.name, body.parts)
        for patch in body.patches:
            shared = f'class="collision" priority="1" {friction_of(patch.friction)}'
            for index, prism in enumerate(patch.prisms):
                yield self.inline(f"{patch.name}/{index}", prism, shared)
        for piece in body.pieces:
            shared = f'class="collision" priority="1" {friction_of(piece.friction)}'
            yield self.inline(piece.name, piece.mesh, shared)
        yield "    </body>"

    def free(self, body: FreeBody) -> Iterator[str]:
        """Lines of the object."""
        self.say(f"label/{body.name}", body.label)
        own, inertia = body.inertial, body.inertial.inertia
        six = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        yield f'    <body name="{body.name}" pos="{numbers(body.position)}" quat="{numbers(body.quaternion)}">'
        yield f'      <freejoint name="{body.name}"/>'
        yield (
            f'      <inertial pos="{numbers(own.center_of_mass)}" mass="{own.mass:.9g}" '
            f'fullinertia="{numbers(np.array(six))}"/>'
        )
        yield from self.seen(body.name, body.parts)
        for index, piece in enumerate(body.pieces):
            path = f"meshes/object_piece_{index:02d}.obj"
            self.files[path] = shape_bytes(piece.mesh)
            self.assets.append(f'    <mesh name="{piece.name}" file="{path}"/>')
            yield (
                f'      <geom name="{piece.name}" class="collision" mesh="{piece.name}" {friction_of(piece.friction)}/>'
            )
        yield "    </body>"

    def seen(self, body: str, parts: tuple[SeenPart, ...]) -> Iterator[str]:
        """Lines of the visible meshes of a body."""
        for part in parts:
            name = f"{body}/{part.name}"
            path = f"meshes/{len(self.files):04d}_{plain(name)}.obj"
            self.files[path] = obj_bytes(part.mesh)
            self.assets.append(f'    <mesh name={quoteattr(name)} file="{path}" inertia="shell"/>')
            if part.material is not None:
                self.say(f"material/{name}", constants_of(part.material))
            color = numbers(np.append(part.mesh.colors.mean(axis=0) / 255.0, 1.0), 3)
            yield f'      <geom name={quoteattr(name)} class="visual" mesh={quoteattr(name)} rgba="{color}"/>'

    def inline(self, name: str, mesh: Mesh, shared: str) -> str:
        """A convex shape with inline vertices relative to its own middle, for single precision."""
        middle = mesh.vertices.mean(axis=0).round(4)
        points = numbers((mesh.vertices - middle).ravel(), 7)
        self.assets.append(f'    <mesh name={quoteattr(name)} vertex="{points}"/>')
        return f'      <geom name={quoteattr(name)} mesh={quoteattr(name)} pos="{numbers(middle)}" {shared}/>'

    def contacts(self) -> Iterator[str]:
        """Lines for pairs with their own friction."""
        if self.scene.pairs:
            yield "  <contact>"
            for one in self.scene.pairs:
                friction = one.friction
                five = f"{slide(friction)} {slide(friction)} {TORSION} {roll(friction)} {roll(friction)}"
                other = quoteattr(f"{one.patch}/{one.prism}")
                yield f'    <pair geom1="{one.piece}" geom2={other} condim="6" friction="{five}"/>'
            yield "  </contact>"

    def say(self, name: str, text: str) -> None:
        """Add a text to <custom>."""
        if text:
            self.texts.append(f"    <text name={quoteattr(name)} data={quoteattr(text)}/>")


def friction_of(friction: ContactFriction) -> str:
    """Attributes of a shape."""
    return f'condim="6" friction="{slide(friction)} {TORSION} {roll(friction)}"'


def slide(friction: ContactFriction) -> str:
    """Static coefficient [-]."""
    return f"{max(friction.static, LEAST):.6g}"


def roll(friction: ContactFriction) -> str:
    """Rolling resistance [m]."""
    return f"{max(friction.rolling_resistance, LEAST):.6g}"


def constants_of(material: Material) -> str:
    """Constants that a simulator of rigid bodies does not support."""
    return (
        f"{material.id}: density {material.density:g} kg/m3, Young's modulus {material.youngs_modulus:g} Pa, "
        f"Poisson ratio {material.poisson_ratio:g}, static friction {material.static_friction:g}, dynamic friction "
        f"{material.dynamic_friction:g}, rolling resistance {material.rolling_resistance:g} m"
    )


def numbers(values: NDArray[np.float64], digits: int = 9) -> str:
    """Numbers with `digits` significant digits."""
    return " ".join(f"{value:.{digits}g}" for value in np.asarray(values).tolist())


def plain(name: str) -> str:
    """A name that is valid for a file."""
    return "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)[:60]

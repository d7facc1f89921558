"""Soft and mixed things through all nine stages: what mechanics demands of the drop's input and of the rest state.

Scenes and things are made here, so that every thickness is known; moduli, densities and friction are those of
materials.csv for what the stages chose. Depths are compared with closed forms or with a finite element solution of
another kind (tests/support/layered_dent.py).
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import furnished as make
import numpy as np
import pytest
from furnished import Parts
from layered_dent import Layer, dent, disc_sink
from numpy.typing import NDArray

from dcap.geometry.pieces import signed_volume
from dcap.knowledge.material_table import load_materials
from dcap.scene.types.materials import Material
from dcap.scene.types.particles import GRAVITY, NodeState, Particles, SoftSimulationBody
from dcap.scene.types.settled import Settled
from flows.cli.app import main
from solver.contact.friction import PairFriction
from tasks.artifact import Store
from tasks.bodies.solver_model import solver_model
from tasks.particles.drop_setup import RIGID_CONTRAST

PENETRATION = 5e-5
"""What contacts aim at [m]."""
RESIDUAL = 5e-3
"""Of the weight, what the certificate leaves unbalanced."""


@dataclass(frozen=True)
class Placed:
    """One placement and the artifacts that it left."""

    tree: Any
    """placement.json."""
    particles: Particles
    settled: Settled

    @property
    def weight(self) -> float:
        """[N]."""
        return GRAVITY * float(self.tree["mass"])

    @property
    def carried(self) -> float:
        """Sum of the contacts' normal forces [N]."""
        return float(sum(one["normal_force_n"] for one in self.tree["contacts"]))

    def body(self, index: int) -> SoftSimulationBody:
        """A body that must be soft."""
        body = self.particles.bodies[index]
        assert isinstance(body, SoftSimulationBody)
        return body

    def material(self, body: str, part: str) -> Material:
        """The library's row of what was chosen for a part."""
        row = next(one for one in self.tree["materials"] if (one["body"], one["part"]) == (body, part))
        return load_materials()[row["material"]]


Place = Callable[..., Placed]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Place:
    """Puts things in scenes, each in a store of its own."""
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    monkeypatch.delenv("PREFECT_API_URL", raising=False)

    def run(scene: Parts, label: str, item: Parts, name: str, prompt: str, *options: str) -> Placed:
        files = [make.written(tmp_path / f"{label}.glb", scene), make.written(tmp_path / f"{name}.glb", item)]
        folder = tmp_path / f"placed{len(list(tmp_path.glob('placed*')))}"
        monkeypatch.setenv("DCAP_DATA", str(folder / "data"))
        arguments = ["place", *map(str, files), prompt, "--label", label, "--out", str(folder / "out"), "--json"]
        assert main([*arguments, *options]) == 0
        store, found = Store.default(), {}
        for kind in (Particles, Settled):
            (ref,) = [ref for ref in store.refs() if ref.kind == kind.__name__]
            found[kind] = store.load(ref)
        particles, settled = found[Particles], found[Settled]
        assert isinstance(particles, Particles)
        assert isinstance(settled, Settled)
        written = capsys.readouterr().out
        assert not re.search(r"\bnan\b", written, re.IGNORECASE)  # in messages too
        return Placed(json.loads(written), particles, settled)

    return run


def ends_of(placed: Placed, share: float) -> tuple[float, float]:
    """Mean heights [m] at which the flat underside and top of the object have come to rest, over a share of its sides
    in the middle: at a rim the layers of cloth stand upright as far as half the height."""
    settled = placed.settled.bodies[0]
    now, rest = settled.surface.vertices, settled.surface.vertices - settled.displacement
    half = 0.5 * share * np.ptp(rest[:, :2], axis=0) + 1e-6
    middle = (np.abs(rest[:, :2] - rest[:, :2].mean(axis=0)) <= half).all(axis=1)
    low, high = (now[middle & (np.abs(rest[:, 2] - end) < 1e-6), 2] for end in (rest[:, 2].min(), rest[:, 2].max()))
    return float(low.mean()), float(high.mean())


def pair_friction(placed: Placed, a: int, b: int, where: NDArray[np.bool_]) -> tuple[float, float]:
    """Static and dynamic friction that the solver takes between two bodies where all of a body's points (n,) at a place
    touch."""
    model = solver_model(placed.particles, (0.0, 0.0, -GRAVITY))
    points = np.flatnonzero(where)
    rows = PairFriction.of(model, model.bodies[a], model.bodies[b]).at(points, model.bodies[a].vertices[points])
    assert np.ptp(rows, axis=0) == pytest.approx(0.0, abs=1e-12)
    return float(rows[0, 0]), float(rows[0, 1])


def mean_friction(one: Material, other: Material) -> tuple[float, float]:
    """The rule: geometric means of what the two rows say."""
    static, dynamic = one.static_friction * other.static_friction, one.dynamic_friction * other.dynamic_friction
    return static**0.5, dynamic**0.5


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("solver", "tolerance"), [("tl", 0.03), ("mls", 0.1)])
def test_a_ball_on_a_blanket_dents_layers_not_a_block(place: Place, solver: str, tolerance: float) -> None:
    """Under a blanket 3 cm thick lies the mattress at every depth, and the dent is as deep as in those layers."""
    top, thick, blanket, radius = 0.5, 0.2, 0.03, 0.108
    ball = {"body": make.ball(radius)}
    prompt = "put the bowling ball on the bed"
    placed = place(make.bed(top, thick, blanket), "bed", ball, "bowling_ball", prompt, "--solver", solver)
    tree, bed = placed.tree, placed.body(1)
    assert (tree["verdict"], tree["reason"], tree["part"]) == ("at_rest", None, "blanket")

    cover, foam, resin = (
        placed.material(*part) for part in (("bed", "blanket"), ("bed", "mattress"), ("object", "body"))
    )
    assert cover.layers is not None
    depth = top + blanket - bed.points.position[:, 2]
    covered = bed.points.position[:, 1] > -0.6 + blanket  # away from the blanket's own edge
    expected = np.where(depth < blanket, cover.youngs_modulus, foam.youngs_modulus)[covered]
    assert bed.points.youngs_modulus[covered] == pytest.approx(expected)
    assert bed.points.layers is not None
    along = np.where(depth < blanket, cover.layers.youngs_modulus, foam.youngs_modulus)[covered]
    assert bed.points.layers.youngs_modulus[covered] == pytest.approx(along)
    assert np.abs(bed.points.layers.normal[covered & (depth < blanket), 2]) == pytest.approx(1.0, abs=1e-6)
    lowest = float(np.diff(bed.grid.z)[0])  # the deepest points lie in the lower half of the lowest cells
    assert thick + blanket - 0.5 * lowest < depth.max() < thick + blanket

    column = tree["certificate"]["column"]
    assert [(one["part"], one["material"]) for one in column] == [("blanket", cover.id), ("mattress", foam.id)]
    assert [one["from_m"] for one in column] == pytest.approx([0.0, blanket], abs=2e-3)  # 400 steps of the column
    assert column[-1]["to_m"] == pytest.approx(thick + blanket, abs=2e-3)

    # of the polyhedron that was written, in single precision
    volume = signed_volume(ball["body"].vertices, ball["body"].faces)
    assert tree["mass"] == pytest.approx(resin.density * volume, rel=1e-5)
    assert placed.carried == pytest.approx(placed.weight, rel=0.04)  # the sides of the dent push inwards too
    below = placed.particles.bodies[0].surface.vertices
    friction = pair_friction(placed, 0, 1, below[:, 2] < below[:, 2].min() + 0.01)
    assert friction == pytest.approx(mean_friction(resin, cover))

    crop = np.ptp(bed.surface.bounds, axis=0)
    layers = [
        Layer(blanket, cover.youngs_modulus, cover.poisson_ratio,
              (cover.layers.youngs_modulus, cover.layers.poisson_ratio, cover.layers.shear_modulus)),
        Layer(thick, foam.youngs_modulus, foam.poisson_ratio),
    ]  # fmt: skip
    reference = dent(
        layers, float(np.sqrt(crop[0] * crop[1] / np.pi)), radius, placed.weight, guess=0.03, cell=0.008, held=True
    )
    found = top + blanket - tree["object_aabb"][0][2]
    assert found == pytest.approx(reference, rel=tolerance)
    assert tree["certificate"]["proof"]["gap_m"]["value"] < 1e-3
    if solver == "tl":
        assert abs(reference - found) <= tree["certificate"]["depth_error_m"]
    else:
        assert tree["certificate"]["method"] == "mls"


@pytest.mark.slow
@pytest.mark.long
def test_a_heavy_pillow_and_a_mattress_give_each_by_its_own_stiffness(place: Place) -> None:
    """Soft on soft: the pillow is pressed together as a column under its own weight is, by p h / (2 E_t), and sinks as
    far as a mattress does under a pressure that is as even as that of something softer."""
    top, thick, size = 0.5, 0.2, (0.6, 0.4, 0.12)
    pillow = {"body": make.block((-0.3, 0.3), (-0.2, 0.2), (0.0, size[2]))}
    prompt = "put the pillow at the center of the mattress of the bed"
    placed = place(make.bare_bed(top, thick), "bed", pillow, "pillow", prompt, "--mass", "6")
    tree, item = placed.tree, placed.body(0)
    assert (tree["verdict"], tree["part"]) == ("at_rest", "mattress")
    assert tree["mass"] == pytest.approx(6.0)
    assert float((item.points.volume * item.points.density).sum()) == pytest.approx(6.0, rel=1e-9)
    assert placed.carried == pytest.approx(placed.weight, rel=2.0 * RESIDUAL)
    filling, foam = placed.material("object", "body"), placed.material("bed", "mattress")
    assert item.points.youngs_modulus == pytest.approx(filling.youngs_modulus)
    assert placed.body(1).points.youngs_modulus == pytest.approx(foam.youngs_modulus)
    lowest = item.surface.vertices[:, 2] < item.surface.vertices[:, 2].min() + 1e-3
    assert pair_friction(placed, 0, 1, lowest) == pytest.approx(mean_friction(filling, foam))

    pressure = placed.weight / (size[0] * size[1])
    bottom, upper = ends_of(placed, share=0.5)
    # nu across is 0.05: sides that may not bulge make 2 nu_tp nu_pt < 2 % of difference
    assert size[2] - (upper - bottom) == pytest.approx(pressure * size[2] / (2.0 * filling.youngs_modulus), rel=0.05)
    sink, error = top - ends_of(placed, share=1.0)[0], tree["certificate"]["depth_error_m"]
    reference = rectangle_sink(placed.weight, size[:2], thick, foam, stiff=False)
    # 3 %: strains of 1 % are taken as small, the rectangle as a disc, and the pressure is not quite even
    assert 0.97 * reference - error <= sink <= 1.03 * reference + PENETRATION


@pytest.mark.long
@pytest.mark.slow
def test_a_folded_towel_on_a_table_is_pressed_together_by_its_own_weight(place: Place) -> None:
    """Soft on rigid: a stack of height h is shorter by rho g h^2 / (2 E_t), and its underside lies flat on a table."""
    top, height, side = 0.75, 0.1, (0.4, 0.3)
    towel = {"body": make.block((-0.2, 0.2), (-0.15, 0.15), (0.0, height))}
    prompt = "put the folded towel at the center of the table"
    placed = place(make.table(top), "table", towel, "folded_towel", prompt)
    tree, cloth = placed.tree, placed.material("object", "body")
    assert (tree["verdict"], tree["scale"]) == ("at_rest", 1.0)
    assert placed.carried == pytest.approx(placed.weight, rel=RESIDUAL)
    assert placed.body(0).points.youngs_modulus == pytest.approx(cloth.youngs_modulus)
    points = placed.body(0).points
    assert float((points.volume * points.density).sum()) == pytest.approx(tree["mass"], rel=1e-9)
    assert tree["contacts"][0]["area_m2"] > 0.95 * side[0] * side[1]
    assert tree["object_aabb"][0][2] == pytest.approx(top, abs=PENETRATION)
    table = next(i for i, one in enumerate(placed.particles.bodies) if one.name.startswith("table"))
    under = placed.body(0).surface.vertices
    friction = pair_friction(placed, 0, table, under[:, 2] < under[:, 2].min() + 1e-3)
    assert friction == pytest.approx(mean_friction(cloth, placed.material("table", "top")))

    bottom, upper = ends_of(placed, share=0.5)
    density = tree["mass"] / (height * side[0] * side[1])
    # nu across is 0.05: sides that may not bulge make 2 nu_tp nu_pt < 2 % of difference
    assert height - (upper - bottom) == pytest.approx(
        density * GRAVITY * height**2 / (2.0 * cloth.youngs_modulus), rel=0.03
    )


@pytest.mark.slow
@pytest.mark.long
def test_a_stool_with_a_cushion_stands_on_its_legs_in_a_rug(place: Place) -> None:
    """Mixed: the legs move as one, the cushion on them keeps its stiffness and friction, and each leg sinks as far as a
    stiff one does into a rug, but for what the grid takes: a leg of seven cells presses like one up to a cell wider.

    `depth_error_m`, an estimate, says how much that is to within a tenth of the depth. So a depth that is less than
    28 % too small or 18 % too large passes.
    """
    thick, leg, away = 0.02, 0.05, 0.15
    legs = [(x - leg / 2, y - leg / 2) for x in (-away, away) for y in (-away, away)]
    stool = {
        "cushion": make.block((-0.2, 0.2), (-0.2, 0.2), (0.38, 0.45)),
        "frame": make.block((-0.2, 0.2), (-0.2, 0.2), (0.35, 0.38)),
        "leg": make.joined([make.block((x, x + leg), (y, y + leg), (0.0, 0.35)) for x, y in legs]),
    }
    placed = place(make.rug(thick), "room", stool, "stool", "put the stool at the center of the rug")
    tree, item, rug = placed.tree, placed.body(0), placed.body(1)
    assert tree["verdict"] == "at_rest"
    assert placed.carried == pytest.approx(placed.weight, rel=2.0 * RESIDUAL)
    foam, oak, wool = (
        placed.material(*part) for part in (("object", "seat cushion"), ("object", "leg"), ("rug", "body"))
    )

    column = tree["certificate"]["column"]
    assert [one["material"] for one in column] == [wool.id]
    assert column[0]["to_m"] == pytest.approx(thick, abs=1e-3)
    base = float(item.surface.vertices[:, 2].min())
    height = item.points.position[:, 2] - base
    soft = height > 0.38
    assert item.points.youngs_modulus[soft] == pytest.approx(foam.youngs_modulus)
    assert item.points.youngs_modulus[~soft] == pytest.approx(RIGID_CONTRAST * foam.youngs_modulus)
    assert item.points.density[soft].mean() / item.points.density[height < 0.34].mean() == pytest.approx(
        foam.density / oak.density
    )
    assert float((item.points.volume * item.points.density).sum()) == pytest.approx(tree["mass"], rel=1e-9)
    core = item.grid.z[np.flatnonzero((item.grid.node_state == NodeState.CORE).any(axis=(0, 1)))] - base
    assert len(core)
    assert core.max() < 0.38 + 1e-6
    vertices = item.surface.vertices[:, 2] - base
    assert pair_friction(placed, 0, 1, vertices < 1e-3) == pytest.approx(mean_friction(oak, wool))
    assert pair_friction(placed, 0, 1, vertices > 0.45 - 1e-3) == pytest.approx(mean_friction(foam, wool))
    assert float(rug.points.youngs_modulus.max()) == wool.youngs_modulus

    force = placed.weight / len(legs)
    sink = thick - tree["object_aabb"][0][2]
    reference, error = rectangle_sink(force, (leg, leg), thick, wool, stiff=True), tree["certificate"]["depth_error_m"]
    assert 0.9 * reference - error <= sink <= 1.02 * reference + PENETRATION


def rectangle_sink(force: float, sides: tuple[float, float], thick: float, layer: Material, *, stiff: bool) -> float:
    """Mean depth [m] to which a force presses a rectangle of these sides [m] into a wide layer on rigid ground: that of
    the disc of equal area, less by as much as in a field that knows perimeters.

    The finite elements of 1/40 of the radius let a disc sink 0.2 % less than such of half that size if it presses
    evenly, 0.5 % if it is stiff: they are off by up to about 1 %. The factor for the shape is 0.96 to 1.
    """
    area, perimeter = float(np.prod(sides)), 2.0 * sum(sides)
    disc = (area / np.pi) ** 0.5
    own = Layer(thick, layer.youngs_modulus, layer.poisson_ratio)
    sink = disc_sink([own], disc + 8.0 * thick, disc, force, across=40, held=True, stiff=stiff)
    return sink * stiffness(area, 2.0 * np.pi * disc, thick, layer) / stiffness(area, perimeter, thick, layer)


def stiffness(area: float, perimeter: float, thick: float, layer: Material) -> float:
    """Force over depth [N/m] of something of an area [m^2] and a perimeter [m] on a layer, in an assumed field.

    It falls off linearly with depth, and as exp(-r / L) with the distance from the edge, L being the best. Twice its
    energy over the square of the depth is M / h times the integral of the square of that fall, and G h / 3 times that
    of its slope squared [V66]. [V66] Vlasov, Leontiev: Beams, plates and shells on elastic foundations. 1966.
    """
    nu, e = layer.poisson_ratio, layer.youngs_modulus
    confined, shear = e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)), e / (2.0 * (1.0 + nu))
    reach = np.geomspace(0.01 * thick, 10.0 * thick, 400)
    fall = 0.5 * perimeter * reach + 0.5 * np.pi * reach**2  # integral of exp(-2 r / L) around it: edges and corners
    return float((confined / thick * (area + fall) + shear * thick / 3.0 * fall / reach**2).min())

"""The exchange between a rigid body and the grid: the kernel against its twin, and the twin against the law."""

from dataclasses import dataclass

import numpy as np
import pytest

from solver.kernels.mls_coupling import (
    COUPLED,
    IMPULSE,
    LOAD,
    NORMAL_IMPULSE,
    NORMAL_MATRIX,
    SETTLED,
    SWEEPS,
    TOUCHING,
    couple,
)
from solver.reference.coupling import ContactNode, impulse, touches, velocity_after
from solver.runtime import start

SHAPE = (6, 5, 7)
SPAN = np.array([[1, 0, 2], [4, 4, 5]], dtype=np.int32)  # first node and count: not the whole grid
H = 0.01
LEAST = 1e-6  # [kg]
FRICTION = {"sticking": (1e6, 1e6), "sliding": (0.02, 0.01), "mixed": (0.5, 0.3), "frictionless": (0.0, 0.0)}


@pytest.fixture(autouse=True)
def kernels():
    """The exchange is serial."""
    start(1)


@dataclass
class Scene:
    """Random nodes around a rigid body, and the body."""

    grid: np.ndarray
    material: np.ndarray
    owner: np.ndarray
    phi: np.ndarray
    normal: np.ndarray
    friction: np.ndarray
    mass: np.ndarray
    q: np.ndarray
    frame: np.ndarray

    @classmethod
    def random(cls, seed: int, friction: tuple[float, float], weight: float = 1.0) -> "Scene":
        """Every fifth node empty; nodes from two cells inside to two outside; a body of `weight` times the nodes."""
        random, count, near = np.random.default_rng(seed), int(np.prod(SHAPE)), int(np.prod(SPAN[1]))
        grid = np.column_stack([random.normal(size=(count, 3)), 1e-3 * random.uniform(0.1, 1.0, count)])
        grid[::5, 3] = 0.1 * LEAST
        material = np.column_stack([H * random.uniform(-1.5, 1.5, (count, 3)), np.ones(count)]) * grid[:, 3:]
        material[1::7] = 0.0  # mass that came from another body
        normal = random.normal(size=(near, 3))
        half = random.normal(size=(3, 3))
        mass = np.zeros((6, 6))
        mass[:3, :3] = 0.03 * weight * np.eye(3)
        mass[3:, 3:] = 0.03 * weight * H**2 * (half @ half.T + np.eye(3))
        frame = np.zeros((7, 3))
        frame[0], frame[1] = [0.3, -0.2, 0.1], [0.33, -0.18, 0.13]
        return cls(
            grid, material, random.integers(0, 2, count).astype(np.int32), H * random.uniform(-2.0, 2.0, near),
            normal / np.linalg.norm(normal, axis=1, keepdims=True), np.array([friction, (0.3, 0.2)]), mass,
            np.concatenate([random.normal(size=3), random.normal(size=3) / H]), frame,
        )  # fmt: skip

    def couple(self, *, free: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the kernel makes of the nodes' velocities and of q, and what it tells of the two owners."""
        velocity, q, out, change = self.coupled(free=free)
        assert change <= SETTLED
        return velocity, q, out

    def coupled(self, *, free: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The same, settled or not, and the last change of q."""
        grid, q, out, near = self.grid.copy(), self.q.copy(), np.zeros((2, COUPLED)), len(self.phi)
        scratch = np.full((6, 7), np.nan), np.zeros((near, 2), np.int32), np.full((near, TOUCHING), np.nan)
        change = np.full(1, np.nan)
        couple(int(free), H, H, LEAST, *SHAPE[1:], self.frame, SPAN, self.phi, self.normal, self.owner, self.material,
               self.friction, self.mass, grid, q, *scratch, change, out)  # fmt: skip
        return grid[:, :3], q, out, float(change[0])

    def touching(self) -> dict[int, ContactNode]:
        """The nodes that touch by the twin's rule."""
        found = {}
        for s, offset in enumerate(np.ndindex(*SPAN[1])):
            index = SPAN[0] + offset
            node = int(np.ravel_multi_index(tuple(index), SHAPE))
            m, there, n = self.grid[node, 3], self.material[node, 3], self.normal[s]
            if self.phi[s] > H or m <= LEAST or there == 0.0:
                continue
            if touches(self.phi[s], n, self.material[node, :3] / there, H):
                arm = self.frame[0] + H * index - self.frame[1]
                found[node] = ContactNode(m, self.grid[node, :3], n, arm, *self.friction[self.owner[node]])
        return found


def agree(scene: Scene, *, free: bool) -> tuple[list[np.ndarray], np.ndarray]:
    """Assert that kernel and twin agree; returns the impulses on the touching nodes and the body's velocity."""
    velocity, q, out = scene.couple(free=free)
    nodes = scene.touching()
    after = velocity_after(list(nodes.values()), scene.q, scene.mass) if free else scene.q
    given = {node: impulse(one, after) for node, one in nodes.items()}
    expected, told = scene.grid[:, :3].copy(), np.zeros_like(out)
    for node, J in given.items():
        one, row = nodes[node], told[scene.owner[node]]
        expected[node] += J / one.mass
        load = J @ one.normal
        Gn = one.motion.T @ one.normal
        row[LOAD] += load
        row[IMPULSE : IMPULSE + 3] += J
        row[NORMAL_IMPULSE : NORMAL_IMPULSE + 3] += load * one.normal
        row[NORMAL_MATRIX : NORMAL_MATRIX + 36] += load * np.outer(Gn, Gn).ravel()
    # the kernel's sweeps stop at a relative change of 1e-12, of velocities and spins times arm of about 1
    assert velocity == pytest.approx(expected, abs=1e-10)
    # the body takes the opposite of all impulses, whose rounding counts for so much more as it is lighter
    rounding = 1e-15 * sum(one.mass for one in nodes.values()) / scene.mass[0, 0]
    assert q * [1, 1, 1, H, H, H] == pytest.approx(after * [1, 1, 1, H, H, H], abs=1e-10 + rounding)
    assert out == pytest.approx(told, rel=1e-9, abs=1e-12)
    # the law itself: the body takes exactly the opposite
    taken = sum((one.motion.T @ given[node] for node, one in nodes.items()), np.zeros(6))
    if free:
        # impulses as well known as velocities, and the rounding of q
        known = 1e-10 * sum(one.mass for one in nodes.values()) + 1e-15 * float(np.abs(scene.mass @ scene.q).max())
        assert scene.mass @ (q - scene.q) == pytest.approx(-taken, abs=known)
    return list(given.values()), q


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", FRICTION)
def test_the_exchange_agrees_with_its_twin(kind: str, seed: int, free: bool) -> None:
    """Velocities of nodes and body, and what is told of the owners, for random nodes and every state of friction."""
    given, q = agree(Scene.random(seed, FRICTION[kind]), free=free)
    assert sum(bool(J.any()) for J in given) > 5
    assert (q != Scene.random(seed, FRICTION[kind]).q).all() == free


@pytest.mark.parametrize("weight", [1e-6, 1e6])
def test_the_twins_agree_for_very_light_and_very_heavy_bodies(weight: float) -> None:
    """A body of a millionth of the nodes' mass follows them, one of a million times does not notice."""
    agree(Scene.random(7, FRICTION["sticking"], weight), free=True)


def test_what_sticks_moves_with_the_body_and_what_slides_takes_friction_at_its_limit() -> None:
    """After the exchange a sticking node has no velocity relative to the body, a sliding one dynamic friction's
    impulse, against its slip."""
    for kind in ("sticking", "sliding"):
        scene = Scene.random(3, FRICTION[kind])
        scene.friction[:] = FRICTION[kind]
        velocity, q, _ = scene.couple(free=True)
        loaded, known = 0, settled_slip(scene, q)
        for node, one in scene.touching().items():
            J = one.mass * (velocity[node] - one.velocity)
            if not J.any():
                continue
            loaded += 1
            slip = velocity[node] - one.motion @ q
            assert slip @ one.normal == pytest.approx(0.0, abs=known)
            along = J - (J @ one.normal) * one.normal
            if kind == "sticking":
                assert slip == pytest.approx(np.zeros(3), abs=known)
            else:
                assert np.linalg.norm(along) == pytest.approx(one.dynamic_friction * (J @ one.normal), rel=1e-6)
                assert along @ slip < 0.0
        assert loaded > 5


def settled_slip(scene: Scene, q: np.ndarray) -> float:
    """Largest slip [m/s] that sweeps leave which have settled.

    Sweeps that contract by c per sweep end within c / (1 - c) of the last change of q', and c <= SETTLED**(1 / SWEEPS),
    or they would not have settled. The body takes the opposite of the nodes' impulses, so an error e of q' is one of
    M^-1 (M + sum m G^T G) e of its velocity; at a node, one of G times that. Rounding of q' counts alike.
    """
    nodes = list(scene.touching().values())
    contraction = SETTLED ** (1.0 / SWEEPS)
    error = (contraction / (1.0 - contraction) * SETTLED + 1e-15) * max(np.linalg.norm(q), np.linalg.norm(scene.q))
    system = scene.mass + np.sum([one.mass * one.motion.T @ one.motion for one in nodes], axis=0)
    back = np.linalg.solve(scene.mass, system)
    return max(float(np.linalg.norm(one.motion @ back, 2)) for one in nodes) * float(error)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("weight", [1.0, 1e-4])
def test_what_light_bodies_take_has_settled(seed: int, weight: float) -> None:
    """Also where friction's shares oscillate, as they do for bodies far lighter than the material, sweeps settle, and
    nodes move as by the law."""
    scene = Scene.random(seed, FRICTION["mixed"], weight)
    velocity, _, _ = scene.couple(free=True)
    nodes = scene.touching()
    after = velocity_after(list(nodes.values()), scene.q, scene.mass)
    for node, one in nodes.items():
        assert velocity[node] == pytest.approx(one.velocity + impulse(one, after) / one.mass, abs=1e-10)


def test_an_exchange_that_does_not_settle_says_so() -> None:
    """Where nodes come into touch and leave it in turn no velocity agrees with its own impulses; the last change of the
    sweeps is told, and the body still takes exactly the opposite of what the nodes take."""
    scene = Scene.random(3, FRICTION["sticking"], 0.01)
    velocity, q, _, change = scene.coupled(free=True)
    assert change > 0.01
    given = [(one, one.mass * (velocity[node] - one.velocity)) for node, one in scene.touching().items()]
    taken = sum((one.motion.T @ J for one, J in given), np.zeros(6))
    assert scene.mass @ (q - scene.q) == pytest.approx(-taken, abs=1e-12 * float(np.abs(taken).max()))


def test_separating_nodes_take_nothing() -> None:
    """Nodes that touch but move off leave the body alone, friction or not."""
    scene = Scene.random(4, FRICTION["sticking"])
    scene.q[:] = 0.0
    for node, one in scene.touching().items():
        scene.grid[node, :3] = 0.5 * one.normal + np.cross(one.normal, [0.1, 0.2, 0.3])
    before = scene.q.copy(), scene.grid[:, :3].copy()
    given, q = agree(scene, free=True)
    assert len(given) > 5
    assert not np.array(given).any()
    assert q == pytest.approx(before[0], abs=0.0)
    assert scene.couple(free=True)[0] == pytest.approx(before[1], abs=0.0)


@pytest.mark.parametrize("kind", ["far", "empty", "other"])
def test_without_contact_nothing_changes(kind: str) -> None:
    """Nodes out of reach, without mass, or with another body's mass only, leave all as it was to the byte."""
    scene = Scene.random(5, FRICTION["mixed"])
    if kind == "far":
        scene.phi[:] = 1.01 * H
    elif kind == "empty":
        scene.grid[:, 3] = 0.0
    else:
        scene.material[:] = 0.0
    velocity, q, out = scene.couple(free=True)
    assert np.array_equal(velocity, scene.grid[:, :3])
    assert np.array_equal(q, scene.q)
    assert not out.any()
    assert not scene.touching()

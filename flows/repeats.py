"""Repeats drops on other cells where the first drop did not go as predicted.

Each attempt calls the stages with its own configuration, and has its own record.
"""

from contextlib import suppress

from dcap.scene.errors import GeometryError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.earlier import FreedThings
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.measures import Drift
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.particles import Particles
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import EndPose, Settled
from tasks.artifact import Ref, Store
from tasks.drop.stage import DropConfig, drop_task, unforeseen_end
from tasks.particles.config import ParticlesConfig
from tasks.particles.stage import particles_task

COARSER = 1.4
"""Growth of the cells after a drop that broke down [-]; halves the number of cells along two axes together."""
FINER_GOES = 2
"""Most repeats of a drop that ended on coarse cells."""


def settle(
    scene: Ref[SegmentedScene],
    item: Ref[SegmentedObject],
    intent: Ref[Intent],
    anchor: Ref[Anchor],
    materials: Ref[PartMaterials],
    seed: int,
    *,
    freed: Ref[FreedThings] | None,
    cells: ParticlesConfig,
    drop: DropConfig,
) -> tuple[Ref[Particles], Ref[Settled]]:
    """Fill the bodies and drop the object. Repeat on coarser cells if the drop broke down, and with fine cells at the
    end position if the object ended outside the fine region: up to FINER_GOES times, since it may roll on."""
    particles = particles_task(scene, item, intent, anchor, materials, config=cells, freed=freed)
    settled = drop_task(particles, anchor, intent, seed, config=drop)
    if broke_down(settled):
        cells = coarsened(cells)
        with suppress(GeometryError):  # larger cells may be too coarse; the first drop says why it broke
            again = particles_task(scene, item, intent, anchor, materials, config=cells, freed=freed)
            outcome = drop_task(again, anchor, intent, seed, config=drop)
            if not outcome.infeasible:
                particles, settled = again, outcome
    for _ in range(FINER_GOES):
        elsewhere = ended_elsewhere(settled)
        if elsewhere is None:
            break
        try:
            again = particles_task(scene, item, intent, anchor, materials, config=cells, ended=elsewhere, freed=freed)
            outcome = drop_task(again, anchor, intent, seed, config=drop)
        except GeometryError:  # fine cells at two places may not fit into the budget; its note says where it is coarse
            break
        if outcome.infeasible and not settled.infeasible:
            break
        particles, settled = again, outcome
    return particles, settled


def broke_down(settled: Ref[Settled]) -> bool:
    """Return whether a step broke: slivers of material in cut cells can fold, depending on where the grid cuts."""
    value = Store.default().load(settled) if settled.infeasible else None
    return isinstance(value, Infeasible) and value.reason is Reason.UNSTABLE_STEP


def ended_elsewhere(settled: Ref[Settled]) -> EndPose | None:
    """Return the end position of the drop if fine cells are needed at another place than predicted."""
    return None if settled.pending else unforeseen_end(Store.default().load(settled))


def drift_broke_down(drift: Ref[Drift], settled: Ref[Settled]) -> bool:
    """Return whether a step broke while the simulation of a pose was continued. It is then repeated on other cells,
    like a drop that breaks. A dent always has the cells of its drop, which have survived a whole drop."""
    if drift.pending or settled.pending:
        return False
    found, state = Store.default().load(drift), Store.default().load(settled)
    return isinstance(found, Drift) and found.broken and isinstance(state, Settled) and not state.nodes


def coarsened(cells: ParticlesConfig) -> ParticlesConfig:
    """Return the configuration with larger cells."""
    return cells.model_copy(update={"coarser": COARSER * cells.coarser})

"""Drop to rest: steps until the bodies are quiet, then a kick to test whether the rest is stable, then the
certificate."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from solver.certificate import KickCheck, NotDone, SignalRows, StabilityGrade, Verdict
from solver.config import SolverConfig
from solver.contact.active import Contacts, contact_table, friction_margin, point_forces
from solver.contact.bonds import bond_table
from solver.contact.friction import RollingLaw, law_compliant, law_stiff
from solver.errors import ModelError
from solver.frames import FrameRecorder
from solver.mls import drop as mls
from solver.model.bodies import Model
from solver.model.state import State
from solver.onward import refuse_overlap
from solver.rest import Progress
from solver.result import FinalState, RestBody, SettledModel, build_result, carried, has_left
from solver.runtime import start
from solver.tl.measure import depth_error, material_states, rolling_table
from solver.tl.simulation import Simulation, StepControl
from solver.tl.stability import grade, kick
from solver.tl.step import StepReport

# of the tolerance, for a creeping body: so soft that the residual within the tolerance moves it visibly
CREEPING_TOLERANCE = 0.1
NOTHING_TO_PUSH = "there is no verified rest state of a free body"


def settle(model: Model, config: SolverConfig, progress: Progress | None = None) -> SettledModel:
    """Let the free bodies of `model` come to rest.

    Returns the rest state with its certificate, or the last state with a verdict that gives the reason. Raises
    ModelError for input that cannot be simulated, UnstableStep if a step breaks and ArchError if the kernels cannot
    run. The same model and config give the same bytes for any thread count.
    """
    if config.stability and config.method == "mls":
        raise ModelError("stability: mls verifies no rest state that could be pushed; use method tl")
    start(config.threads, config.arch)
    with threadpool_limits(1):  # the rounding of dense factorisations depends on the number of threads
        if config.method == "mls":
            return mls.ExplicitDrop(model, config).run(progress)
        drop = ImplicitDrop(model, config)
        end = drop.approach(drop.checked_start(), StepControl(config.step_seconds), progress)
        return drop.judged(end, progress)


@dataclass(frozen=True, eq=False, slots=True)
class Approach:
    """End of the approach to rest, successful or not."""

    verdict: Verdict
    state: State
    report: StepReport
    control: StepControl
    """Control for a step that continues from there: a creeping body remains one, so its tolerance is passed on."""


class ImplicitDrop(Simulation):
    """One simulation from start to verdict, with its history."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        super().__init__(model, config)
        self.monitor = self.rest_monitor()
        self.recorder = FrameRecorder(model.bodies, self.length)
        self.warnings: list[str] = []

    def checked_start(self) -> State:
        """The start state; raises ModelError if bodies begin inside each other."""
        state = self.start_state()
        refuse_overlap(self, state)
        return state

    def approach(
        self, state: State, control: StepControl, progress: Progress | None, rolling: RollingLaw = law_stiff
    ) -> Approach:
        """Take steps from a state until the bodies are quiet or have left, or the steps are used up."""
        self.recorder.note(state.time, partial(self._bodies, state))
        while True:
            step = self.step(state, control, rolling=rolling)
            state, control = step.state, step.control
            self.monitor.record(step.signals, progress)
            self.recorder.note(state.time, partial(self._bodies, state))
            if self.monitor.creeping():
                control = replace(control, tolerance_factor=CREEPING_TOLERANCE)
            if verdict := self._verdict(state, step.report.contacts):
                return Approach(verdict, state, step.report, control)
            self.stiffen(state, step.report.contacts, step.signals)

    def judged(self, end: Approach, progress: Progress | None) -> SettledModel:
        """The result of an approach; a rest state is first kicked, and pushed if requested."""
        kicked: KickCheck | NotDone = NotDone()
        rows = self.monitor.rows()
        if end.verdict is Verdict.AT_REST and self.free:
            after, control, kicked = kick(self, self.monitor, end.state, end.control, progress)
            if not kicked.stable:
                end, rows, kicked = self._after_failed_kick(after, control, kicked, progress)
        stability = self._stability(end, progress)
        return self._result(end, rows, kicked, stability)

    def _stability(self, end: Approach, progress: Progress | None) -> StabilityGrade | NotDone | None:
        """Stability grade for the certificate; None if it was not requested."""
        if not self.config.stability:
            return None
        if end.verdict is not Verdict.AT_REST or not self.free:
            return NotDone(reason=NOTHING_TO_PUSH)
        graded, warnings = grade(self, end.state, end.control.tolerance_factor, progress)
        self.warnings += warnings
        return graded

    def _verdict(self, state: State, contacts: Contacts) -> Verdict | None:
        """Verdict that ends an approach; None if it continues."""
        if self._left(state, contacts):
            return Verdict.LEFT_TARGET
        if self.monitor.quiet():
            return Verdict.AT_REST
        return Verdict.NO_EQUILIBRIUM if len(self.monitor.signals) >= self.config.step_limit else None

    def _left(self, state: State, contacts: Contacts) -> bool:
        """Return whether a free body has left everything that could carry it."""
        pairs = set(zip(contacts.a.tolist(), contacts.b.tolist(), strict=True))
        loose = set(self.free) - carried(self.model, pairs)
        return any(has_left(self.model, self.query.surface(state, i), self.center(state, i)) for i in loose)

    def _after_failed_kick(
        self, state: State, control: StepControl, first: KickCheck, progress: Progress | None
    ) -> tuple[Approach, SignalRows, KickCheck]:
        """After a failed kick, follow the resulting motion to its end; a second rest is verified in turn. Rolling
        resistance stays compliant: a stiff one would stop a body that has begun to fall over.
        """
        begin = len(self.monitor.signals)
        control = replace(control, dt=self.config.step_seconds)
        end = self.approach(state, control, progress, law_compliant)
        rows = self.monitor.rows(begin)
        if end.verdict is not Verdict.AT_REST:
            return end, rows, first
        _, _, kicked = kick(self, self.monitor, end.state, end.control, progress)
        if not kicked.stable:
            return replace(end, verdict=Verdict.NO_EQUILIBRIUM), rows, kicked
        self.warnings.append("the first rest state was unstable under the kick; this is the state reached after it")
        return end, rows, kicked

    def _result(
        self,
        end: Approach,
        rows: SignalRows,
        kicked: KickCheck | NotDone,
        stability: StabilityGrade | NotDone | None,
    ) -> SettledModel:
        contacts, final = end.report.contacts, self._final(end.state, end.report)
        self.recorder.note(end.state.time, lambda: final.bodies, last=True)
        frames = self.recorder.frames()
        result = build_result(end.verdict, final, self.monitor, rows, kicked, self.config, self.warnings, frames)
        certificate = replace(
            result.certificate,
            newton_residual=end.report.residual,
            unlocated_points=contacts.unlocated,
            material_damping_s=self.stepper.elastic.damping,
            rolling_resistance=rolling_table(self.model, contacts),
            depth_error_m=self._depth_error(end),
            bonds=bond_table(
                self.model,
                (
                    (one, one.force(self.model, end.state), one.stretch(self.model, end.state))
                    for one in self.query.bonds
                ),
            )
            or None,
            stability=stability,
        )
        material = {self.model.bodies[i].name: one for i, one in material_states(self.soft, end.state).items()}
        told = (*result.warnings, *unlocated(contacts))
        nodes = {
            self.model.bodies[one.index].name: (end.state.x - self.soft.rest)[one.nodes].astype(np.float32)
            for one in self.soft.bodies
        }
        return replace(result, certificate=certificate, warnings=told, material=material, nodes=nodes)

    def _depth_error(self, end: Approach) -> float | None:
        """The certificate's estimate; None if nothing soft carries anything at rest."""
        if end.verdict is not Verdict.AT_REST or not self.free or not self.soft.bodies:
            return None
        return depth_error(self.soft, end.state, self.weight)

    def _final(self, state: State, report: StepReport) -> FinalState:
        """Summary of the last state for the result."""
        contacts = report.contacts
        return FinalState(
            seconds=state.time,
            bodies=self._bodies(state),
            contacts=contact_table(self.model, contacts.active, lambda index: self.query.surface(state, index)),
            contact_points={self.model.bodies[i].name: points_of(contacts, i) for i in self.free},
            forces=point_forces(contacts),
            friction_margin=friction_margin(contacts.active),
            free_weight=self.weight,
            inverted=report.inverted,
            particles=int(self.soft.real.sum()),
        )

    def _bodies(self, state: State) -> tuple[RestBody, ...]:
        """The state of every body."""
        out = []
        for i, body in enumerate(self.model.bodies):
            surface, (rotation, translation) = self.query.surface(state, i), self.motion(state, i)
            out.append(RestBody(body.name, surface, rotation, translation, self.speed(state, i)))
        return tuple(out)


def points_of(contacts: Contacts, index: int) -> NDArray[np.float64]:
    """Positions of the contact points of a body [m], shape (k, 3)."""
    found = [t.position for t in contacts.active if index in (t.pair.a, t.pair.b)]
    return np.concatenate(found) if found else np.zeros((0, 3))


def unlocated(contacts: Contacts) -> tuple[str, ...]:
    """The warning about points that were not located in a soft body, if any."""
    count = contacts.unlocated
    text = (
        f"{count} points lie in a soft body whose deformation could not be inverted there; they do not count as contact"
    )
    return (text,) if count else ()

"""Drop to rest: steps until quiet, then a kick to see whether the rest is stable, then the certificate."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from solver.certificate import Signals, certificate, contact_table
from solver.config import SolverConfig
from solver.contact.active import Contacts
from solver.contact.bonds import bond_table
from solver.contact.rolling import RollingLaw, law_compliant, law_stiff
from solver.errors import ModelError
from solver.mls import drop as mls
from solver.model.bodies import Model
from solver.model.state import State
from solver.result import AT_REST, LEFT_TARGET, NO_EQUILIBRIUM, RestBody, Result, beside, carried
from solver.runtime import start
from solver.tl.disturbance import kick
from solver.tl.simulation import Progress, Simulation
from solver.tl.stability import grade
from solver.tl.step import StepReport

# of the tolerance, for a body that is in balance, slower than NEARLY times the threshold, and not slowing
CREEPING_TOLERANCE = 0.1
NEARLY, STALLED = 10.0, 0.9


def settle(model: Model, config: SolverConfig, progress: Progress | None = None) -> Result:
    """Let the free bodies of `model` come to rest.

    Returns the rest state with its certificate, or the last state with the verdict that says why it is none.
    Raises ModelError for
    input that cannot be simulated, UnstableStep when a step breaks and ArchError where the kernels cannot run. Same
    model and config: the same bytes for any thread count.
    """
    if config.stability and config.method == "mls":
        raise ModelError("stability: mls verifies no rest state that could be pushed; use method tl")
    start(config.threads, config.arch)
    with threadpool_limits(1):  # dense factorisations would round differently with the number of threads
        result = (mls.ExplicitDrop if config.method == "mls" else ImplicitDrop)(model, config).run(progress)
    return replace(result, certificate={"arch": config.arch} | result.certificate)


class ImplicitDrop(Simulation):
    """One simulation from start to verdict."""

    def run(self, progress: Progress | None) -> Result:
        """Approach, rest, kick, verdict."""
        state = self.start_state()
        self._refuse_overlap(state)
        verdict, state, report = self._approach(state, progress)
        kicked: dict[str, object] = {"done": False}
        rows = self.rows(self.history[-self.config.rest_steps :])
        if verdict == AT_REST and self.free:
            end, stable, kicked = kick(self, state, progress)
            if not stable:
                verdict, state, report, rows, kicked = self._after_failed_kick(end, kicked, progress)
        stability = self._stability(verdict, state, progress)
        result = self._result(verdict, state, report, rows, kicked)
        return replace(result, certificate=result.certificate | stability)

    def _stability(self, verdict: str, rest: State, progress: Progress | None) -> dict[str, object]:
        """What the certificate says about pushes, nothing where nobody asked."""
        if not self.config.stability:
            return {}
        if verdict != AT_REST or not self.free:
            return {"stability": {"done": False, "reason": "there is no verified rest state of a free body"}}
        return {"stability": grade(self, rest, progress)}

    def _refuse_overlap(self, state: State) -> None:
        for t in self.query.find(state, self.query.begin(state, self.config.step_seconds)).active:
            depth = float(-t.gap.min())
            if depth > self.config.start_overlap:
                a, b = self.model.bodies[t.pair.a].name, self.model.bodies[t.pair.b].name
                raise ModelError(
                    f"bodies {a!r} and {b!r} start {1e3 * depth:.1f} mm inside each other near "
                    f"{np.round(t.position[int(np.argmin(t.gap))], 3).tolist()} (bound start_overlap = "
                    f"{1e3 * self.config.start_overlap:.1f} mm); move one of them"
                )

    def _approach(
        self, state: State, progress: Progress | None, rolling: RollingLaw = law_stiff
    ) -> tuple[str, State, StepReport]:
        dt = self.config.step_seconds
        while True:
            state, report, dt = self.step(state, dt, rolling=rolling)
            signals = self.record(state, report, progress)
            if self._left(state, report.contacts):
                return LEFT_TARGET, state, report
            if self._quiet():
                return AT_REST, state, report
            if len(self.history) >= self.config.step_limit:
                return NO_EQUILIBRIUM, state, report
            self._adapt(state, report.contacts, signals)

    def _quiet(self) -> bool:
        """All signals below their thresholds over the whole window."""
        window = self.history[-self.config.rest_steps :]
        if len(window) < self.config.rest_steps:
            return False
        rows = self.rows(window)
        exceeded = {name for name, row in rows.items() if row["value"] > row["threshold"]}
        half = self.config.rest_steps // 2
        early, late = (max(s.speed for s in part) for part in (window[:half], window[half:]))
        balanced = not exceeded & {"force_residual", "torque_residual"}
        if exceeded and balanced and late > STALLED * early and late < NEARLY * rows["linear_speed"]["threshold"]:
            self.tolerance_factor = CREEPING_TOLERANCE  # so soft that what the tolerance leaves moves it visibly
        return not exceeded

    def _left(self, state: State, contacts: Contacts) -> bool:
        """A free body has left everything that could carry it."""
        pairs = set(zip(contacts.a.tolist(), contacts.b.tolist(), strict=True))
        loose = set(self.free) - carried(self.model, pairs)
        return any(beside(self.model, self.query.surface(state, i), self.center(state, i)) for i in loose)

    def _adapt(self, state: State, contacts: Contacts, signals: Signals) -> None:
        """Stiffen pairs that penetrate more than asked for; only near rest, where the load is the weight.

        Springs that are suddenly stiffer would throw a body up, so the next step only corrects positions.
        """
        if signals.speed > self.config.moving_speed * np.sqrt(self.gravity * self.length):
            return
        stiffened: list[tuple[int, NDArray[np.float64]]] = []
        for t in contacts.active:
            load = t.normal_force
            if load.sum() <= 0.0:
                continue
            depth = float(-(t.gap * load).sum() / load.sum())
            if depth > 1.25 * self.config.penetration_target:
                if not self.config.inertia:
                    normal = load @ t.normal
                    stiffened += [(i, normal / np.linalg.norm(normal)) for i in t.pair.key]
                factor = min(4.0, depth / self.config.penetration_target)
                state.memory = state.memory.stiffen(t.pair.key, factor)
        state.memory = replace(state.memory, stiffened=tuple(stiffened))

    def _after_failed_kick(
        self, end: State, first: dict[str, object], progress: Progress | None
    ) -> tuple[str, State, StepReport, dict[str, dict[str, float]], dict[str, object]]:
        """The rest was not stable: follow the motion that the kick started to its end; a second rest is
        verified in its turn. Rolling resistance keeps giving way: a stiff one would stop what has begun to fall over.
        """
        begin = len(self.history)
        verdict, state, report = self._approach(end, progress, law_compliant)
        rows = self.rows(self.history[begin:][-self.config.rest_steps :])
        if verdict != AT_REST:
            return verdict, state, report, rows, first
        _, stable, kicked = kick(self, state, progress)
        if stable:
            self.warnings.append("the first rest state was unstable under the kick; this is the one it fell into")
        return (AT_REST if stable else NO_EQUILIBRIUM), state, report, rows, kicked

    def _result(
        self,
        verdict: str,
        state: State,
        report: StepReport,
        rows: dict[str, dict[str, float]],
        kicked: dict[str, object],
    ) -> Result:
        bodies = []
        for i, body in enumerate(self.model.bodies):
            rotation, translation = self.motion(state, i)
            bodies.append(
                RestBody(body.name, self.query.surface(state, i), rotation, translation, self.speed(state, i))
            )
        if report.inverted:
            self.warnings.append(f"{report.inverted} particles are inverted in the last state")
        if report.contacts.unlocated:
            self.warnings.append(
                f"{report.contacts.unlocated} points lie in a soft body whose deformation could not be inverted there; "
                "they do not count as contact"
            )
        patch = {
            self.model.bodies[i].name: np.concatenate(
                [t.position for t in report.contacts.active if i in (t.pair.a, t.pair.b)] or [np.zeros((0, 3))]
            )
            for i in self.free
        }
        bonds: dict[str, object] = {}
        if self.query.bonds:
            bonds["bonds"] = bond_table(self.model, self.query.bonds, state)
        return Result(
            verdict,
            tuple(bodies),
            contact_table(self.model, report.contacts),
            patch,
            certificate(self.model, rows, kicked, report, self.stepper.damping, self.weight, self.length) | bonds,
            {k: np.array([getattr(s, k) for s in self.history]) for k in Signals.SERIES},
            len(self.history),
            state.time,
            int(self.soft.real.sum()),
            tuple(self.warnings),
        )

"""How good a judge is: pairs of placements whose better one is known, asked in both orders."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from dcap.evaluation.judging.judge import judge_name
from dcap.evaluation.judging.judging_folder import JUDGING, side_tree
from dcap.evaluation.judging.known_answers import known_answers
from dcap.evaluation.judging.known_room import COMPLIANCE, MASS, RADIUS
from dcap.evaluation.judging.validation import JudgeAccuracy, judge_accuracy
from dcap.evaluation.metrics.columns import columns
from dcap.geometry.raycast import Raycaster
from dcap.language.connect import connect
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.settings import runs_root
from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.mesh import Mesh
from dcap.scene.whole_files import write_whole
from flows.find_run import find_run
from flows.judge_run import asking
from flows.language_options import LanguageOptions
from flows.output import readable_json
from tasks.bodies.footprint import heights_over
from tasks.bodies.plan_contact import plan_contact

ROOMS = ("bedroom_01", "bedroom_02", "bedroom_03", "kids_01", "kids_02")
"""Embedded rooms with a bed and free floor beside it."""
VALIDATION = "validation.json"
LIFTED = 0.01
"""How far over the mattress the ball is before it is pressed onto it [m]; no result depends on it."""
WITHOUT_RUN = "judge"
"""Folder among the runs for a judge that is validated without one."""


def pressed_depth(ball: Mesh, bed: Mesh) -> float | None:
    """How deep the ball's weight presses it into the mattress [m]: quasi-static, by the contact solver that is the
    reference of every placement, on foam without end."""
    lift = np.eye(4)
    lift[2, 3] = LIFTED - float(columns(ball, Raycaster(bed)).gap.min())
    over = ball.transformed(lift)
    stacks = ([(2.0 * RADIUS, 0.0)], [(np.inf, COMPLIANCE)])
    found = plan_contact(heights_over(over, Raycaster(bed)), over.bounds[:, :2], MASS * GRAVITY, stacks)
    return found.patch.approach if found else None


@dataclass(frozen=True, slots=True)
class JudgeValidation:
    """How a judge did, and where that is written."""

    accuracy: JudgeAccuracy
    path: Path


def validate_judge(
    run: str | None,
    options: LanguageOptions,
    say: Callable[[str], None] = lambda text: None,
    rooms: Sequence[str] = ROOMS,
) -> JudgeValidation:
    """Ask a judge about the known answers of some rooms; validation.json goes into the run's `judging`, if one is
    named, else into `judge` beside the runs."""
    folder = find_run(run) / JUDGING if run else runs_root() / WITHOUT_RUN
    config = options.config()
    session = Session() if config.client is ClientName.OFFLINE else options.session(folder)
    with asking(session, say):
        client, judge = connect(config, session), judge_name(config)
        answers = list(known_answers(rooms[0], reference=pressed_depth))
        if not options.batch:  # whoever cannot be asked says so before all rooms are prepared
            judge_accuracy(client, answers[:1], judge)
        answers += [one for name in rooms[1:] for one in known_answers(name, reference=pressed_depth)]
        found = judge_accuracy(client, answers, judge)
    folder.mkdir(parents=True, exist_ok=True)
    tree = {**asdict(found), "sides": side_tree(found.sides), "accuracy": found.accuracy}
    tree |= {"rooms": list(rooms), "client": config.client.value}
    write_whole(folder / VALIDATION, readable_json(tree))
    return JudgeValidation(found, folder / VALIDATION)

"""How good a judge is: pairs of placements whose better one is known, asked in both orders."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from dcap.evaluation.judging.judge import judge_name
from dcap.evaluation.judging.judging_folder import JUDGING, side_tree
from dcap.evaluation.judging.known_answers import known_answers
from dcap.evaluation.judging.validation import JudgeAccuracy, judge_accuracy
from dcap.language.connect import connect
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.settings import runs_root
from flows.judge_run import asking
from flows.language_options import LanguageOptions
from flows.output import readable_json
from flows.run_files import find_run

ROOMS = ("bedroom_01", "bedroom_02", "bedroom_03", "kids_01", "kids_02")
"""Embedded rooms with a bed and free floor beside it."""
VALIDATION = "validation.json"
WITHOUT_RUN = "judge"
"""Folder among the runs for a judge that is validated without one."""


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
    answers = [one for name in rooms for one in known_answers(name)]
    with asking(session, say):
        found = judge_accuracy(connect(config, session), answers, judge_name(config))
    folder.mkdir(parents=True, exist_ok=True)
    tree = {**asdict(found), "sides": side_tree(found.sides), "accuracy": found.accuracy}
    tree |= {"rooms": list(rooms), "client": config.client.value}
    draft = folder / f".{VALIDATION}"
    draft.write_bytes(readable_json(tree))
    draft.replace(folder / VALIDATION)
    return JudgeValidation(found, folder / VALIDATION)

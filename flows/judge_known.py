"""Accuracy of a judge on pairs of placements whose better one is known, asked in both orders."""

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
from dcap.scene.json_tree import write_whole
from dcap.scene.settings import runs_root
from flows.find_run import find_run
from flows.judge_run import asking
from flows.language_options import LanguageOptions
from flows.output import readable_json

ROOMS = ("bedroom_01", "bedroom_02", "bedroom_03", "kids_01", "kids_02")
"""Embedded rooms with a bed and free floor next to it."""
VALIDATION = "validation.json"
WITHOUT_RUN = "judge"
"""Folder among the runs for a judge that is validated without one."""


@dataclass(frozen=True, slots=True)
class JudgeValidation:
    """Accuracy of a judge, and the file that records it."""

    accuracy: JudgeAccuracy
    path: Path


def validate_judge(
    run: str | None,
    options: LanguageOptions,
    say: Callable[[str], None] = lambda text: None,
    rooms: Sequence[str] = ROOMS,
) -> JudgeValidation:
    """Ask a judge questions with known answers about some rooms. validation.json goes into the `judging` of a run, if
    one is named, else into the folder `judge` next to the runs."""
    folder = find_run(run) / JUDGING if run else runs_root() / WITHOUT_RUN
    config = options.config()
    session = Session() if config.client is ClientName.OFFLINE else options.session(folder)
    with asking(session, say):
        client, judge = connect(config, session), judge_name(config)
        answers = list(known_answers(rooms[0]))
        if not options.batch:  # a model that cannot be asked is an error before all rooms are prepared
            judge_accuracy(client, answers[:1], judge)
        answers += [one for name in rooms[1:] for one in known_answers(name)]
        found = judge_accuracy(client, answers, judge)
    folder.mkdir(parents=True, exist_ok=True)
    tree = {**asdict(found), "sides": side_tree(found.sides), "accuracy": found.accuracy}
    tree |= {"rooms": list(rooms), "client": config.client.value}
    write_whole(folder / VALIDATION, readable_json(tree))
    return JudgeValidation(found, folder / VALIDATION)

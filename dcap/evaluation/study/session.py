"""A study while it is served: each rater's next comparison, its files, and the answers.

Independent of the web. The secret word in a link identifies its rater; raters never see the name of a method.
"""

import hmac
import os
from collections.abc import Mapping
from pathlib import Path
from threading import Lock

from dcap.evaluation.run_folder import folder_name
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.attention import LIFTED, MODEL, SETTLED, check_folder, read_placed_surface
from dcap.evaluation.study.design import Side, StudyItem, StudyRun, views_of
from dcap.evaluation.study.study_folder import StudyDesign, StudyVote, VoteJournal, write_lasting

MODELS = "models"
"""Folder of the scenes cut out for the page, made on first use."""


class StudySession:
    """Content and answers of a study's pages."""

    def __init__(
        self, run: StudyRun, folder: Path, design: StudyDesign, tokens: Mapping[str, str], journal: VoteJournal
    ) -> None:
        self.run, self.design, self._folder, self._journal = run, design, folder, journal
        self._tokens, self._making = dict(tokens), Lock()

    def rater_of(self, token: str) -> str | None:
        """The rater of a link; None for an unknown one. Takes as long for a wrong word as for a right one."""
        found = None
        for rater, known in self._tokens.items():
            if hmac.compare_digest(known.encode(), token.encode()) and rater in self.design.raters:
                found = rater
        return found

    def progress(self, rater: str) -> tuple[int, int]:
        """Number of answered comparisons, and of all."""
        items = self.design.raters[rater]
        done = self._journal.answered(rater)
        return sum(one.item in done for one in items), len(items)

    def current(self, rater: str) -> StudyItem | None:
        """The first comparison that the rater has not answered; None if all are."""
        done = self._journal.answered(rater)
        return next((one for one in self.design.raters[rater] if one.item not in done), None)

    def comes_later(self, rater: str, item: StudyItem) -> bool:
        """Whether a comparison of the rater's before this one has not been answered."""
        items, current = self.design.raters[rater], self.current(rater)
        return current is not None and items.index(item) > items.index(current)

    def item(self, rater: str, name: str) -> StudyItem | None:
        """A rater's comparison by its name."""
        return next((one for one in self.design.raters[rater] if one.item == name), None)

    def pictures(self, item: StudyItem, side: Side) -> tuple[Path, ...]:
        """The views of the placement on a side."""
        check = self._check_folder(item, side)
        if check is not None:
            return views_of(check)
        return self.run.shown[item.left if side is Side.LEFT else item.right, item.sample].pictures

    def model(self, item: StudyItem, side: Side) -> Path | None:
        """The scene around the object on a side as GLB, made on first use; None if the run has none.

        Raises a DcapError where the run's own file cannot be read.
        """
        check = self._check_folder(item, side)
        if check is not None:
            return check / MODEL
        method = item.left if side is Side.LEFT else item.right
        source = self.run.shown[method, item.sample].scene_model
        if source is None:
            return None
        path = self._folder / MODELS / method / f"{folder_name(item.sample)}.glb"
        with self._making:  # one after the other: a large scene takes memory
            if not path.is_file() or path.stat().st_mtime_ns < source.stat().st_mtime_ns:
                near = read_placed_surface(source).around_thing()
                path.parent.mkdir(parents=True, exist_ok=True)
                write_lasting(path, near.glb(near.best_direction()))
        return path

    def owns(self, path: Path) -> bool:
        """Whether a file lies in the folder of the run or of the study, and no link in them leads elsewhere."""
        whole = Path(os.path.realpath(path))
        return any(whole.is_relative_to(os.path.realpath(home)) for home in (self.run.folder, self._folder))

    def has_models(self, item: StudyItem) -> bool:
        """Whether both sides can be turned around."""
        methods = (item.left, item.right)
        return item.lifted is not None or all(self.run.shown[m, item.sample].scene_model for m in methods)

    def answer(self, rater: str, item: StudyItem, answers: Mapping[JudgedAxis, Side], seconds: float) -> bool:
        """Store a rater's answers to all questions of a comparison; False if they were given before. OSError if they
        cannot be written."""
        return self._journal.add([
            StudyVote(
                rater, item.item, item.sample, axis, item.left, item.right, answers[axis], item.lifted,
                round(seconds, 1),
            )
            for axis in self.design.questions
        ])  # fmt: skip

    def _check_folder(self, item: StudyItem, side: Side) -> Path | None:
        """Files of one side of an attention check; None for a true comparison."""
        if item.lifted is None:
            return None
        number = self.design.checks.index((item.left, item.sample)) + 1
        return check_folder(self._folder, number, LIFTED if side is item.lifted else SETTLED)

"""A study of a small run, served in the process of the test."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fastapi.testclient import TestClient
from many_methods_run import many_methods_run

from dcap.evaluation.study.attention import LIFTED, MODEL, SETTLED, check_folder
from dcap.evaluation.study.design import method_pairs, per_pair, read_study_run
from dcap.evaluation.study.session import StudySession
from dcap.evaluation.study.study_folder import STUDY_FOLDER, StudyDesign, VoteJournal, tokens_for, write_design
from dcap.scene.types.pictures import PLACED
from flows.judge_run import read_rows
from flows.own_requests import LOOPBACK, OwnRequests
from flows.study.app import study_app

CHECK = b"\x89PNG of a check"


@dataclass(frozen=True)
class ServedStudy:
    """A study with two raters and a browser that keeps nothing."""

    run: Path
    session: StudySession
    tokens: dict[str, str]
    browser: TestClient

    @property
    def folder(self) -> Path:
        """Where its votes are."""
        return self.run / STUDY_FOLDER

    def page(self, rater: str) -> str:
        """The path of a rater's link."""
        return f"/s/{self.tokens[rater]}"


@contextmanager
def served_study(folder: Path) -> Iterator[ServedStudy]:
    """Of a run of three methods; the pictures of its attention checks are stand-ins."""
    run = many_methods_run(folder / "run")
    found, kept = read_study_run(run, read_rows(run)), run / STUDY_FOLDER
    for name in (SETTLED, LIFTED):
        check_folder(kept, 1, name).mkdir(parents=True)
        for view in PLACED:
            (check_folder(kept, 1, name) / f"{view}.png").write_bytes(CHECK + f"{name} {view}".encode())
        (check_folder(kept, 1, name) / MODEL).write_bytes(b"glTF " + name.encode())
    pairs = method_pairs(found)
    design = StudyDesign(0, per_pair(pairs, None), pairs, (("dcap", "bed-1"),), {}, {}).with_raters(2)
    write_design(kept, design)
    tokens = tokens_for(kept, list(design.raters))
    with VoteJournal(kept) as journal:
        session = StudySession(found, kept, design, tokens, journal)
        yield ServedStudy(
            run, session, tokens, TestClient(study_app(session, OwnRequests.to(LOOPBACK)), f"http://{LOOPBACK}:8090")
        )

"""Serves the study of a run until interrupted, and reports its votes.

The design is made at the first start and kept; a later start resumes it, and may add raters. Requests are not logged,
and only the answers of a rater are stored.

Results of a study's votes: Table 2, the raters, and the votes as a table.
"""

import logging
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from dcap.evaluation.judging.judge import without_placement
from dcap.evaluation.methods import joined_id
from dcap.evaluation.study.attention import LIFTED, MODEL, SETTLED, check_folder, make_checks
from dcap.evaluation.study.design import StudyRun, method_pairs, per_pair, questions_of, read_study_run
from dcap.evaluation.study.session import StudySession
from dcap.evaluation.study.study_folder import (
    STUDY_FOLDER,
    StudyDesign,
    StudyVote,
    VoteJournal,
    export_votes,
    read_design,
    read_votes,
    tokens_for,
    write_design,
)
from dcap.evaluation.study.tables import RaterRow, StudyTable, rater_rows, study_table, write_raters, write_study_table
from dcap.evaluation.table_files import TABLES
from dcap.language.protocol.client import ClientName
from dcap.scene.errors import InputError
from flows.find_run import find_run
from flows.judge_run import read_rows
from flows.judge_views import take_views
from flows.own_requests import EVERYWHERE, LOOPBACK, OwnRequests
from flows.run_files import chooser_of
from flows.scoring import changed_since, states_of
from flows.study.app import check_pictures, study_app

STOP_SECONDS = 3
"""Time for pending answers when the server stops [s]."""
WAITING = 128
"""Most connections that wait to be accepted [-]."""


@dataclass(frozen=True, slots=True)
class StudyOptions:
    """Options of serving a study."""

    host: str = LOOPBACK
    port: int = 8090
    raters: int | None = None
    """Least number of links; None: as many as there are, or one."""
    pairs: int | None = None
    """Comparisons per rater; None: the study's number, or `design.PER_RATER` for a new one."""
    seed: int | None = None
    """Seed of pairs, sides and order; None: the study's seed, or 0 for a new one."""
    overall: bool | None = None
    """Whether a third question asks which is better overall; None: as in the study, or no for a new one."""
    url: str = ""
    """Address of a reverse proxy through which raters reach it; empty: none."""


def serve_study(
    run: str, options: StudyOptions, say: Callable[[str], None], announce: Callable[[Mapping[str, str]], None]
) -> None:
    """Serve the study of a run; `say` takes notes for the user, `announce` the link of each rater."""
    place = find_run(run)
    rows = read_rows(place)
    folder = place / STUDY_FOLDER
    known = read_design(folder)
    if known is not None and known.raters:
        check_states(place, known)
    take_views(place, rows, say)
    found = read_study_run(place, rows)
    if known is not None and not known.raters and (options.seed is not None or options.pairs is not None):
        known = None  # it has no raters yet: it was only prepared
    check_kept(found, known, options)
    with open_socket(options.host, options.port) as ear:
        folder.mkdir(exist_ok=True)
        asks_overall = known.asks_overall if known else bool(options.overall)
        with VoteJournal(folder, questions_of(asks_overall)) as journal:
            design = known or new_design(found, folder, options, say)
            design = design.with_raters(options.raters or 1)
            write_design(folder, design)
            tokens = tokens_for(folder, list(design.raters))
            session = StudySession(found, folder, design, tokens, journal)
            base = options.url.rstrip("/") or f"http://{shown_host(options.host)}:{ear.getsockname()[1]}"
            announce({rater: f"{base}/s/{tokens[rater]}" for rater in design.raters})
            try:
                own = OwnRequests.to(options.host, [options.url] if options.url else [])
                server_of(session, own).run(sockets=[ear])
            finally:
                export_votes(folder, journal.votes)


def prepare_study(run: str, say: Callable[[str], None]) -> StudyDesign:
    """Design the study of a run in advance, with its attention checks, so that `serve` starts at once. A study that has
    raters, or shows the same placements, is not changed."""
    place = find_run(run)
    rows = read_rows(place)
    take_views(place, rows, say)
    found = read_study_run(place, rows)
    folder = found.folder / STUDY_FOLDER
    known = read_design(folder)
    if known is not None and (known.raters or not changed_since(found.folder, known.states)):
        return known
    folder.mkdir(exist_ok=True)
    design = new_design(found, folder, StudyOptions(), say)
    write_design(folder, design)
    return design


def new_design(run: StudyRun, folder: Path, options: StudyOptions, say: Callable[[str], None]) -> StudyDesign:
    """Design the study of a run, without raters; makes its attention checks."""
    pairs = method_pairs(run)
    count = per_pair(pairs, options.pairs)
    seed = options.seed or 0
    for (method, sample), why in run.left_out.items():
        say(f"{method} {sample} is left out: {why}")
    say("making attention checks")
    checks = make_checks(run, folder, seed, check_pictures, say)
    if not checks:
        say(f"no attention checks: no placement of {run.folder.name} has a scene.glb that one can be made of")
    left_out = {f"{method}/{sample}": why for (method, sample), why in run.left_out.items()}
    shown = [joined_id(method, sample) for method, sample in run.shown]
    return StudyDesign(seed, count, pairs, checks, left_out, {}, states_of(run.folder, shown), bool(options.overall))


def check_kept(run: StudyRun, known: StudyDesign | None, options: StudyOptions) -> None:
    """Raise InputError for an option that contradicts the existing study."""
    if known is None:
        return
    kept = run.folder / STUDY_FOLDER
    if options.seed is not None and options.seed != known.seed:
        raise InputError(
            f"--seed {options.seed}: the study in {kept} has seed {known.seed}; leave it out or move {kept}"
        )
    if options.overall is not None and options.overall != known.asks_overall:
        has = "three questions, one of them overall" if known.asks_overall else "two questions, none of them overall"
        raise InputError(f"--ask-overall: the study in {kept} has {has}; leave it out or move {kept}")
    check_shown(run, known)
    total = known.per_pair * len(known.pairs)
    if options.pairs is not None and per_pair(known.pairs, options.pairs) != known.per_pair:
        raise InputError(f"--pairs {options.pairs}: the study in {kept} has {total}; leave it out or move {kept}")


def check_states(run: Path, design: StudyDesign) -> None:
    """Raise InputError if placements have changed since people voted on them."""
    if changed := changed_since(run, design.states):
        raise InputError(
            f"{run.name}: {len(changed)} placements have changed since its study began ({changed[0]}); move "
            f"{run / STUDY_FOLDER} away and begin a new one"
        )


def check_shown(run: StudyRun, design: StudyDesign) -> None:
    """Raise InputError if the run lacks placements that its study shows: votes on two placements must not count as
    votes on one."""
    for item in {one for items in design.raters.values() for one in items}:
        gone = [m for m in (item.left, item.right) if (m, item.sample) not in run.shown]
        if gone:
            which = " and ".join(gone)
            raise InputError(f"{run.folder.name}: its study shows {which} {item.sample}, which the run no longer has")
    for number in range(1, len(design.checks) + 1):
        for name in (SETTLED, LIFTED):
            folder = check_folder(run.folder / STUDY_FOLDER, number, name)
            if not (folder / MODEL).is_file():
                raise InputError(f"{folder}: an attention check of the study is gone; bring it back or move its study")


def open_socket(host: str, port: int) -> socket.socket:
    """A socket that listens there; InputError where none can be had."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise InputError(f"--host {host}: no address of this machine ({error})") from None
    ear = socket.socket(family, kind)
    try:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        ear.bind(address)
        ear.listen(WAITING)
    except OSError as error:
        ear.close()
        raise InputError(f"--port {port}: {host} cannot listen there ({error.strerror}); give another") from None
    return ear


def shown_host(host: str) -> str:
    """Host name for a link: this machine's name if the server listens everywhere."""
    if host in EVERYWHERE:
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host


def server_of(session: StudySession, own: OwnRequests) -> uvicorn.Server:
    """The server, without a log of requests."""
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    return uvicorn.Server(
        uvicorn.Config(
            study_app(session, own),
            access_log=False,
            log_level="error",
            server_header=False,
            proxy_headers=False,
            lifespan="off",
            timeout_graceful_shutdown=STOP_SECONDS,
        )
    )


@dataclass(frozen=True, slots=True)
class StudyReport:
    """The report of a study, and its files."""

    table: StudyTable
    raters: tuple[RaterRow, ...]
    csv: Path
    tex: Path
    changed: tuple[str, ...] = ()
    """Samples whose final states have changed since the study began."""


def report_study(run: str) -> StudyReport:
    """Write votes.parquet, raters.csv, and Table 2 of a study; InputError if nobody has voted."""
    found = find_run(run)
    folder = found / STUDY_FOLDER
    design = read_design(folder)
    votes = read_votes(folder)
    if design is None or not any(vote.lifted is None for vote in votes):
        raise InputError(f"{found.name}: its study has no votes yet; dcap study serve {run}")
    check_votes(found, design, votes)
    export_votes(folder, votes)
    rows = rater_rows(design, votes)
    write_raters(folder, rows)
    offline = chooser_of(found).client is ClientName.OFFLINE
    table = study_table(votes, design.seed, offline=offline, without_placement=without_placement(read_rows(found)))
    csv, tex = write_study_table(found / TABLES, table, rows)
    return StudyReport(table, rows, csv, tex, changed_since(found, design.states))


def check_votes(run: Path, design: StudyDesign, votes: tuple[StudyVote, ...]) -> None:
    """Raise InputError if a vote belongs to no rater of the study."""
    strange = sorted({vote.rater for vote in votes} - set(design.raters))
    if strange:
        raise InputError(f"{run.name}: there are votes of {strange[0]}, whom its study does not know")

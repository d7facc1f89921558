"""Pictures of a run's placements for judges and raters, taken when somebody judges or a study is served.

In: a run's folder and its rows. Out: `views/` in the folder of each placement that is compared: the pictures, and
`cameras.json`, which records their cameras and final states. Pictures that still show these states are kept; pictures
taken before come from the store. All methods of a sample share its cameras.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from dcap.evaluation.judging.cameras import SampleCameras, sample_cameras
from dcap.evaluation.judging.judge import Standing, standing_of
from dcap.evaluation.methods import joined_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import InputError
from dcap.scene.types.pictures import BEFORE, PLACED, JudgedViews, SceneBefore, Sights
from dcap.scene.written_files import write_whole
from flows.find_run import input_errors, read_keys
from flows.output import load, readable_json
from flows.run_files import RunRequest, finished_sample, load_run_request
from flows.sample_run import FinishedSample, sample_context
from flows.scoring import states_of
from tasks.artifact import Ref, Store
from tasks.measure.views import judged_views_task, scene_before_task, sights_task
from tasks.run_context import RunContext

VIEWS, CAMERAS = "views", "cameras.json"


@dataclass(frozen=True, slots=True)
class TakenFrom(SampleCameras):
    """Cameras of a placement's pictures, and what the pictures show."""

    states: Mapping[str, str]
    """Fingerprints of the final states by all methods, by METHOD/SAMPLE."""
    contact: tuple[float, float, float]
    """Centre of its close-up [m]."""


def take_views(run: Path, rows: Sequence[SampleOutcome], say: Callable[[str], None]) -> None:
    """Take the missing pictures of every placement that is judged; InputError where stages of one are no longer in the
    cache."""
    samples: dict[str, list[str]] = {}
    for row in rows:
        if standing_of(row) is Standing.JUDGED:
            samples.setdefault(row.sample, []).append(joined_id(row.method, row.sample))
    missing = {sample: names for sample, names in samples.items() if outdated(run, names)}
    if not missing:
        return
    try:
        asked = load_run_request(run)
        for number, (sample, names) in enumerate(missing.items(), 1):
            say(f"pictures of {sample} ({number} of {len(missing)})")
            take(run, asked, names)
    except InputError as error:
        wanted = next(filter(None, (outdated(run, names) for names in missing.values())), run)
        raise InputError(f"{wanted} is missing or outdated, and cannot be taken again: {error}") from error


def outdated(run: Path, names: Sequence[str]) -> Path | None:
    """First picture of a sample that is missing or does not show the final states; None where all are up to date."""
    states = states_of(run, names)
    for name in names:
        folder = sample_folder(run, name) / VIEWS
        for path in (*(folder / f"{one}.png" for one in (*BEFORE, *PLACED)), folder / CAMERAS):
            if not path.is_file():
                return path
        if read_keys(folder / CAMERAS).get("states") != states:
            return folder / CAMERAS
    return None


def take(run: Path, asked: RunRequest, names: Sequence[str]) -> None:
    """Take the pictures of a sample as each method placed it."""
    found = {name: finished_sample(asked, name) for name in names}
    seen = {name: sights_of_sample(one) for name, one in found.items()}
    cameras, states = sample_cameras(list(seen.values())), states_of(run, names)
    for name, one in found.items():
        views, before = pictures_of(one, cameras, seen[name])
        folder = sample_folder(run, name) / VIEWS
        folder.mkdir(parents=True, exist_ok=True)
        for ref, pictures in ((before, BEFORE), (views, PLACED)):
            for picture in pictures:
                source = Store.default().folder(ref) / f"{picture}.png"
                write_whole(folder / source.name, source.read_bytes())
        x, y, z = (round(float(x), 6) for x in seen[name].contact[cameras.direction])
        taken = TakenFrom(cameras.overview, cameras.direction, cameras.width, states, (x, y, z))
        write_whole(folder / CAMERAS, readable_json(asdict(taken)))


def sights_of_sample(finished: FinishedSample) -> Sights:
    """Sights of a placement, from the cache or computed."""
    refs = finished.placement
    with sample_context(finished.sample, RunContext()):
        ref = sights_task(refs.scene, refs.item, refs.intent, refs.anchor, refs.settled)
    found = load(Store.default(), ref, Sights)
    assert found is not None
    return found


def pictures_of(
    finished: FinishedSample, cameras: SampleCameras, seen: Sights
) -> tuple[Ref[JudgedViews], Ref[SceneBefore]]:
    """The pictures of a placement, and of its sample before, from the cache or taken."""
    refs = finished.placement
    surfaces = refs.scene_surface, refs.object_surface
    with sample_context(finished.sample, RunContext()):
        views = judged_views_task(
            refs.scene, refs.item, refs.anchor, refs.settled, *surfaces, cameras.overview, cameras.closeup(seen)
        )
        return views, scene_before_task(refs.scene, refs.item, *surfaces, cameras.overview)


def taken_from(folder: Path) -> TakenFrom:
    """Read the cameras of the pictures in a placement's folder; InputError where they are not known."""
    path = folder / VIEWS / CAMERAS
    if not path.is_file():
        raise InputError(f"{path}: not there; move {folder / VIEWS} away and start again")
    with input_errors(path):
        return TypeAdapter(TakenFrom).validate_python(read_keys(path))

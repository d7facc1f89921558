"""One placement or one drop for a person: stages on standard error, results in a folder.

Where a Prefect server runs already (a team's, or that of `dcap ui` or a benchmark), the placement is a flow run there;
where nobody watches, no server is started for it.
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from rich.console import Console
from rich.status import Status
from rich.text import Text

from dcap.evaluation.methods import method_named
from dcap.language.model.ledger import in_words, spending_of
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample, SourceOptions
from dcap.scene.written_files import JsonObject, write_whole
from flows.configure import LanguageOptions, configured, language_options
from flows.display import console_on
from flows.extra_output import FILM, MAPS_FOLDER, clear_exports, clear_maps, write_film, write_maps_of
from flows.given_settings import given_settings
from flows.options import DropOptions, PlaceOptions
from flows.output import ISO, iso_glb, load_values, write_placement
from flows.place import PlaceConfig
from flows.placement_json import AT_REST
from flows.run_files import FinishedPlacement, located, write_request
from flows.sample_run import STAGE_NAMES, FinishedSample, run_sample
from flows.scene_hints import height_of, place_of
from flows.server import watching_server
from flows.settings import OWN
from tasks.arch import chosen_arch
from tasks.artifact import Store
from tasks.run_context import Event, OnEvent, RunContext, StageEvent

SOLVER = "drop.solver."
"""Section whose settings are those of a case's solver, too."""


def place_files(scene: str, thing: str, prompt: str, options: PlaceOptions, out: Path, *, quiet: bool) -> JsonObject:
    """Place the object of one file in the scene of another; writes the results into `out`, returns placement.json.

    Stage lines go to standard error unless `quiet`.
    """
    if Path(scene).is_dir() and Path(scene).resolve() == out.resolve():
        raise InputError(f"--out {out}: the scene itself; give another folder for the next placement")
    sample = located(sample_of(scene, thing, prompt, options))
    asking = language_options(options)
    config = configured(options, language=asking.config(), arch=chosen_arch(options.arch))
    session = asking.session(out)
    if session.ledger:  # of an earlier placement into the same folder
        Path(session.ledger).unlink(missing_ok=True)
    console = console_on(sys.stderr, quiet=quiet)
    with console.status("reading") as status:
        finished = run_watched(sample, config, session, stage_lines(console, status), console.print)
    if not any(one.computed for one in finished.results):
        console.print(f"all {len(finished.results)} stages cached")
    if session.ledger and Path(session.ledger).is_file():
        console.print(in_words(spending_of(Path(session.ledger))))
    return write_results(finished, out, config, asking, options)


def run_watched(
    sample: Sample, config: PlaceConfig, session: Session, listener: OnEvent, say: Callable[[str], object]
) -> FinishedSample:
    """Run a sample in a flow run if a server runs, else directly."""
    context = RunContext(on_event=listener, session=session)
    with watching_server(say) as url:
        if not url:
            return run_sample(sample, config, context)
        from flows.watched import place_in_flow  # imports Prefect, after the server's address is known

        return place_in_flow(sample, config, context, say)


def stage_lines(console: Console, status: Status) -> OnEvent:
    """Return a listener that updates a status line while a stage works, and prints a line when it has finished."""
    width = max(len(name) for name in STAGE_NAMES)

    def show(event: StageEvent) -> None:
        if event.event is Event.STARTED:
            status.update(event.stage)
        elif event.event is Event.PROGRESS:
            status.update(Text(f"{event.stage} {event.part:4.0%} {event.text}"))
        elif event.ref is not None and event.ref.record is not None:
            record = event.ref.record
            took = "cached" if event.event is Event.CACHED else f"{record.seconds:.2f} s"
            console.print(f"{event.stage:<{width}}  {took:>9}  {record.size / 1024:9.0f} KiB  {event.ref.kind}")

    return show


def sample_of(scene: str, thing: str, prompt: str, options: PlaceOptions) -> Sample:
    """Return the sample that the stages place."""
    return Sample(
        id=f"{Path(thing).stem} in {Path(scene).name}",
        scene=scene,
        object=thing,
        prompt=prompt,
        scene_options=SourceOptions(options.up, options.unit, options.label),
        object_options=SourceOptions(options.object_up, options.object_unit, options.object_label),
        mass=options.mass,
        seed=options.seed,
        labels=options.labels,
        place=place_of(options.at, options.support),
        known_height=height_of(options.height_of, options.unit),
        method=method_named(options.method),
    )


def write_results(
    finished: FinishedSample, out: Path, config: PlaceConfig, asking: LanguageOptions, options: PlaceOptions
) -> JsonObject:
    """Write all files of a placement, the optional ones included; returns placement.json."""
    tree = write_placement(finished, out)
    write_request(out, finished.sample, config, asking)
    clear_maps(out / MAPS_FOLDER)  # of an earlier result in the same folder
    clear_exports(out)
    (out / FILM).unlink(missing_ok=True)
    (out / ISO).unlink(missing_ok=True)
    if tree["verdict"] == AT_REST and (options.maps or options.animate or options.surface == "iso"):
        found = FinishedPlacement(out, finished, load_values(finished, Store.default()), config)
        if options.maps:
            write_maps_of(found, out / MAPS_FOLDER)
        settled, particles = found.values.settled, found.values.particles
        if options.surface == "iso" and settled and particles:
            write_whole(out / ISO, iso_glb(settled, particles))
        if options.animate:
            write_film(found, out)
    return tree


def drop_case(case: Path | Mapping[str, object], options: DropOptions, out: Path, *, quiet: bool) -> JsonObject:
    """Settle the bodies of a case; writes the results into `out`, returns result.json."""
    from tasks.case.run import run_case  # only here: a placement loads the solver in the process of its drop

    return run_case(
        case,
        out,
        solver=options.solver,
        arch=chosen_arch(options.arch),
        resolution=options.resolution,
        threads=options.threads,
        stability=options.stability,
        load_aware=options.load_aware,
        settings=solver_settings(),
        quiet=quiet,
    )


def solver_settings() -> Mapping[str, object]:
    """The solver's settings from `dcap.yaml` and the environment, checked together with those of the stages."""
    given = [key for key in given_settings() if key.partition(".")[0] not in OWN]
    if not given:
        return {}
    from flows.settings import stage_settings  # only then: the stages bring heavy libraries

    solver = stage_settings().drop.solver.model_dump()
    return {key.removeprefix(SOLVER): solver[key.removeprefix(SOLVER)] for key in given if key.startswith(SOLVER)}

"""One placement for a person: says what is cached, starts a server only if something must run, shows the stages."""

import sys
from functools import partial
from pathlib import Path

from rich.console import Console

from dcap.language.model.ledger import in_words, spending_of
from dcap.scene.errors import InputError
from dcap.scene.json_tree import JsonObject
from dcap.scene.store.artifacts import Store
from dcap.scene.whole_files import write_whole
from flows.configure import configured
from flows.export_files import clear_exports
from flows.film_output import FILM, write_film
from flows.language_options import LanguageOptions, language_options
from flows.map_output import FOLDER, clear_maps, write_maps_of
from flows.one_sample import sample_of, show
from flows.options import PlaceOptions
from flows.output import ISO, iso_glb, load_values, write_placement
from flows.place import PlaceConfig, place
from flows.placement_json import AT_REST
from flows.run_files import FinishedPlacement, write_asked
from flows.sample_run import FinishedSample, heavy_modules, plan_sample, recorded, users_words
from flows.server import prefect_server
from tasks.arch import chosen_arch
from tasks.runner.context import RunContext
from tasks.runner.process_server import process_server


def place_files(scene: str, thing: str, prompt: str, options: PlaceOptions, out: Path, *, quiet: bool) -> JsonObject:
    """Place the object of one file in the scene of another; writes the results into `out`, returns placement.json.

    Stage lines go to standard error unless `quiet`.
    """
    refuse_own_scene(scene, out)
    sample = sample_of(scene, thing, prompt, options)
    asking = language_options(options)
    config = configured(options, language=asking.config(), arch=chosen_arch(options.arch))
    session = asking.session(out)
    if session.ledger:  # of an earlier placement into the same folder
        Path(session.ledger).unlink(missing_ok=True)
    console = Console(file=sys.stderr, quiet=quiet, highlight=False, force_jupyter=False)
    plan = plan_sample(sample, config)
    if plan.failed is not None:
        raise plan.failed.error
    if plan.finished is not None:
        console.print(f"all {len(plan.cached)} stages cached")
        return write_results(plan.finished, out, config, asking, options)
    with (
        console.status("starting") as status,
        prefect_server(),
        process_server(heavy_modules(plan.coming)) as server,
        recorded(sample, RunContext(session=session, server=server), partial(show, console, status)) as recorder,
    ):
        from flows.sample_flow import flow_runs_of  # imports Prefect, after the server's address is known

        for flow_run in flow_runs_of(sample):
            recorder.records.clear()  # of a flow run that was lost with its server
            with flow_run, users_words(sample):
                placement = place(sample, config)
                flow_run.show(placement)
    if session.ledger and Path(session.ledger).is_file():
        console.print(in_words(spending_of(Path(session.ledger))))
    finished = FinishedSample(sample, placement, tuple(recorder.records))
    return write_results(finished, out, config, asking, options)


def refuse_own_scene(scene: str, out: Path) -> None:
    """Refuse to write over the scene that is read: what was asked of the result could not be looked up again."""
    if Path(scene).is_dir() and Path(scene).resolve() == out.resolve():
        raise InputError(f"--out {out}: the scene itself; give another folder for the next placement")


def write_results(
    finished: FinishedSample, out: Path, config: PlaceConfig, asking: LanguageOptions, options: PlaceOptions
) -> JsonObject:
    """All files of a placement, those that were asked for included; returns placement.json."""
    tree = write_placement(finished, out)
    write_asked(out, finished.sample, config, asking)
    clear_maps(out / FOLDER)  # of an earlier result in the same folder
    clear_exports(out)
    (out / FILM).unlink(missing_ok=True)
    (out / ISO).unlink(missing_ok=True)
    if tree["verdict"] == AT_REST and (options.maps or options.animate or options.surface == "iso"):
        found = FinishedPlacement(out, finished, load_values(finished, Store.default()), config)
        if options.maps:
            write_maps_of(found, out / FOLDER)
        settled, particles = found.values.settled, found.values.particles
        if options.surface == "iso" and settled and particles:
            write_whole(out / ISO, iso_glb(settled, particles))
        if options.animate:
            write_film(found, out)
    return tree

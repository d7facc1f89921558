"""Conditioning maps of one sample of a run, for a person."""

import json
from pathlib import Path

from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import InputError
from flows.benchmark import find_run, sample_from_json
from flows.map_output import FOLDER, write_maps_of
from flows.place import PlaceConfig
from flows.sample_run import plan_sample


def maps_of_sample(run: str, sample: str, camera: Path | None, photo: Path | None, out: Path | None) -> Path:
    """Write the maps of one sample of a run; returns their folder, by default `maps` in the sample's own."""
    if photo is not None and camera is None:
        raise InputError(f"--over {photo}: a photo needs its camera: --camera FILE (camera.json, docs/formats.md)")
    folder = find_run(run)
    asked = json.loads((folder / "run.json").read_text())
    samples = {one["id"]: sample_from_json(one) for one in asked["samples"]}
    if sample not in samples:
        raise InputError(f"{sample!r} is not a sample of {folder.name}; it has {', '.join(sorted(samples))}")
    config = PlaceConfig.model_validate(asked["config"])
    plan = plan_sample(samples[sample], config)
    if plan.finished is None:
        why = plan.failed.message if plan.failed else f"stage {plan.missing} is not cached ({plan.why})"
        raise InputError(f"{sample} of {folder.name}: {why}; run the benchmark again")
    return write_maps_of(plan.finished, out or sample_folder(folder, sample) / FOLDER, config.render, camera, photo)

"""`--only-failed` takes the last run of the same dataset and methods, and says what it takes."""

from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from flows.benchmark import keep_result, new_run_folder
from flows.configure import LanguageOptions
from flows.place import PlaceConfig
from flows.sample_run import Plan
from flows.selection import failed_before

GOOD, BAD, LATER = (Sample(name, "room", "ball", "put it") for name in ("good", "bad", "later"))


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder of each test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    return tmp_path


def run_of(dataset: Path, *failed: Sample, samples: tuple[Sample, ...] = (GOOD, BAD)) -> Path:
    """A run in which some failed and the others finished."""
    run = new_run_folder(dataset, samples, PlaceConfig(), LanguageOptions())
    for sample in samples:
        if sample in failed:
            keep_result(run, sample, InputError("no such file"))
        else:
            (run / "samples" / sample.id).mkdir(parents=True)
            (run / "samples" / sample.id / "placement.json").write_text("{}")
    return run


def test_what_the_last_run_did_not_ask_for_did_not_fail(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of two samples, one good and one failed, the failed one runs; the good one would run too, so it is left out."""
    run = run_of(data / "set.yaml", BAD)
    assert failed_before(data / "set.yaml", [GOOD, BAD, LATER], PlaceConfig()) == [BAD]
    said = capsys.readouterr().err
    assert f"of {run.name}: 1 failed (bad)" in said
    assert "left out: 1" in said


def test_what_finished_is_in_the_new_table(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A finished sample whose stages are all cached costs nothing and keeps its row."""
    run_of(data / "set.yaml", BAD)
    cached = Plan(GOOD, (), finished=object())  # type: ignore[arg-type]
    monkeypatch.setattr("flows.selection.plan_sample", lambda sample, config, bring: cached)
    assert failed_before(data / "set.yaml", [GOOD, BAD, LATER], PlaceConfig()) == [GOOD, BAD]


def test_a_run_of_another_dataset_is_not_the_last(data: Path) -> None:
    """A newer run of other samples, or by other methods, does not hide what failed."""
    run_of(data / "set.yaml", BAD)
    run_of(data / "other.yaml")
    run_of(data / "set.yaml", samples=(Sample("no_drop/bad", "room", "ball", "put it", method="no_drop"),))
    assert failed_before(data / "set.yaml", [GOOD, BAD], PlaceConfig()) == [BAD]


def test_the_newest_counts(data: Path) -> None:
    """What failed once and was run again since is done."""
    run_of(data / "set.yaml", BAD)
    again = run_of(data / "set.yaml")
    with pytest.raises(InputError, match=f"nothing failed in {again.name}"):
        failed_before(data / "set.yaml", [GOOD, BAD], PlaceConfig())


def test_without_a_run_there_is_nothing_to_repeat(data: Path) -> None:
    """The message names the dataset and the methods."""
    with pytest.raises(InputError, match=r"no run of .*set\.yaml by dcap"):
        failed_before(data / "set.yaml", [GOOD], PlaceConfig())

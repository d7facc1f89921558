"""`dcap.yaml`, environment and flags: which counts, where each value came from, and mistakes in one line."""

import json
from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.settings import data_root
from flows.cli.app import main
from flows.configure import configured
from flows.given_settings import given_settings, settings_file
from flows.options import AllSettings, BenchmarkOptions, DropOptions, PlaceOptions, UiOptions
from flows.place import PlaceConfig
from flows.place_one import solver_settings
from flows.settings import effective_options, exported_paths, settings_in_force, stage_settings
from tasks.cache import deciding


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of each test's own, without settings from elsewhere."""
    for name in ("DCAP_CONFIG", "DCAP_DATA", "DCAP_STORE", "PREFECT_API_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(text: str) -> None:
    """Settings in the working directory."""
    Path("dcap.yaml").write_text(text)


def workers(**flags: object) -> int:
    """Samples that a benchmark places in parallel."""
    return effective_options(BenchmarkOptions, flags).workers


def shown(key: str, **flags: object) -> tuple[object, str, str]:
    """Value and origin of a setting."""
    (row,) = [one for one in settings_in_force(effective_options(AllSettings, flags), flags) if one.key == key]
    return row.value, str(row.origin), row.where


def test_nothing_given_is_every_default() -> None:
    """Without a file the stages have the configuration of the code."""
    assert settings_file() is None
    assert stage_settings() == PlaceConfig()
    assert {str(one.origin) for one in settings_in_force(AllSettings(), {})} == {"default"}


def test_flag_over_environment_over_file_over_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each wins over the ones before it, and says where it stands."""
    assert shown("run.workers") == (2, "default", "")
    write("# mine\nrun:\n  workers: 3\n")
    assert shown("run.workers") == (3, "file", "dcap.yaml:3")
    monkeypatch.setenv("DCAP_RUN__WORKERS", "4")
    assert shown("run.workers") == (4, "environment", "DCAP_RUN__WORKERS")
    assert shown("run.workers", workers=5) == (5, "flag", "--workers")
    assert workers() == 4
    assert workers(workers=5) == 5


def test_the_file_is_that_of_the_working_directory_or_a_named_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """$DCAP_CONFIG goes before; empty, there is none; one that is not there is an error."""
    write("run: {workers: 3}")
    (folder / "other.yaml").write_text("run: {workers: 7}")
    monkeypatch.setenv("DCAP_CONFIG", str(folder / "other.yaml"))
    assert workers() == 7
    monkeypatch.setenv("DCAP_CONFIG", "")
    assert workers() == 2
    monkeypatch.setenv("DCAP_CONFIG", "gone.yaml")
    with pytest.raises(InputError, match=r"DCAP_CONFIG=gone\.yaml: no such file"):
        workers()


def test_the_same_values_have_the_same_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """However a solver, a cell or a clamp is given, the configurations that decide results are equal."""
    typed = configured(effective_options(PlaceOptions, {"solver": "mls", "resolution": 0.02, "paper_limits": True}))
    write("drop: {solver: {method: mls}}\nparticles: {cell: 0.02}\nmaterials: {paper_limits: true}\n")
    in_file = configured(effective_options(PlaceOptions, {}))
    write("{}")
    for name, value in (("DROP__SOLVER__METHOD", "mls"), ("PARTICLES__CELL", "2.0e-2")):
        monkeypatch.setenv(f"DCAP_{name}", value)
    in_environment = configured(effective_options(PlaceOptions, {"paper_limits": True}))
    assert deciding(typed.model_dump(mode="json")) == deciding(in_file.model_dump(mode="json"))
    assert in_file == in_environment


def test_a_flag_wins_over_a_stages_setting() -> None:
    """`--solver tl` although the file says mls; what the file says besides still counts."""
    write("drop: {solver: {method: mls, step_limit: 700}}\nrotation: {picture_size: 256}\n")
    config = configured(effective_options(PlaceOptions, {"solver": "tl"}))
    assert (config.drop.solver.method, config.drop.solver.step_limit) == ("tl", 700)
    assert config.rotation.picture_size == 256
    assert config.drift == PlaceConfig().drift  # whose solver has defaults of its own


def test_a_setting_inside_defaults_of_its_own_leaves_them() -> None:
    """One key of the drift's solver is set; the others stay the drift's, not the solver's."""
    write("drift: {solver: {step_limit: 50}}")
    usual = PlaceConfig().drift.solver
    assert stage_settings().drift.solver == usual.model_copy(update={"step_limit": 50})


def test_a_benchmark_takes_the_best_unless_told() -> None:
    """Nobody can be asked what was meant, so that its default is another one than that of `place`."""
    assert effective_options(PlaceOptions, {}).ambiguous == "ask"
    assert effective_options(BenchmarkOptions, {}).ambiguous == "best"
    write("intent: {ambiguous: ask}")
    assert effective_options(BenchmarkOptions, {}).ambiguous == "ask"
    assert effective_options(BenchmarkOptions, {"ambiguous": "best"}).ambiguous == "best"


def test_a_drop_has_the_solvers_settings() -> None:
    """`dcap drop` takes what stands under `drop.solver`, and options as `place` does."""
    assert solver_settings() == {}
    write("drop: {solver: {step_limit: 700, method: mls}}\nrun: {threads: 3}")
    assert solver_settings() == {"step_limit": 700, "method": "mls"}
    options = effective_options(DropOptions, {})
    assert (options.solver, options.threads) == ("mls", 3)


def test_paths_are_seen_from_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For all that a command starts, and not longer; a variable that is set goes before."""
    write("paths: {data: store/here}\nserver: {port: 4300}\n")
    with exported_paths():
        assert data_root() == folder / "store" / "here"
        assert shown("paths.data")[1:] == ("file", "dcap.yaml:1")
    assert data_root() != folder / "store" / "here"
    assert effective_options(UiOptions, {}).port == 4300
    monkeypatch.setenv("DCAP_DATA", str(folder / "mine"))
    with exported_paths():
        assert data_root() == folder / "mine"


def test_paths_hold_until_the_last_thread_has_ended(folder: Path) -> None:
    """The first to end takes them from no other."""
    write("paths: {data: store/here}")
    first, second = exported_paths(), exported_paths()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert data_root() == folder / "store" / "here"
    second.__exit__(None, None, None)
    assert data_root() != folder / "store" / "here"


MISTAKES = [
    ("run:\n  wrokers: 3", "dcap.yaml:2: unknown key 'run.wrokers'; did you mean 'run.workers'?"),
    ("drop:\n  solver:\n    step_limt: 3", "dcap.yaml:3: unknown key 'drop.solver.step_limt'; did you mean"),
    ("drpo: {solver: {step_limit: 3}}", "dcap.yaml:1: unknown key 'drpo.solver.step_limit'; did you mean"),
    ("step_limit: 3", "dcap.yaml:1: unknown key 'step_limit'; did you mean 'drop.solver.step_limit'"),
    ("measured: true", "dcap.yaml:1: unknown key 'measured'"),
    ("runn: {workers: 3}", "dcap.yaml:1: unknown key 'runn.workers'; did you mean 'run.workers'?"),
    (
        "drop: {solver: {step_seconds: .inf}}",
        "dcap.yaml:1: drop.solver.step_seconds is inf: expected a finite number",
    ),
    ("run:\n  workers: many", "dcap.yaml:2: run.workers is 'many': Input should be a valid integer"),
    ("run: {workers: 0}", "dcap.yaml:1: run.workers is 0: Input should be greater than or equal to 1"),
    ("run: {batch: yes}", "run.batch is 'yes': Input should be a valid boolean"),
    ("drop: {solver: {method: mls}}\nrun: {runner: x}", "yaml:2: run.runner is 'x': is not one of local, dask"),
    ('particles: {cell: "0.02"}', "particles.cell is '0.02': Input should be a valid number"),
    ("particles: {cell: 2.0}", "particles.cell is 2.0: is not a cell size between 0 and 1.0 m"),
    ("drop: {solver: {method: fem}}", "drop.solver.method is 'fem': is not one of tl, mls"),
    ("render:\n  elevations_deg: [10, high]", "dcap.yaml:2: render.elevations_deg is [10, 'high']"),
    ("render: {size: {a: {b: [1]}}}", "unknown key 'render.size.a.b'"),
    ("render: {size: [[1]]}", "render.size is [[1]]: expected a value or a list of values"),
    ("drop: 3", "dcap.yaml:1: drop is 3: expected keys and values"),
    ("run: 3", "dcap.yaml:1: run is 3: expected keys and values"),
    ("drop: {threads: 3}", "drop.threads is 3: is set by run.threads"),
    ("intent: {language: {model: m}}", "intent.language.model is 'm': is set by run.language and run.model"),
    ("drop: {solver: {arch: cuda}}", "drop.solver.arch is 'cuda': is set by run.arch"),
    ("server: {port: 99999}", "server.port is 99999"),
    ("[1, 2]", "dcap.yaml: expected sections of keys and values, found [1, 2]"),
    ("run: {workers: 3, workers: 4}", "dcap.yaml: cannot be read as YAML"),
    ("run: [", "dcap.yaml: cannot be read as YAML: line 1, column 7: while parsing a flow node: expected the"),
    ("a: !!python/object/apply:os.system [ls]", "dcap.yaml: cannot be read as YAML"),
]
"""Texts of settings, and words that are said of each."""


def test_a_mistake_is_one_line(capsys: pytest.CaptureFixture[str], subtests: pytest.Subtests) -> None:
    """Exit 2, and the place, the key, the value and what is wrong with it."""
    for text, words in MISTAKES:
        write(text)
        with subtests.test(text):
            code = main(["config", "show"])
            said = capsys.readouterr()
            assert (code, said.out, said.err.count("\n")) == (2, "", 1)
            assert words in said.err


def test_mistakes_in_the_environment_name_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unknown keys and wrong values alike; what has a variable of its own is sent there."""
    monkeypatch.setenv("DCAP_RENDER__SIZE", "-5")
    with pytest.raises(InputError, match=r"DCAP_RENDER__SIZE: render\.size is -5"):
        stage_settings()
    monkeypatch.setenv("DCAP_RENDER__SIZE", "512")
    assert stage_settings().render.size == 512
    monkeypatch.setenv("DCAP_RUN__WORKRES", "5")
    with pytest.raises(InputError, match=r"DCAP_RUN__WORKRES: unknown key 'run\.workres'; did you mean"):
        workers()
    monkeypatch.delenv("DCAP_RUN__WORKRES")
    monkeypatch.setenv("DCAP_PATHS__DATA", "/elsewhere")
    with pytest.raises(InputError, match=r"DCAP_PATHS__DATA: set DCAP_DATA for paths\.data"):
        given_settings()


def test_a_misspelt_variable_without_a_section_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single underscore in place of two, and a letter out of place; somebody's own variables are left alone."""
    for name, reads in (("RUN_WORKERS", workers), ("RENDER_SIZE", stage_settings)):
        monkeypatch.setenv(f"DCAP_{name}", "5")
        right = f"DCAP_{name.replace('_', '__')}"
        with pytest.raises(InputError, match=rf"DCAP_{name}: unknown variable; did you mean '{right}'\?"):
            reads()
        monkeypatch.delenv(f"DCAP_{name}")
    monkeypatch.setenv("DCAP_SERVER_PORT", "5000")
    with pytest.raises(InputError, match=r"DCAP_SERVER_PORT: unknown variable; did you mean 'DCAP_SERVER__PORT'\?"):
        effective_options(UiOptions, {})
    monkeypatch.setenv("DCAP_SERVER_PORT", "tcp://10.0.0.1:4200")  # a cluster tells of a service called dcap-server
    monkeypatch.setenv("DCAP_STROE", "")
    for name in ("DCAP_SAMPLE_DATA", "DCAP_DATASET", "DCAP_HOME", "DCAP_SCORE", "DCAP_STORES", "DCAP_WORKER_THREADS"):
        monkeypatch.setenv(name, "1")
    given_settings()
    stage_settings()
    effective_options(UiOptions, {})
    for name in ("DCAP_STROE", "DCAP_STOR"):
        monkeypatch.setenv(name, "/elsewhere")
        with pytest.raises(InputError, match=rf"{name}: unknown variable; did you mean 'DCAP_STORE'\?"):
            given_settings()
        monkeypatch.delenv(name)
    monkeypatch.setenv("DCAP_RUN_CLUSTER", "tcp://10.0.0.1:8786")
    with pytest.raises(InputError, match="did you mean 'DCAP_RUN__CLUSTER'"):
        workers()


def test_a_file_that_grows_without_end_is_refused() -> None:
    """Nine levels of ten references each are a thousand million values in 500 bytes."""
    levels = ["a0: &a0 {x: 1}"] + [
        f"a{n}: &a{n} {{{', '.join(f'k{i}: *a{n - 1}' for i in range(10))}}}" for n in range(1, 10)
    ]
    write("\n".join(levels))
    with pytest.raises(InputError, match="more than 1000 values"):
        given_settings()


def test_what_is_shown(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As text and JSON, with all settings or those that were given; secrets are told to be set, never shown."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-very-secret")
    monkeypatch.setenv("PREFECT_API_URL", "http://me:hidden-word@localhost:4200/api")
    write("paths: {store: 's3://key:pass-word@bucket/prefix?secret=to-ken'}\nrender: {size: 512}\n")
    assert main(["config", "show", "--workers", "6"]) == 0
    text = capsys.readouterr().out
    assert "render.size = 512  # file dcap.yaml:2\n" in text
    assert "run.workers = 6  # flag --workers\n" in text
    assert "render.fov_deg" not in text
    assert main(["config", "show", "--all", "--json"]) == 0
    out = capsys.readouterr().out
    tree = json.loads(out)
    rows = {one["key"]: one for one in tree["settings"]}
    assert tree["file"] == "dcap.yaml"
    assert rows["render.fov_deg"] == {"key": "render.fov_deg", "value": 55.0, "origin": "default", "where": ""}
    assert rows["server.api_url"]["value"] == "http://***@localhost:4200/api"
    assert rows["paths.store"]["value"] == "s3://***@bucket/prefix?***"
    assert tree["secrets"]["ANTHROPIC_API_KEY"] == "set, not shown"
    for secret in ("very-secret", "hidden-word", "pass-word", "to-ken"):
        assert secret not in text + out

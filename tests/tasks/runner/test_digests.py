"""What counts as the code behind a stage."""

import ast
import gc
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dcap.scene.settings import PROJECT_ROOT
from flows.place import STAGES
from tasks.runner.digests import libraries, source_digests
from tasks.runner.stage import Stage

FILES = {
    "dcap/__init__.py": "",
    "tasks/__init__.py": "",
    "tasks/fill.py": (
        '"""Doc."""\nfrom dcap.geometry.grid import cells\nfrom tasks.runner.stage import stage\n'
        '\ndef fill(x): return cells(x)\n'
    ),
    "tasks/runner/stage.py": "def stage(f): return f\n",
    "dcap/geometry/__init__.py": "",
    "dcap/geometry/grid.py": "import numpy as np\nfrom dcap.scene import box\ndef cells(x):\n    return np.floor(x)\n",
    "dcap/geometry/other.py": "def unused(): return 1\n",
    "dcap/scene/__init__.py": "",
    "dcap/scene/box.py": 'TABLE = "materials.csv"\ndef f():\n    from dcap.scene.late import late\n    return late()\n',
    "dcap/scene/late.py": "def late(): return 3\n",
    "materials.csv": "foam,30\n",
}  # fmt: skip


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A small project."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def digests(root: Path) -> dict[str, str]:
    """Digests of the code behind the stage `fill`."""
    return source_digests(root / "tasks" / "fill.py", root)


def test_reachable_files(root: Path) -> None:
    """Imports count through modules, packages, functions and named data files; the machinery of stages does not."""
    assert set(digests(root)) == {
        "tasks/fill.py", "dcap/geometry/__init__.py", "dcap/geometry/grid.py", "dcap/scene/__init__.py",
        "dcap/scene/box.py", "dcap/scene/late.py", "materials.csv",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("dcap/geometry/grid.py", "floor", "ceil"),
        ("dcap/scene/late.py", "3", "4"),
        ("materials.csv", "30", "31"),
        ("dcap/geometry/__init__.py", "", "FLAG = 1\n"),
    ],
)
def test_a_reachable_change_counts(root: Path, name: str, old: str, new: str) -> None:
    """Changing one reachable line changes the digest of that file and of no other."""
    before = digests(root)
    path = root / name
    path.write_text(path.read_text().replace(old, new) if old else new)
    after = digests(root)
    assert [key for key in before if before[key] != after[key]] == [name]


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("dcap/geometry/other.py", "1", "2"),
        ("tasks/runner/stage.py", "return f", "return None"),
        ("tasks/fill.py", "Doc.", "Another docstring."),
        ("dcap/geometry/grid.py", "    return", "    # a comment\n    return"),
        ("dcap/geometry/grid.py", "def cells(x):\n", 'def cells(x):\n    """Doc."""\n'),
    ],
)
def test_other_changes_do_not_count(root: Path, name: str, old: str, new: str) -> None:
    """Unreachable code, docstrings and comments leave every digest as it was."""
    before = digests(root)
    path = root / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    assert digests(root) == before


@pytest.mark.parametrize("stage", [one for one in STAGES if one.asks], ids=lambda one: one.name)
def test_who_answers_counts(stage: Stage[..., object]) -> None:
    """The digest of a stage that asks covers every client, the lexicon and the prompts, not how replies are sent."""
    found = set(source_digests(stage.module_path, PROJECT_ROOT))
    lexicon = {str(path.relative_to(PROJECT_ROOT)) for path in (PROJECT_ROOT / "dcap/language/offline").rglob("*.csv")}
    assert "dcap/language/offline/lexicon/things.csv" in lexicon
    assert found >= lexicon | {"dcap/language/offline/client.py", "dcap/language/model/client.py", "prompts/common.j2"}
    assert not found & {"dcap/language/model/batch.py", "tasks/runner/stage.py"}


def test_libraries_that_decide(root: Path) -> None:
    """Only third-party packages that reachable code imports are named, with their versions."""
    import numpy as np

    found = libraries(root / "tasks" / "fill.py", root)
    assert found.keys() == {"python", "numpy"}
    assert found["numpy"] == np.__version__


def test_an_installed_dcap_has_the_same_digests(root: Path) -> None:
    """A wheel has the data files in dcap/_resources; they count under the same names, files at its root do not."""
    (root / "prompts").mkdir()
    (root / "prompts" / "a.j2").write_text("a")
    (root / "dcap" / "scene" / "late.py").write_text('FOLDER = "prompts"\ndef late(): return FOLDER\n')
    cloned = digests(root)
    assert "prompts/a.j2" in cloned
    (root / "dcap" / "_resources").mkdir()
    for name in ("prompts", "materials.csv"):
        (root / name).rename(root / "dcap" / "_resources" / name)
    (root / "materials.csv").write_text("of somebody else")
    assert digests(root) == cloned


@pytest.fixture
def threads_change_in_collections() -> Iterator[None]:
    """Every garbage collection lets another thread run, as finalizers that wait do."""

    def step_aside(_phase: str, _info: dict[str, int]) -> None:
        time.sleep(0)

    gc.callbacks.append(step_aside)
    yield
    gc.callbacks.remove(step_aside)


@pytest.mark.usefixtures("threads_change_in_collections")
def test_samples_look_their_code_up_at_once(tmp_path: Path) -> None:
    """Samples run in threads of one process, and each parses what no one parsed before."""
    source = "\n".join(f"def f{k}(x):\n    return (x + {k}) * [x, (x, {{x: -x}})][0]" for k in range(300))
    paths = [tmp_path / f"{name}.py" for name in "abcdefgh"]
    for path in paths:
        path.write_text(source)
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda path: source_digests(path, tmp_path), paths))
    assert [list(one) for one in found] == [[path.name] for path in paths]


def test_libraries_may_parse_at_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What CPython says then is not about the file: it is parsed again."""
    (path := tmp_path / "a.py").write_text("x = 1\n")
    parse, failures = ast.parse, [SystemError("AST constructor recursion depth mismatch (before=66, after=72)")]

    def parse_after_failure(source: bytes, filename: str) -> ast.Module:
        if failures:
            raise failures.pop()
        return parse(source, filename)

    monkeypatch.setattr(ast, "parse", parse_after_failure)
    found = source_digests(path, tmp_path)
    monkeypatch.undo()
    (again := tmp_path / "b.py").write_text("x = 1\n")
    assert list(found.values()) == list(source_digests(again, tmp_path).values())

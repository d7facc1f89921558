"""What counts as the code behind a stage."""

import itertools
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from dcap.scene.errors import StoreError
from dcap.scene.settings import PROJECT_ROOT
from flows.place import STAGES
from tasks import code
from tasks.cache import CLIENT
from tasks.code import changed_sources, code_of

FILES = {
    "dcap/__init__.py": "import dcap.face\n",
    "dcap/face.py": "FACE = 1\n",
    "tasks/__init__.py": "",
    "tasks/fill.py": (
        '"""Doc."""\nfrom dcap.geometry.grid import cells\nfrom tasks.cache import stage\n'
        '\ndef fill(x): return cells(x)\n'
    ),
    "tasks/cache.py": "def stage(f): return f\n",
    "dcap/geometry/__init__.py": "",
    "dcap/geometry/grid.py": "import numpy as np\nfrom dcap.scene import box\ndef cells(x):\n    return np.floor(x)\n",
    "dcap/geometry/other.py": "def unused(): return 1\n",
    "dcap/scene/__init__.py": "",
    "dcap/scene/box.py": 'TABLE = "materials.csv"\ndef f():\n    from dcap.scene.late import late\n    return late()\n',
    "dcap/scene/late.py": "def late(): return 3\n",
    "materials.csv": "foam,30\n",
}  # fmt: skip


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small project, and a cache."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def found(root: Path) -> code.Code:
    """The code behind the stage `fill`, as a new program finds it."""
    code_of.cache_clear()
    code._sources_at_begin.cache_clear()
    code._module_files.cache_clear()
    return code_of(root / "tasks" / "fill.py", root)


def test_reachable_files(root: Path) -> None:
    """Imports count through modules, packages, functions and named data files; the machinery of stages and the face of
    the package do not. Of libraries those count that reachable code imports."""
    one = found(root)
    assert set(one.files) == FILES.keys() - {
        "dcap/__init__.py", "dcap/face.py", "tasks/__init__.py", "tasks/cache.py", "dcap/geometry/other.py"
    }  # fmt: skip
    assert one.libraries.keys() == {"python", "numpy"}
    assert one.libraries["numpy"] == np.__version__


def test_every_library_behind_a_stage_is_known_by_the_name_it_is_installed_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else no key would have its version, and results of an older one would count."""
    asked = set[str]()
    monkeypatch.setattr(code, "installed_version", lambda name: asked.add(name) or "1")
    code_of.cache_clear()
    for one in STAGES:
        code_of(one.file)
    code_of.cache_clear()
    project = tomllib.loads((PROJECT_ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *itertools.chain(*project["optional-dependencies"].values())]
    known = {re.split(r"[^\w.-]", line)[0].lower() for line in lines}
    assert {name.lower().replace("_", "-") for name in asked} - known == set()


CHANGES = [
    ("dcap/geometry/grid.py", "floor", "ceil", True),
    ("dcap/scene/late.py", "3", "4", True),
    ("materials.csv", "30", "31", True),
    ("dcap/geometry/__init__.py", "", "FLAG = 1\n", True),
    ("dcap/geometry/other.py", "1", "2", False),
    ("dcap/face.py", "1", "2", False),
    ("tasks/cache.py", "return f", "return None", False),
    ("tasks/fill.py", "Doc.", "Another docstring.", False),
    ("dcap/geometry/grid.py", "    return", "    # a comment\n    return", False),
    ("dcap/geometry/grid.py", "def cells(x):\n", 'def cells(x):\n    """Doc."""\n', False),
]
"""File, a text in it, another, and whether that counts."""


def test_a_change_counts_where_it_can_decide(root: Path) -> None:
    """Of reachable code and data, and of no other file; docstrings, comments and unreachable code do not count."""
    for name, old, new, counts in CHANGES:
        before, text = found(root), (root / name).read_text()
        assert old in text
        (root / name).write_text(text.replace(old, new) if old else new)
        after = found(root)
        changed = [key for key in before.files if before.files[key] != after.files[key]]
        assert changed == [name] * counts, (name, new)
        assert (after.digest != before.digest) is counts, (name, new)
        assert list(changed_sources(before.files, root)) == changed
        (root / name).write_text(text)


def test_what_is_saved_while_a_program_runs_is_the_next_programs(root: Path) -> None:
    """A program keeps the digests of its begin."""
    before = found(root)
    (root / "dcap/scene/late.py").write_text("def late(): return 5\n")
    code_of.cache_clear()
    assert code_of(root / "tasks" / "fill.py", root) == before
    assert found(root) != before


def test_an_installed_dcap_has_the_same_digests(root: Path) -> None:
    """A wheel has the data files in dcap/_resources; they count under the same names, files at its root do not."""
    (root / "prompts").mkdir()
    (root / "prompts" / "a.j2").write_text("a")
    (root / "dcap" / "scene" / "late.py").write_text('FOLDER = "prompts"\ndef late(): return FOLDER\n')
    cloned = found(root)
    assert "prompts/a.j2" in cloned.files
    (root / "dcap" / "_resources").mkdir()
    for name in ("prompts", "materials.csv"):
        (root / name).rename(root / "dcap" / "_resources" / name)
    (root / "materials.csv").write_text("of somebody else")
    assert found(root) == cloned


def test_who_answers_counts() -> None:
    """The code of a stage that asks covers every client, the lexicon and the prompts, not how replies are sent."""
    code_of.cache_clear()
    lexicon = {str(path.relative_to(PROJECT_ROOT)) for path in (PROJECT_ROOT / "dcap/knowledge/lexicon").rglob("*.csv")}
    assert "dcap/knowledge/lexicon/things.csv" in lexicon
    asking = [one for one in STAGES if CLIENT in one.signature.parameters]
    assert len(asking) >= 4
    for one in asking:
        files = set(one.code.files)
        assert files >= lexicon | {"dcap/language/offline/client.py", "dcap/language/model/client.py"}, one.name
        assert "prompts/common.j2" in files
        assert not files & {"dcap/language/model/batch.py", "tasks/cache.py"}


def test_a_file_saved_as_the_program_starts_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody knows which state of it was loaded; one that is saved later is not asked for."""
    path = PROJECT_ROOT / "dcap" / "scene" / "errors.py"
    code.code_at_begin.cache_clear()
    monkeypatch.setattr(code, "LOADED_NS", path.stat().st_mtime_ns - 1)
    with pytest.raises(StoreError, match=r"has changed while this program started"):
        code.code_at_begin((PROJECT_ROOT / "tasks/cache.py",))
    code_of(PROJECT_ROOT / "tasks/cache.py")


def test_a_data_file_that_changes_while_a_stage_reads_it_is_refused(root: Path) -> None:
    """It is read when the stage runs, so its result is not kept."""
    one = found(root)
    code.check_data_files(one, root)
    (root / "dcap/scene/late.py").write_text("def late(): return 9\n")
    code.check_data_files(one, root)
    (root / "materials.csv").write_text("foam,31\n")
    with pytest.raises(StoreError, match=r"materials.csv has changed while this program runs"):
        code.check_data_files(one, root)

"""No package of ours reads files in a way that could run what is in them."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("dcap", "tasks", "solver", "flows")
PICKLES = {
    "pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "jsonpickle", "torch",
    "multiprocessing",
}  # fmt: skip
"""Modules that read pickles, or move objects as such."""
READERS = {"np.load", "numpy.load", "np.lib.npyio.NpzFile", "pd.read_pickle"}
RUNNERS = {"eval", "exec", "os.system", "os.popen"}
UNPACKERS = {"extractall", "extract", "unpack_archive"}
"""Methods that write where an archive says."""


Node = ast.Call | ast.Import | ast.ImportFrom | ast.Constant


@cache
def nodes() -> tuple[tuple[str, Node], ...]:
    """Calls, imports and constants of our code and where they are."""
    found: list[tuple[str, Node]] = []
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        name = str(path.relative_to(ROOT))
        found += [
            (f"{name}:{node.lineno}", node)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, Node)
        ]
    return tuple(found)


@cache
def called() -> tuple[tuple[str, str, ast.Call], ...]:
    """Calls of functions by a plain or dotted name: where, the name, the call."""
    plain = ast.Name | ast.Attribute
    return tuple(
        (where, ast.unparse(node.func), node)
        for where, node in nodes()
        if isinstance(node, ast.Call) and isinstance(node.func, plain)
    )


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    """Calls of functions or methods by their last name or dotted one."""
    return ((where, call) for where, name, call in called() if name in names or name.rpartition(".")[2] in names)


def keyword(call: ast.Call, name: str) -> object:
    """The constant value of a keyword argument; None where it is not given."""
    found = next((one.value for one in call.keywords if one.arg == name), None)
    return found.value if isinstance(found, ast.Constant) else None


def imported(node: ast.AST) -> list[str]:
    """First parts of the modules that a statement imports."""
    if isinstance(node, ast.Import):
        return [one.name.partition(".")[0] for one in node.names]
    return [(node.module or "").partition(".")[0]] if isinstance(node, ast.ImportFrom) and not node.level else []


def test_no_pickle_is_read() -> None:
    """No module that unpickles is imported but for the pipes to our own processes, and numpy is told each time not
    to."""
    found = [(where, name) for where, node in nodes() for name in imported(node) if name in PICKLES]
    assert [one for one in found if not (one[0].startswith("tasks/process.py") and one[1] == "multiprocessing")] == []
    loads = [(where, call) for where, call in calls("load") if ast.unparse(call.func) in READERS]
    assert len(loads) >= 2
    assert [where for where, call in loads if keyword(call, "allow_pickle") is not False] == []


def test_yaml_is_loaded_as_plain_values() -> None:
    """Every YAML reader is a safe one, and none is the module's own function, which makes objects."""
    made = list(calls("YAML"))
    assert made
    assert [where for where, call in made if keyword(call, "typ") != "safe"] == []
    assert [where for where, node in nodes() if "yaml" in imported(node)] == []
    assert [where for where, _ in calls("unsafe_load", "full_load", "yaml.unsafe_load")] == []


def test_templates_are_sandboxed_and_from_files_and_pages_escape() -> None:
    """Every environment is a sandboxed one over our own folders; those of pages escape; no text becomes a template."""
    assert list(calls("Environment", "NativeEnvironment", "Template", "from_string")) == []
    made = list(calls("SandboxedEnvironment"))
    assert len(made) == 5
    prompts = "dcap/language/model/payload.py"
    assert [where for where, call in made if (keyword(call, "autoescape") is True) == where.startswith(prompts)] == []
    assert [where for where, call in made if "FileSystemLoader" not in ast.unparse(call)] == []
    pages = [path for package in PACKAGES for path in (ROOT / package).rglob("*.j2")]
    assert len(pages) > 5
    assert [path.name for path in pages if re.search(r"\|\s*safe|Markup|autoescape false", path.read_text())] == []


@pytest.mark.parametrize("names", [RUNNERS, UNPACKERS])
def test_nothing_runs_or_unpacks_by_what_a_file_says(names: set[str]) -> None:
    """No evaluation of text, no shell, and no archive that says where its files go."""
    found = [where for where, call in calls(*names) if ast.unparse(call.func) in RUNNERS or names is UNPACKERS]
    assert found == []
    assert [where for where, node in nodes() if isinstance(node, ast.Call) and keyword(node, "shell") is True] == []


def test_no_server_listens_everywhere_by_itself() -> None:
    """The address of all interfaces stands in our code only where requests to it are told from others."""
    everywhere = {"0.0.0.0", "::"}
    found = {
        where.partition(":")[0]
        for where, node in nodes()
        if isinstance(node, ast.Constant) and node.value in everywhere
    }
    assert found == {"flows/own_requests.py"}

"""A working directory whose files bear the names of our packages and of libraries."""

from pathlib import Path

OURS = ("tasks.py", "solver.py", "flows/__init__.py")
LIBRARIES = ("dcap.py", "prefect.py", "numpy.py", "pydantic.py", "taichi.py", "json.py", "uvicorn.py")


def foreign_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """Files of these names that leave a mark beside themselves and break whoever imports them."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"open({str(folder / 'mark')!r}, 'a').write({name!r})\nraise SystemExit('a foreign {name}')\n")
    return folder


def marks(folder: Path) -> str:
    """The names of the files that were run."""
    return (folder / "mark").read_text() if (folder / "mark").exists() else ""

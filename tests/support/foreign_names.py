"""A working directory whose files bear the names of our packages, of libraries and of Prefect's settings."""

from pathlib import Path

OURS = ("tasks.py", "solver.py", "flows/__init__.py")
LIBRARIES = ("dcap.py", "prefect.py", "numpy.py", "pydantic.py", "taichi.py", "json.py", "uvicorn.py")

LOGGING = "logging.yml"
SETTINGS = {
    ".env": f"PREFECT_LOGGING_CONFIG_PATH={LOGGING}\n",
    "prefect.toml": f'[logging]\nconfig_path = "{LOGGING}"\n',
    "pyproject.toml": f'[tool.prefect.logging]\nconfig_path = "{LOGGING}"\n',
}
"""Files that Prefect reads where a program starts, and what has it run a file for Python's logging."""


def foreign_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """Files of these names that leave a mark beside themselves and break whoever imports them."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"open({str(folder / 'mark')!r}, 'a').write({name!r})\nraise SystemExit('a foreign {name}')\n")
    (folder / LOGGING).write_text(
        f"version: 1\nformatters: {{mark: {{(): builtins.open, file: {folder / 'mark'}, mode: a}}}}\n"
        "handlers: {}\nloggers: {}\n"
    )
    for name, text in SETTINGS.items():
        (folder / name).write_text(text)
    return folder


def marks(folder: Path) -> str:
    """The names of the files that were run; for one of logging, that it was."""
    return (folder / "mark").read_text() or LOGGING if (folder / "mark").exists() else ""

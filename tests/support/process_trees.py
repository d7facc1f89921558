"""What processes a process has started."""

from pathlib import Path


def descendants(pid: int) -> list[int]:
    """A process and those that it has started, with theirs, whatever session they lead."""
    found = [pid]
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) in found:
            found.append(int(stat.parent.name))
    return found

"""Outcomes of the same samples by several solvers or methods: a Markdown table with a row per sample.

python -m perf.solvers FIRST OTHER... [--names tl,mls]

Each is a run of one data set (`dcap benchmark --solver mls`, `--methods paper`). A cell has the depth of the object in
its support, the area of its contacts, and the time of the drop, as a ratio to that of FIRST; or the outcome, if a
sample did not come to rest on the support of FIRST. Lines below count verdicts and supports equal to those of FIRST,
and give the medians over samples that rest on the same support, and the largest distance of a force from a surface;
depths are compared where FIRST has at least LEAST_DEPTH.
"""

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from dcap.evaluation.methods import split_id
from dcap.evaluation.run_folder import sample_folder
from flows.find_run import RUN, find_run

LEAST_DEPTH = 1e-4
"""Depths below this [m] are those of the contact's own penetration."""


@dataclass(frozen=True, slots=True)
class Ending:
    """Outcome of one sample."""

    verdict: str
    """at_rest, or the reason of an infeasible sample, or `failed`."""
    support: str
    depth: float
    """[m]; 0 without an indentation."""
    seconds: float
    """Time of the drop [s]."""
    area: float = 0.0
    """Of the contacts [m^2]."""
    gap: float = 0.0
    """Distance of forces from a surface, from the proof; infinite without one [m]."""

    @property
    def at_rest(self) -> bool:
        """Whether it came to rest."""
        return self.verdict == "at_rest"


def endings(folder: Path) -> dict[str, Ending]:
    """Return the outcome of each sample of a run, by the sample's id without its method."""
    found = {}
    for sample in json.loads((folder / RUN).read_bytes())["samples"]:
        path = sample_folder(folder, sample["id"]) / "placement.json"
        tree = json.loads(path.read_bytes()) if path.is_file() else None
        found[split_id(sample["id"])[1]] = Ending("failed", "", 0.0, 0.0) if tree is None else ending_of(tree)
    return found


def ending_of(tree: Mapping[str, Any]) -> Ending:
    """Return the outcome in a placement.json."""
    base = f"{(tree['base'] or {}).get('label', '')} {tree['part'] or ''}".strip()
    placement = (tree["certificate"] or {}).get("placement") or {}
    return Ending(
        tree["reason"] or tree["verdict"],
        base,
        float(placement.get("indentation_m") or 0.0),
        float(tree["timings"].get("drop", 0.0)),
        sum(float(one["area_m2"]) for one in tree["contacts"]),
        float(((tree["certificate"] or {}).get("proof") or {"gap_m": {"value": math.inf}})["gap_m"]["value"]),
    )


def rows(runs: Sequence[Mapping[str, Ending]]) -> list[list[str]]:
    """Return a row of cells for each sample that rests by the first run."""
    out = []
    for name, first in runs[0].items():
        if first.at_rest:
            out.append([name, first.support, f"{measures(first)}, {first.seconds:.0f} s"])
            out[-1] += [cell(first, run[name]) for run in runs[1:] if name in run]
    return out


def cell(first: Ending, other: Ending) -> str:
    """Return a sample's cell for another run."""
    if not other.at_rest:
        return other.verdict
    if other.support != first.support:
        return f"on {other.support}"
    ratio = f"{other.seconds / first.seconds:.1f}" if first.seconds > 0.0 else "-"
    return f"{measures(other)}, x {ratio}"


def measures(one: Ending) -> str:
    """Return depth and area in words."""
    return f"{1e3 * one.depth:.2f} mm, {1e4 * one.area:.1f} cm2"


def summary(first: Mapping[str, Ending], other: Mapping[str, Ending], name: str) -> str:
    """Return the line of a run below the table."""
    rest = {key: one for key, one in first.items() if one.at_rest and key in other}
    same = {key: one for key, one in rest.items() if other[key].at_rest and other[key].support == one.support}
    deep = [abs(other[key].depth / one.depth - 1.0) for key, one in same.items() if one.depth >= LEAST_DEPTH]
    times = [other[key].seconds / one.seconds for key, one in same.items() if one.seconds > 0.0]
    refused = sum(not one.at_rest for one in first.values())
    alike = sum(other[key].verdict == one.verdict for key, one in first.items() if not one.at_rest and key in other)
    depth = f"{median(deep):.1%} over {len(deep)} samples" if deep else "none to compare"
    time = f"{median(times):.1f}" if times else "-"
    return (
        f"{name}: {sum(other[key].at_rest for key in rest)} of {len(rest)} at rest, {len(same)} on the same support; "
        f"{alike} of {refused} others with the same reason; median difference of depth {depth}; "
        f"median ratio of the drop's time {time}; forces at most "
        f"{1e3 * max((other[key].gap for key in same), default=0.0):.2f} mm from a surface"
    )


def main() -> None:
    """Print the table and the lines."""
    parser = argparse.ArgumentParser(description="Outcomes of the same samples by several solvers or methods.")
    parser.add_argument("runs", nargs="+", help="runs of one data set; the others are compared with the first")
    parser.add_argument("--names", default="", help="their names, comma-separated")
    given = parser.parse_args()
    folders = [find_run(one) for one in given.runs]
    names = given.names.split(",") if given.names else [one.name for one in folders]
    runs = [endings(one) for one in folders]
    lines = [["sample", "support", *names], ["---"] * (2 + len(names)), *rows(runs)]
    text = [f"| {' | '.join(cells)} |" for cells in lines]
    text += ["", *(summary(runs[0], run, name) for name, run in zip(names[1:], runs[1:], strict=True))]
    sys.stdout.write("\n".join(text) + "\n")


if __name__ == "__main__":
    main()

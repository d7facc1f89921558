"""Costs of a run: seconds by stage and method, measured when each stage was computed."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import mean, median

from dcap.evaluation.run_page.tables import NOTHING, ShownTable

Timings = Mapping[str, float]
"""Seconds by stage of one placement."""


def costs_table(timings: Mapping[str, Sequence[Timings]], names: Mapping[str, str]) -> ShownTable | None:
    """Median and mean seconds of each stage and in total, by method; None if nothing is known.

    Args:
        timings: of each method's placements.
        names: shown names of the methods.
    """
    seconds: dict[str, dict[str, list[float]]] = {}
    for method, placements in timings.items():
        own = defaultdict(list)
        for one in placements:
            for stage, value in one.items():
                own[stage].append(value)
        seconds[method] = own
    stages = list(dict.fromkeys(stage for own in seconds.values() for stage in own))
    if not stages:
        return None
    totals = {method: [sum(one.values()) for one in own] for method, own in timings.items()}
    rows = [(stage, *(spent(seconds[method].get(stage, [])) for method in timings)) for stage in stages]
    rows.append(("a placement", *(spent(totals[method]) for method in timings)))
    rows.append(("all placements", *(f"{sum(totals[method]):.1f}" for method in timings)))
    return ShownTable(
        "Times", ("stage [s]", *(names[method] for method in timings)), tuple(rows), (),
        "Median (mean) seconds of n placements. A stage that several methods share counts in each, "
        "with the time that it once took.",
    )  # fmt: skip


def spent(values: Sequence[float]) -> str:
    """Median, mean and count."""
    return f"{median(values):.2f} ({mean(values):.2f}), n {len(values)}" if values else NOTHING


def timings_of(tree: Mapping[str, object]) -> Timings:
    """The stage times in a placement.json."""
    found = tree.get("timings")
    pairs = found.items() if isinstance(found, Mapping) else ()
    return {str(name): float(value) for name, value in pairs if isinstance(value, int | float)}

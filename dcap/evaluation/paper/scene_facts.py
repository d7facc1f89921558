"""Facts of an evaluation's scenes: their meshes, their deformable supports, and figure 3 in both of its counts.

In: facts of each scene. Out: `tables/dataset.csv|tex`, `tables/figure3.csv|tex`, `figures/deformable_supports.png` and
`figures/deformable_materials.png`. Two counts: labelled supports that give way, and the different deformable materials
of the parts of all supports, which is how we read the paper's figure 3.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.run_page.tables import ShownTable
from dcap.evaluation.supports_plot import MATERIALS, SUPPORTS, save_supports_plot, summary
from dcap.evaluation.supports_table import is_support
from dcap.evaluation.table_files import TABLES, csv_of, table_links, tex_escaped, write_table
from dcap.language.offline.kinds import deformable_materials, deformable_supports

DATASET, FIGURE3 = "dataset", "figure3"
FIGURES = {SUPPORTS: "figures/deformable_supports.png", MATERIALS: "figures/deformable_materials.png"}


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """One scene after the stages that read it."""

    scene: str
    """Its name, or path."""
    mesh: str
    """Origin of its mesh: given, SuGaR, or reconstructed from the splats."""
    file: str
    """Path of that mesh, or of the splats."""
    faces: int
    open_edges: int
    """Edges of the mesh without an opposite; 0: it is closed [-]."""
    things: tuple[tuple[str, tuple[str, ...]], ...]
    """Label and names of the parts of each instance."""

    @property
    def supports(self) -> list[tuple[str, tuple[str, ...]]]:
        """Instances that can carry things."""
        return [(label, parts) for label, parts in self.things if is_support(label)]

    @property
    def kinds(self) -> Counter[str]:
        """Deformable supports by kind."""
        return deformable_supports(label for label, _ in self.things)

    @property
    def materials(self) -> Counter[str]:
        """Deformable materials of its supports, each counted once."""
        return Counter(dict.fromkeys(deformable_materials(self.supports), 1))


@dataclass(frozen=True, slots=True)
class ShownFigure:
    """One count of figure 3."""

    title: str
    path: str
    """Relative to the run."""
    words: str


def write_scene_facts(run: Path, scenes: Sequence[SceneFacts]) -> tuple[list[ShownTable], list[ShownFigure]]:
    """Write tables and figures into a run, and return them for its page; nothing if no scene could be read."""
    if not scenes:
        return [], []
    tables = [
        written(run, DATASET, "Data set", [dataset_row(one) for one in scenes], dataset_words(scenes)),
        written(run, FIGURE3, "The numbers of figure 3", [figure_row(one) for one in scenes], FIGURE_NOTE),
    ]
    counts = {SUPPORTS: [one.kinds for one in scenes], MATERIALS: [one.materials for one in scenes]}
    figures = []
    for what, found in counts.items():
        save_supports_plot(found, run / FIGURES[what], what)
        figures.append(ShownFigure(f"{what.capitalize()} per scene", FIGURES[what], summary(found)))
    return tables, figures


FIGURE_NOTE = (
    "deformable: E of the usual material is at most 1 GPa. Materials: different ones among the parts of all supports. "
    "Both follow from labels and parts by the lexicon; nothing is measured."
)


def dataset_words(scenes: Sequence[SceneFacts]) -> str:
    """Content of the data set, in a line."""
    sources = Counter(one.mesh for one in scenes)
    closed = sum(one.open_edges == 0 for one in scenes)
    return (
        f"{len(scenes)} scenes; meshes: {', '.join(f'{count} {name}' for name, count in sorted(sources.items()))}; "
        f"{closed} closed as a whole"
    )


def dataset_row(one: SceneFacts) -> Mapping[str, object]:
    """The mesh of a scene."""
    return {
        "scene": one.scene, "mesh": one.mesh, "file": one.file, "faces": one.faces, "open_edges": one.open_edges,
        "instances": len(one.things), "supports": len(one.supports),
    }  # fmt: skip


def figure_row(one: SceneFacts) -> Mapping[str, object]:
    """Both counts of a scene, and the counted things."""
    return {
        "scene": one.scene, "supports": len(one.supports), "deformable_supports": one.kinds.total(),
        "deformable_materials": one.materials.total(), "kinds": listed(one.kinds), "materials": " ".join(one.materials),
    }  # fmt: skip


def listed(kinds: Counter[str]) -> str:
    """Kinds with their numbers."""
    return "; ".join(f"{count} {kind}" for kind, count in kinds.most_common())


def written(run: Path, name: str, title: str, rows: Sequence[Mapping[str, object]], note: str) -> ShownTable:
    """Write a table into a run, and return it for the page."""
    head = tuple(rows[0])
    cells = [tuple(str(row[column]) for column in head) for row in rows]
    write_table(run / TABLES, name, csv_of(rows), tex_of(head, cells))
    return ShownTable(title, tuple(one.replace("_", " ") for one in head), tuple(cells), table_links(name), note)


def tex_of(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in LaTeX."""
    lines = [" & ".join(tex_escaped(cell) for cell in row) + " \\\\" for row in (head, *rows)]
    lines.insert(1, "\\hline")
    return (
        "\n".join([f"\\begin{{tabular}}{{{'l' * len(head)}}}", "\\hline", *lines, "\\hline", "\\end{tabular}"]) + "\n"
    )

"""ScanNet folders: instances by segments, alignment, scenes of the test set, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dcap.language.offline.client import OfflineClient
from dcap.scene.checks.findings import Findings
from dcap.scene.checks.scene_folder import check_scene, layout_of
from dcap.scene.errors import InputError, Severity
from dcap.scene.readers.frame import Role
from dcap.scene.readers.scenes.scannet import is_scannet
from dcap.scene.readers.source import read_scan
from dcap.scene.readers.source_files import source_files, telling_folder
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.meshes import write_ply
from tasks.mesh.stage import cleaned
from tasks.segment.stage import SegmentConfig, segment

SCENE = "scene0007_01"
TURN = np.array([[0.6, 0.8, 0, 1.0], [-0.8, 0.6, 0, -2.0], [0, 0, 1, 0.05], [0, 0, 0, 1]])
"""An alignment: a turn about z and a shift."""


def plate(low: tuple[float, float, float], size: tuple[float, float], cells: int) -> Mesh:
    """A level square of triangles."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    points = np.stack([low[0] + size[0] * u.ravel(), low[1] + size[1] * v.ravel(), np.full(u.size, low[2])], axis=1)
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.stack([i, i + cells + 1, i + cells + 2, i + 1], axis=1)
    return Mesh.of(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), (90, 120, 60))


PIECES = (
    ("floor", plate((0, 0, 0), (4, 4), 20)),
    ("Chair", plate((0.5, 0.5, 0.45), (0.4, 0.4), 4)),
    ("chair", plate((1.0, 0.5, 0.45), (0.4, 0.4), 4)),
    ("", plate((3.0, 3.0, 0.7), (0.5, 0.5), 4)),
    ("coffee table", plate((2.0, 2.0, 0.4), (0.8, 0.5), 6)),
)
"""What a small room holds; the fourth thing is not annotated."""


def write_scene(
    folder: Path, change: Callable[[dict[str, Any], dict[str, Any]], object] = lambda segments, groups: None,
    about: str = "", annotated: bool = True,
) -> tuple[Path, Mesh, NDArray[np.int64]]:  # fmt: skip
    """A scene folder of `PIECES`, two segments each; returns it, the mesh as scanned and the piece of each vertex."""
    folder.mkdir(exist_ok=True)
    mesh = Mesh.concatenate([piece for _, piece in PIECES])
    piece = np.repeat(np.arange(len(PIECES)), [len(m.vertices) for _, m in PIECES])
    half = np.concatenate([np.arange(len(m.vertices)) % 2 for _, m in PIECES])
    segments: dict[str, Any] = {"params": {}, "sceneId": SCENE, "segIndices": (1000 + 10 * piece + half).tolist()}
    groups: dict[str, Any] = {
        "sceneId": f"scannet.{SCENE}", "segmentsFile": f"scannet.{SCENE}_vh_clean_2.0.010000.segs.json",
        "segGroups": [
            {"id": i, "objectId": i, "segments": [1000 + 10 * i, 1001 + 10 * i], "label": label}
            for i, (label, _) in enumerate(PIECES) if label
        ],
    }  # fmt: skip
    change(segments, groups)
    write_ply(folder / f"{SCENE}_vh_clean_2.ply", mesh)
    write_ply(folder / f"{SCENE}_vh_clean_2.labels.ply", mesh)
    if annotated:
        (folder / f"{SCENE}_vh_clean_2.0.010000.segs.json").write_text(json.dumps(segments))
        (folder / f"{SCENE}.aggregation.json").write_text(json.dumps(groups))
    numbers = " ".join(f"{x:.6f}" for x in TURN.ravel())
    (folder / f"{SCENE}.txt").write_text(
        about or f"colorHeight = 968\naxisAlignment = {numbers}\nnumDepthFrames = 10\n"
    )
    (folder / f"{SCENE}.sens").write_bytes(b"recording")
    return folder, mesh, piece


def scan_of(folder: Path) -> Scan:
    """Read as a scene."""
    return read_scan(folder, SourceOptions(), Role.SCENE)


def test_annotated_instances_arrive_aligned(tmp_path: Path) -> None:
    """Every group is an instance with its own faces; two chairs stay two; what has no group is found by itself."""
    folder, mesh, piece = write_scene(tmp_path / SCENE)
    scan = scan_of(folder)
    assert (scan.up, scan.unit_metres, scan.unit_source) == ("z", 1.0, "format")
    np.testing.assert_allclose(scan.world_from_file, TURN)
    np.testing.assert_allclose(scan.mesh.vertices, mesh.vertices @ TURN[:3, :3].T + TURN[:3, 3], atol=1e-6)
    assert scan.node_names == ("floor_0", "chair_1", "chair_2", "coffee_table_4")
    found = segment(cleaned(scan), SegmentConfig(), OfflineClient())
    assert [(one.id, one.label) for one in found.instances[:4]] == [
        ("floor_0", "floor"), ("chair_1", "chair"), ("chair_2", "chair"), ("coffee_table_4", "coffee table"),
    ]  # fmt: skip
    assert [one.confidence < 1.0 for one in found.instances] == [False] * 4 + [True]  # a guess from the shape
    assert found.instances[0].structure
    own = piece[mesh.faces[:, 0]]
    expected = np.array([0, 1, 2, 4, 3])[own]
    np.testing.assert_array_equal(found.face_instance, expected)


def test_a_face_belongs_to_most_of_its_corners(tmp_path: Path) -> None:
    """With one corner in another segment it stays, with two it goes over."""

    def change(segments: dict[str, Any], groups: dict[str, Any]) -> None:
        segments["segIndices"][0] = 1010  # floor face (0, 21, 22) and (0, 22, 1): one corner of three
        segments["segIndices"][5] = segments["segIndices"][6] = 1010

    folder, mesh, _ = write_scene(tmp_path / SCENE, change)
    scan = scan_of(folder)
    corner = np.isin(mesh.faces, [0, 5, 6]) & (scan.face_node >= 0)[:, None]
    floor = np.arange(len(mesh.faces)) < 800  # 20 x 20 cells
    np.testing.assert_array_equal(scan.face_node[floor] == 1, corner.sum(axis=1)[floor] >= 2)


def test_scenes_without_annotation_are_meshes(tmp_path: Path) -> None:
    """The test set: no aggregation, no alignment; both are said."""
    folder, _, _ = write_scene(tmp_path / SCENE, about="colorHeight = 968\n", annotated=False)
    scan = scan_of(folder)
    np.testing.assert_array_equal(scan.world_from_file, np.eye(4))
    assert scan.node_labels == ()
    assert any("axisAlignment" in note for note in scan.notes)
    assert any("segs.json" in note for note in scan.notes)


def test_only_what_is_read_is_kept(tmp_path: Path) -> None:
    """Recordings, gigabytes each, are no part of the source, and the folder's name is no label."""
    folder, _, _ = write_scene(tmp_path / SCENE)
    name, files = source_files(folder)
    assert name == "."
    assert sorted(files) == [
        f"{SCENE}.aggregation.json",
        f"{SCENE}.txt",
        f"{SCENE}_vh_clean_2.0.010000.segs.json",
        f"{SCENE}_vh_clean_2.ply",
    ]
    assert telling_folder(folder, files) == ""
    assert is_scannet(folder)
    assert not is_scannet(tmp_path)


DEFECTS: list[tuple[Callable[[dict[str, Any], dict[str, Any]], object], str]] = [
    (lambda s, g: s["segIndices"].pop(), "entries, the mesh has"),
    (lambda s, g: s["segIndices"].__setitem__(3, -1), "at 3, expected a whole number"),
    (lambda s, g: s["segIndices"].__setitem__(3, 1.5), "1.5 at 3"),
    (lambda s, g: s["segIndices"].__setitem__(3, 2**70), "at 3, expected"),
    (lambda s, g: s.update(segIndices={}), "segIndices is a dict"),
    (lambda s, g: g["segGroups"][1].update(segments=[7]), "no vertex is in segment 7, which chair_1 names"),
    (lambda s, g: g["segGroups"][1].update(segments="x"), "segments of segGroups[1] is a str"),
    (lambda s, g: g["segGroups"].append(4), "segGroups[4] is a int"),
    (lambda s, g: g.pop("segGroups"), "no list 'segGroups'"),
    (lambda s, g: g["segGroups"][0].update(label="\ud800"), "surrogate"),
]
"""What is broken in the segments and groups, and what is said of it."""


def test_reader_and_check_refuse_what_contradicts_itself(tmp_path: Path) -> None:
    """One line that names the file and the entry, the same of both."""
    missed = []
    for number, (change, words) in enumerate(DEFECTS):
        folder, _, _ = write_scene(tmp_path / str(number), change)
        findings = Findings()
        check_scene(folder, findings)
        told = [f"{one.path}: {one.what}" for one in findings.all() if one.severity is Severity.ERROR]
        with pytest.raises(InputError) as caught:
            scan_of(folder)
        if told != [str(caught.value)] or words not in told[0] or "\n" in told[0]:
            missed.append((words, told, str(caught.value)))
    assert missed == []


def test_a_check_names_all_defects_and_their_lines(tmp_path: Path) -> None:
    """Of the groups, the segments and the alignment; a sound scene gives its labels and nothing to mend."""
    folder, mesh, _ = write_scene(tmp_path / SCENE)
    (layout,) = layout_of(tmp_path, Findings()).scenes
    findings = Findings()
    facts = check_scene(layout, findings)
    assert findings.all() == ()
    assert (facts.labels, facts.faces) == (("floor", "chair", "chair", "coffee table"), len(mesh.faces))
    path = folder / f"{SCENE}.aggregation.json"
    groups = json.loads(path.read_text())
    groups["segGroups"][0]["label"] = ""
    groups["segGroups"][1]["segments"] = [1010, 7]
    groups["segGroups"][2]["segments"][0] = -3
    path.write_text(json.dumps(groups, indent=1))
    (folder / f"{SCENE}.txt").write_text("a = 1\naxisAlignment = 1 2 3\n")
    check_scene(folder, findings)
    lines = path.read_text().splitlines()
    assert [(one.path.suffix, one.line, one.severity) for one in findings.all()] == [
        (".json", 1 + lines.index('   "label": ""'), Severity.WARNING),
        (".json", 1 + lines.index("    7"), Severity.ERROR),
        (".json", 1 + lines.index("    -3,"), Severity.ERROR),
        (".txt", 2, Severity.ERROR),
    ]


@pytest.mark.parametrize(
    ("value", "words"),
    [("1 2 3", "3 values, expected 16"), ("x " * 16, "16 numbers"), ("2 " * 16, "not a rotation"),
     ("nan " * 16, "not a rotation"), ("1e300 " * 16, "not a rotation")],
)  # fmt: skip
def test_an_alignment_is_a_rotation_and_a_shift(tmp_path: Path, value: str, words: str) -> None:
    """Anything else is refused at its line."""
    folder, _, _ = write_scene(tmp_path / SCENE, about=f"a = 1\naxisAlignment = {value}\n")
    with pytest.raises(InputError, match=f"line 2: axisAlignment.*{words}"):
        scan_of(folder)

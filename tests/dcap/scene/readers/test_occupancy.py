"""InteriorGS' maps of the floor: the mirrored columns, the self-check, and files that contradict themselves."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dcap.scene.checks.annotations import check_occupancy
from dcap.scene.checks.findings import Findings
from dcap.scene.errors import FormatError, GeometryError, Severity
from dcap.scene.readers.scenes.interiorgs import read_structure
from dcap.scene.readers.scenes.occupancy import MAX_CELLS, read_occupancy
from dcap.scene.types.floor_plan import FREE, OCCUPIED, UNKNOWN, Occupancy
from dcap.scene.types.scan import Room
from dcap.scene.writers.interiorgs import write_interiorgs
from dcap.synthetic.rooms import BuiltRoom, build_room


@pytest.fixture(scope="module")
def built() -> BuiltRoom:
    return build_room("hall_01", 0)


@pytest.fixture(scope="module")
def folder(built: BuiltRoom, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room")
    write_interiorgs(path, built.record, 0)
    return path


DOCUMENT = {"scale": 0.1, "center": [0, 0, 0], "lower": [-1, -2, 0], "upper": [1.0, 1, 3], "min": [-1, -2, 0]}


def scene(path: Path, cells: np.ndarray, **document: object) -> Path:
    """A folder with a map."""
    Image.fromarray(cells.astype(np.uint8)).save(path / "occupancy.png")
    (path / "occupancy.json").write_text(json.dumps({**DOCUMENT, **document}))
    return path


def some_map() -> np.ndarray:
    """Free within four columns on the left of the picture, all rows."""
    cells = np.full((30, 20), UNKNOWN)
    cells[:, 1:5] = FREE
    return cells


def room(low: tuple[float, float], high: tuple[float, float]) -> Room:
    """A rectangle."""
    return Room("", np.array([low, (high[0], low[1]), high, (low[0], high[1])], dtype=float))


def test_what_the_writer_wrote(built: BuiltRoom, folder: Path) -> None:
    """Read as documented: free in the room but not where something stands, unknown outside."""
    found, notes = read_occupancy(folder, read_structure(folder)[0])
    assert found is not None
    assert notes == ()
    assert found.step[0] < 0 < found.step[1]
    profile = built.record.profile
    assert (found.free & ~found.within([profile])).sum() < 0.001 * found.free.sum()
    middles = np.array([footprint.mean(axis=0) for footprint in built.record.obstacles])
    assert (found.value(middles) == OCCUPIED).all()
    assert (found.value(profile + 5.0 * np.sign(profile - profile.mean(axis=0))) == UNKNOWN).all()
    grid = np.stack(np.meshgrid(*(np.linspace(a + 0.1, b - 0.1, 30) for a, b in zip(profile[0], profile[2],
                    strict=True))), axis=-1).reshape(-1, 2)  # fmt: skip
    blocked = np.zeros(len(grid), dtype=bool)
    for footprint in built.record.obstacles:
        low, high = footprint.min(axis=0) - 0.02, footprint.max(axis=0) + 0.02
        blocked |= ((grid > low) & (grid < high)).all(axis=1)
    assert (found.value(grid[~blocked]) == FREE).all()


@pytest.mark.parametrize(
    ("low", "high", "x", "words"),
    [
        ((0.5, -2.0), (1.0, 1.0), 0.9, None),  # the mirror puts columns 1 to 4 at x = 0.9 to 0.6
        ((-1.0, -2.0), (-0.5, 1.0), -0.9, "unmirrored with cells around"),
        ((0.51, -2.0), (0.88, 1.1), 0.85, "mirrored with cells from"),
        ((-0.88, -2.0), (-0.52, 1.1), -0.85, "unmirrored with cells from"),
        (None, None, 0.9, None),
    ],
)
def test_the_mapping_with_more_free_cells_in_rooms_is_taken(tmp_path: Path, low, high, x, words) -> None:
    """And said, where it is another than the documented one."""
    scene(tmp_path, some_map())
    found, notes = read_occupancy(tmp_path, (room(low, high),) if low else ())
    assert found is not None
    assert found.world(np.array([0]), np.array([1]))[0, 0] == pytest.approx(x)
    assert (words is None and notes == ()) or (
        words is not None and notes[0].startswith(f"occupancy.png is read {words}")
    )


def test_a_map_beside_its_rooms_is_reported(tmp_path: Path) -> None:
    """No free cell in any room: the files do not belong together."""
    _, notes = read_occupancy(scene(tmp_path, some_map()), (room((50, 50), (51, 51)),))
    assert "no free cell inside a room" in notes[0]


def test_scaled_maps_and_missing_files(tmp_path: Path) -> None:
    """Grey levels between the three go to the nearest; half a map is none, and said; none at all is nothing."""
    assert read_occupancy(tmp_path, ()) == (None, ())
    cells = np.array([[0, 60, 70, 127, 180, 200, 255]])
    found, _ = read_occupancy(scene(tmp_path, cells), ())
    assert found is not None
    assert found.cells[0].tolist() == [0, 0, 127, 127, 127, 255, 255]
    (tmp_path / "occupancy.png").unlink()
    missing, notes = read_occupancy(tmp_path, ())
    assert missing is None
    assert notes == ("occupancy.png missing: no map of free places",)


WRONG_DOCUMENTS: tuple[object, ...] = (
    [],
    {},
    {**DOCUMENT, "scale": 50},
    {**DOCUMENT, "scale": -1},
    {**DOCUMENT, "scale": 10**400},
    {**DOCUMENT, "lower": DOCUMENT["upper"]},
    {**DOCUMENT, "lower": [-1, 1.0, 0]},
    {**DOCUMENT, "upper": [1, 1, 3, 1]},
    {**DOCUMENT, "upper": [1, 1, None]},
    {"scale": "x", "lower": 1, "upper": {"x": 1}, "center": None},
    {**DOCUMENT, "scale": float("nan")},
    {**DOCUMENT, "upper": [0, 0, float("inf")]},
)
BROKEN: list[dict[str, bytes]] = [
    *({"occupancy.json": json.dumps(document).encode()} for document in WRONG_DOCUMENTS),
    {"occupancy.json": b'{"scale": 0.1,\n]'},
    {"occupancy.json": b""},
    {"occupancy.json": b"\xff"},
    {"occupancy.png": b""},
    {"occupancy.png": b"GIF89a"},
    {"occupancy.json": b"3", "occupancy.png": b"PNG"},
]  # fmt: skip
USABLE: list[dict[str, object]] = [
    {"lower": [-1, -2], "upper": [1, 1]},
    {"lower": [-1, -2, 9]},
    {"scale": 10},
    {"min": [False, 3, 3], "max": [0, 0, 0], "center": "here"},  # nothing uses them
    {"lower": [-1e308, -2, 0], "upper": [1e308, 1, 0]},
]


def errors(folder: Path) -> list[str]:
    """What the check calls errors, as a reader would say them."""
    findings = Findings()
    check_occupancy(folder, findings)
    return [f"{one.path}: {one.what}" for one in findings.listed if one.severity is Severity.ERROR]


def test_the_first_error_of_a_check_is_what_the_reader_refuses(tmp_path: Path) -> None:
    """One set of rules: a check tells all that is broken, a reader the first in the same words."""
    missed: list[tuple[object, str]] = []
    for files in BROKEN:
        scene(tmp_path, some_map())
        for name, data in files.items():
            (tmp_path / name).write_bytes(data)
        with pytest.raises(FormatError) as caught:
            read_occupancy(tmp_path, ())
        if errors(tmp_path)[0] != str(caught.value):
            missed.append((files, str(caught.value)))
    for document in USABLE:
        scene(tmp_path, some_map(), **document)
        if read_occupancy(tmp_path, ())[0] is None or errors(tmp_path):
            missed.append((document, "not read"))
    assert missed == []


def test_pictures_that_cannot_be(tmp_path: Path) -> None:
    """Too many pixels are refused before they are decoded; so are 16 bits, whose values would be cut."""
    scene(tmp_path, some_map())
    Image.new("1", (8193, 8192)).save(tmp_path / "occupancy.png")
    assert MAX_CELLS < 8193 * 8192
    with pytest.raises(FormatError, match="8193 x 8192 pixels") as caught:
        read_occupancy(tmp_path, ())
    assert errors(tmp_path) == [str(caught.value)]
    Image.fromarray(np.full((4, 4), 60000, np.uint16)).save(tmp_path / "occupancy.png")
    with pytest.raises(FormatError, match="more than 8 bits") as caught:
        read_occupancy(tmp_path, ())
    assert errors(tmp_path) == [str(caught.value)]
    with pytest.raises(GeometryError, match="only 0, 127 and 255"):
        Occupancy(np.full((1, 1), 3, np.uint8), np.zeros(2), np.ones(2))
    with pytest.raises(GeometryError, match="no zero"):
        Occupancy(np.zeros((1, 1), np.uint8), np.zeros(2), np.array([0.0, 1.0]))

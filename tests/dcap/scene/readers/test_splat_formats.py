"""Splats as `.splat`, SPZ and SOG are read as what was encoded, to each format's precision; broken ones are refused."""

import gzip
import json
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from splat_files import sog, sog_parts, splat_records, spz

from dcap.scene.errors import DcapError
from dcap.scene.readers.scenes.sugar import has_only_splats
from dcap.scene.readers.splats.formats import is_splats, read_gaussians
from dcap.scene.readers.splats.splats import read_splats
from dcap.scene.types.gaussians import COEFFICIENTS, DC, Gaussians
from tasks.artifact import Store

SAMPLE_DATA = Path(os.environ.get("DCAP_SAMPLE_DATA") or "absent")
Encoder = Callable[[Gaussians], bytes]
FORMATS: dict[str, Encoder] = {
    "a.splat": splat_records,
    "2.spz": lambda splats: spz(splats, 2),
    "3.spz": lambda splats: spz(splats, 3),
    "1.sog": lambda splats: sog(splats, 1),
    "2.sog": lambda splats: sog(splats, 2),
}
ROTATION_STEP = {
    "a.splat": 1 / 128,
    "2.spz": 1 / 127.5,
    "3.spz": 2**-0.5 / 511,
    "1.sog": 2**0.5 / 255,
    "2.sog": 2**0.5 / 255,
}
"""One step of a component of a quaternion."""


def some(count: int = 100, degree: int = 0) -> Gaussians:
    """Random Gaussians in a room of 4 m, with colours and sizes that every format can say."""
    random = np.random.default_rng(0)
    fields = (
        random.uniform(-2, 2, (count, 3)), random.uniform(-7, 1, (count, 3)), random.standard_normal((count, 4)),
        random.uniform(-5, 5, count), random.uniform(-1.7, 1.7, (count, 3)),
        random.uniform(-0.98, 0.98, (count, 3, COEFFICIENTS[degree])),
    )  # fmt: skip
    return Gaussians(*(np.asarray(one, dtype=np.float32) for one in fields))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("degree", [0, 1, 3])
def test_each_format_gives_back_what_was_encoded(tmp_path: Path, name: str, degree: int) -> None:
    """Every field within half a step of its quantisation; records of 32 bytes have no harmonics."""
    splats = some(degree=degree)
    (tmp_path / name).write_bytes(FORMATS[name](splats))
    read = read_gaussians(tmp_path / name)
    # 12 fractional bits; or 16 bits over the range of ln(1 + |x|), whose inverse is (1 + |x|) <= 3 times as steep
    step = {"spz": 2.0**-12, "sog": 3 * 2 * np.log(3) / 65535}.get(name[2:], 1e-6)
    assert np.abs(read.position - splats.position).max() <= 0.5 * step + 1e-6
    size_step = {"spz": 1 / 16, "sog": 8 / 255}.get(name[2:], 1e-6)
    assert np.abs(read.log_scale - splats.log_scale).max() <= 0.5 * size_step + 1e-5
    color_step = {"spz": 1 / 255 / 0.15, "sog": 3.4 / 255}.get(name[2:], 1 / 255 / DC)
    assert np.abs(read.dc - splats.dc).max() <= 0.5 * color_step + 1e-5
    # logits between -5 and 5 in 255 steps, or opacities; the logistic function is at most 1/4 as steep
    assert np.abs(read.opacity - splats.opacity).max() <= 0.5 * (10 / 4 if name == "1.sog" else 1) / 255 + 1e-5
    q = splats.rotation / np.linalg.norm(splats.rotation, axis=1, keepdims=True)
    p = read.rotation / np.linalg.norm(read.rotation, axis=1, keepdims=True)
    # half a step in each of four components; the one left out, m >= 1/2, is off by sum |q_i| e / m <= 3 e where three
    # are kept, and w of version 2 of SPZ, which may be 0, by the root of twice that
    bound = np.sqrt(4.0 * 1.8 * ROTATION_STEP[name]) if name == "2.spz" else 3.5 * 0.5 * ROTATION_STEP[name]
    assert np.abs(p * np.sign((p * q).sum(axis=1, keepdims=True)) - q).max() <= bound
    if name != "a.splat":
        assert read.rest.shape == splats.rest.shape
        assert np.abs(read.rest - splats.rest).max(initial=0.0) <= 1 / 256 + 1e-5


def test_a_folder_of_sog_is_read_as_its_zip(tmp_path: Path) -> None:
    """By the folder or by its meta.json, whose pictures the store takes along; another meta.json is no splats."""
    splats = some(70, 2)
    (tmp_path / "scan").mkdir()
    for name, data in sog_parts(splats).items():
        (tmp_path / "scan" / name).write_bytes(data)
    (tmp_path / "a.sog").write_bytes(sog(splats))
    meta = tmp_path / "scan" / "meta.json"
    assert has_only_splats(tmp_path / "scan")
    assert np.array_equal(read_gaussians(meta).position, read_gaussians(tmp_path / "a.sog").position)
    store = Store(tmp_path / "store")
    inside = store.folder(store.add_source(meta)) / "files"
    assert {one.name for one in inside.iterdir()} == {one.name for one in meta.parent.iterdir()}
    meta.write_text("{}")
    assert not is_splats(meta)


def in_meta(change: Callable[[dict[str, Any]], object]) -> Encoder:
    """SOG whose meta.json was changed."""

    def encode(splats: Gaussians) -> bytes:
        parts = sog_parts(splats)
        meta = json.loads(parts["meta.json"])
        change(meta)
        parts["meta.json"] = json.dumps(meta).encode()
        path = Path(os.environ["PYTEST_TMP"]) / "x.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in parts.items():
                archive.writestr(name, data)
        return path.read_bytes()

    return encode


BROKEN: dict[str, tuple[str, Encoder, str]] = {
    "records": ("a.splat", lambda s: splat_records(s)[:-1], "not a whole number of records of 32 bytes"),
    "negative size": ("a.splat", lambda s: struct.pack("<6f8B", 0, 0, 0, -1, 1, 1, *[200] * 8), "the scale of splat 0"),
    "no gzip": ("a.spz", lambda s: b"no gzip at all", "not an SPZ file"),
    "new": ("a.spz", lambda s: b"NGSP" + bytes(28), "SPZ of version 4 or later, packed by Zstandard"),
    "version 1": ("a.spz", lambda s: gzip.compress(b"NGSP" + struct.pack("<IIBBBB", 1, 5, 0, 12, 0, 0)), "version 1"),
    "promises": (
        "a.spz",
        lambda s: gzip.compress(b"NGSP" + struct.pack("<IIBBBB", 2, 7_000_000, 0, 12, 0, 0)),
        "ends after 0 bytes where its header promises",
    ),
    "too many": (
        "a.spz",
        lambda s: gzip.compress(b"NGSP" + struct.pack("<IIBBBB", 2, 2**32 - 1, 0, 12, 0, 0)),
        "4294967295 splats > 8000000",
    ),
    "cut": ("a.spz", lambda s: spz(s, 3)[:-40], "ends after"),
    "no zip": ("a.sog", lambda s: b"PK no zip", "cannot be read as a zip file"),
    "count": ("a.sog", in_meta(lambda m: m.update(count=1000)), "means_l.webp has 105 pixels for 1000 Gaussians"),
    "codebook": ("a.sog", in_meta(lambda m: m["scales"].update(codebook=[1.0])), "codebook of scales is"),
    "version 9": ("a.sog", in_meta(lambda m: m.update(version=9)), "SOG of version 9"),
    "missing": ("a.sog", in_meta(lambda m: m["quats"].update(files=["gone.webp"])), "gone.webp is missing"),
    "label": (
        "a.sog",
        in_meta(lambda m: m["shN"].update(files=["shN_centroids.webp", "means_l.webp"])),
        "a label of shN",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_in_one_line(tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which names the file and what is wrong in it."""
    monkeypatch.setenv("PYTEST_TMP", str(tmp_path))
    name, encode, words = BROKEN[case]
    (tmp_path / name).write_bytes(encode(some(degree=1)))
    with pytest.raises(DcapError) as caught:
        read_gaussians(tmp_path / name)
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.third_party
@pytest.mark.skipif(not SAMPLE_DATA.is_dir(), reason="DCAP_SAMPLE_DATA is not set")
@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("file", ["gs_donut_inria/fused.ply", "gs_playbot_sh2/playbot.standard.ply"])
def test_real_splats_go_through_every_format(tmp_path: Path, name: str, file: str) -> None:
    """Real scenes encoded and read: the same Gaussians, centres to a thousandth of the extent."""
    real = read_splats(SAMPLE_DATA / file)
    splats = real.subset(np.arange(0, len(real), 5))
    (tmp_path / name).write_bytes(FORMATS[name](splats))
    read = read_gaussians(tmp_path / name)
    extent = float(np.ptp(splats.position, axis=0).max())
    assert np.abs(read.position - splats.position).max() < 1e-3 * extent
    assert np.abs(read.opacity - splats.opacity).max() < 0.05

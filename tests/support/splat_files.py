"""Files of Gaussian splats as other programs write them, encoded from the formats' documents alone."""

import gzip
import io
import json
import struct
import zipfile
from collections.abc import Mapping

import numpy as np
from PIL import Image

from dcap.scene.types.gaussians import Gaussians

SH = 0.28209479177387814


def splat_records(splats: Gaussians) -> bytes:
    """antimatter15's records: 3 floats, 3 floats, RGBA, quaternion; one by one."""
    rows = []
    for p, s, q, a, c in zip(
        splats.position, splats.log_scale, splats.rotation, splats.opacity, splats.dc, strict=True
    ):  # fmt: skip
        unit = q / np.linalg.norm(q)
        color = [*(255 * (0.5 + SH * c)), 255 * a]
        rows.append(
            struct.pack("<6f", *p, *np.exp(s))
            + bytes(int(np.clip(round(float(v)), 0, 255)) for v in color)
            + bytes(int(np.clip(round(float(128 + 128 * v)), 0, 255)) for v in unit)
        )
    return b"".join(rows)


def spz(splats: Gaussians, version: int, fraction: int = 12) -> bytes:
    """Niantic's SPZ, versions 2 and 3."""
    n = len(splats)
    head = b"NGSP" + struct.pack("<IIBBBB", version, n, splats.degree, fraction, 0, 0)
    fixed = np.rint(splats.position * 2.0**fraction).astype(np.int64)
    positions = b"".join(int(v).to_bytes(3, "little", signed=True) for v in fixed.ravel())
    xyzw = (splats.rotation / np.linalg.norm(splats.rotation, axis=1, keepdims=True))[:, [1, 2, 3, 0]]
    rotations = b"".join(first_three(q) if version == 2 else smallest_three(q) for q in xyzw)
    rest = splats.rest.transpose(0, 2, 1)  # coefficient by coefficient, channels side by side
    return gzip.compress(
        head + positions
        + levels(255 * splats.opacity) + levels(255 * (0.5 + 0.15 * splats.dc)) + levels(16 * (splats.log_scale + 10))
        + rotations + levels(128 + 128 * rest)
    )  # fmt: skip


def levels(values: np.ndarray) -> bytes:
    """Rounded to whole numbers of 0 to 255."""
    return bytes(np.clip(np.rint(values), 0, 255).astype(np.uint8))


def first_three(q: np.ndarray) -> bytes:
    """x, y, z with w not negative."""
    return levels(127.5 * (1 + (q if q[3] >= 0 else -q)[:3]))


def smallest_three(q: np.ndarray) -> bytes:
    """Two bits say which of x, y, z, w is left out; then ten bits each, a sign and nine of size."""
    largest = int(np.argmax(np.abs(q)))
    q = q if q[largest] > 0 else -q
    word = largest
    for i in range(4):
        if i != largest:
            word = word << 10 | (int(q[i] < 0) << 9) | round(float(min(1.0, abs(q[i]) * np.sqrt(2.0)) * 511))
    return word.to_bytes(4, "little")


def picture(pixels: np.ndarray, width: int) -> bytes:
    """Lossless WebP of (n, 4) bytes, row by row, the last row filled up."""
    height = -(-len(pixels) // width)
    full = np.zeros((height * width, 4), np.uint8)
    full[: len(pixels)] = pixels
    out = io.BytesIO()
    Image.fromarray(full.reshape(height, width, 4)).save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


def opaque(columns: np.ndarray) -> np.ndarray:
    """(n, 2 or 3) bytes as red, green, blue and an alpha of 255."""
    out = np.full((len(columns), 4), 255, np.uint8)
    out[:, : columns.shape[1]] = columns
    return out


def sog_parts(splats: Gaussians, version: int = 2, width: int = 7) -> dict[str, bytes]:
    """PlayCanvas' SOG as the files of its folder; every harmonic has its own entry in the palette."""
    n = len(splats)
    squeezed = np.sign(splats.position) * np.log1p(np.abs(splats.position))
    low, high = squeezed.min(axis=0), squeezed.max(axis=0)
    word = np.rint(65535 * (squeezed - low) / (high - low)).astype(np.int64)
    wxyz = splats.rotation / np.linalg.norm(splats.rotation, axis=1, keepdims=True)
    sizes, size_about = coded(splats.log_scale, version)
    colors, color_about = coded(splats.dc, version)
    alpha = np.rint(255 * splats.opacity)
    if version == 1:
        ends = float(splats.logit.min()), float(splats.logit.max())
        alpha = np.rint(255 * (splats.logit - ends[0]) / (ends[1] - ends[0]))
        color_about = {"mins": [*color_about["mins"], ends[0]], "maxs": [*color_about["maxs"], ends[1]]}
    files = {
        "means_l.webp": picture(opaque(word & 255), width),
        "means_u.webp": picture(opaque(word >> 8), width),
        "scales.webp": picture(opaque(sizes), width),
        "quats.webp": picture(np.array([tagged(q) for q in wxyz], np.uint8), width),
        "sh0.webp": picture(np.column_stack([colors, alpha]).astype(np.uint8), width),
    }
    meta: dict[str, object] = {
        "means": {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}
        | ({"shape": [n, 3]} if version == 1 else {}),
        "scales": {**size_about, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {**color_about, "files": ["sh0.webp"]},
    } | ({"version": 2, "count": n} if version == 2 else {})
    if splats.degree:
        more, meta["shN"] = palette(splats, version, width)
        files |= more
    return files | {"meta.json": json.dumps(meta).encode()}


def coded(values: np.ndarray, version: int) -> tuple[np.ndarray, dict[str, list[float]]]:
    """Bytes of values (n, k), and what meta.json says of them: a codebook, or the ends of each column."""
    if version == 2:
        book = np.linspace(values.min(), values.max(), 256)
        return np.abs(values[..., None] - book).argmin(axis=-1).astype(np.uint8), {"codebook": book.tolist()}
    low, high = values.min(axis=0), values.max(axis=0)
    return np.rint(255 * (values - low) / (high - low)).astype(np.uint8), {"mins": low.tolist(), "maxs": high.tolist()}


def tagged(q: np.ndarray) -> list[int]:
    """The smaller three of w, x, y, z and 252 plus the place of the largest."""
    largest = int(np.argmax(np.abs(q)))
    q = q if q[largest] > 0 else -q
    others = [round(float(255 * 0.5 * (1 + np.sqrt(2.0) * q[i]))) for i in range(4) if i != largest]
    return [*others, 252 + largest]


def palette(splats: Gaussians, version: int, width: int) -> tuple[dict[str, bytes], Mapping[str, object]]:
    """Palette and labels of the harmonics, entries in the reverse order of the splats."""
    n, k = len(splats), splats.rest.shape[2]
    low, high = float(splats.rest.min()), float(splats.rest.max())
    levels_ = np.rint(255 * (splats.rest - low) / (high - low)).astype(np.uint8).transpose(0, 2, 1)[::-1]
    entries = np.zeros((-(-n // 64) * 64, k, 3), np.uint8)
    entries[:n] = levels_
    label = np.arange(n)[::-1]
    files = {
        "shN_centroids.webp": picture(opaque(entries.reshape(-1, 3)), 64 * k),
        "shN_labels.webp": picture(opaque(np.column_stack([label & 255, label >> 8])), width),
    }
    book = {"codebook": np.linspace(low, high, 256).tolist(), "count": n, "bands": splats.degree}
    ends = {"mins": low, "maxs": high, "quantization": 8}
    return files, {**(book if version == 2 else ends), "files": list(files)}


def sog(splats: Gaussians, version: int = 2) -> bytes:
    """The same in one zip file."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in sog_parts(splats, version).items():
            archive.writestr(name, data)
    return out.getvalue()

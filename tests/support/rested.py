"""What becomes of an exported scene in MuJoCo."""

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np


def written(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Write files into a folder; returns it."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def drift(model: mujoco.MjModel, seconds: float) -> float:
    """How far the object's centre of mass gets at most from its settled place in so many seconds [m]."""
    data, body = mujoco.MjData(model), model.body("object").id
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    start, most = data.xipos[body].copy(), 0.0
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        most = max(most, float(np.linalg.norm(data.xipos[body] - start)))
    return most

"""A stand-in for SuGaR: a train.py that reads its input and names its output as SuGaR's does."""

import os
import sys
from pathlib import Path

TRAIN = """
import argparse, json, os, pathlib
options = argparse.ArgumentParser()
for name in ("-s", "-c", "-r", "--refinement_time", "--eval"):
    options.add_argument(name)
given = options.parse_args()
assert given.r == "sdf"
cameras = json.load(open(given.c + "cameras.json"))
suffix = "." + os.listdir(os.path.join(given.s, "images"))[0].split(".")[-1]
assert all(os.path.isfile(os.path.join(given.s, "images", c["img_name"] + suffix)) for c in cameras)
assert os.path.isfile(os.path.join(given.c, "point_cloud", "iteration_7000", "point_cloud.ply"))
name = given.s.split("/")[-1]
for kind, file in (("coarse_mesh", "sugarmesh_3Dgs7000_level03_decim1000000.ply"), ("refined_mesh", "sugarfine_x.obj")):
    folder = pathlib.Path("output", kind, name)
    folder.mkdir(parents=True)
    (folder / file).write_text(kind)
"""


def fake_sugar(folder: Path) -> str:
    """Write it into a folder; the PATH on which its `python` is the one that runs the tests."""
    (folder / "train.py").write_text(TRAIN)
    (folder / "bin").mkdir()
    (folder / "bin" / "python").symlink_to(sys.executable)
    return f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"

"""Checks a scene folder of ScanNet: segments, groups and alignment by the rules of their reader."""

from dcap.scene.checks.annotations import read_tree
from dcap.scene.checks.files import FileContents, check_shape
from dcap.scene.checks.findings import Findings
from dcap.scene.problems import warning
from dcap.scene.readers.scenes.scannet import SceneFiles, alignment_of, instances_of, segments_of, vertex_instances


def check_scannet(files: SceneFiles, findings: Findings) -> tuple[FileContents, tuple[str, ...]]:
    """Check the files of a folder that are read; returns the mesh and the labels of the annotated instances."""
    shape = check_shape(files.mesh, findings)
    alignment_of(files, findings.report(files.about or files.mesh))
    if files.segments is None or files.groups is None:
        missing = "segs.json" if files.segments is None else "aggregation.json"
        findings.report(files.mesh)(warning(f"its {missing} is missing: instances are found by shape alone"))
        return shape, ()
    document, tell_segments = read_tree(files.segments, findings)
    segment = None if document is None else segments_of(document, shape.vertices or None, tell_segments)
    document, tell_groups = read_tree(files.groups, findings)
    instances = [] if document is None else instances_of(document, files.segments.name, tell_groups)[0]
    if segment is not None and len(segment):  # else every group would be reported
        vertex_instances(segment, instances, tell_groups)
    return shape, tuple(one.label for one in instances)

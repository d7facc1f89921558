"""Stage segment: from a scan to instances with named parts; for scenes and for the object to be placed.

A scene is divided by its annotated boxes or nodes, otherwise by node names or a single label; the rest of a room is
divided by shape, and a client names each thing. Every instance is then divided into parts that cover it without
overlap; rules propose their names, and a client may choose others. A scene written by a placement already contains all
of this.
"""

from dataclasses import replace

import numpy as np
from pydantic import BaseModel

from dcap.arrays import Mask
from dcap.geometry.segmentation.boxed import Group, boxed_groups
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.named import THING, annotated_parts, named_groups
from dcap.geometry.segmentation.parts.instance_surface import facing_away_from_wall
from dcap.geometry.segmentation.parts.rules import find_parts, make_instance, node_words, object_node_words
from dcap.knowledge.lexicon import names_thing
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.scene.errors import InputError
from dcap.scene.text import readable
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import GivenLabels, Instance, Segmentation, SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.segment.given_things import given_groups
from tasks.segment.part_names import with_part_names
from tasks.segment.room_labels import known_scene, labelled_room

LEAST_FACES = 2
"""Instances with fewer faces are left out."""


class SegmentConfig(BaseModel, frozen=True, extra="forbid"):
    """The language client for names that the source does not give."""

    language: LanguageConfig = LanguageConfig()


def segment(
    scan: Scan, config: SegmentConfig, client: Client, labels: GivenLabels | None = None
) -> SegmentedScene:  # fmt: skip
    """Divide a scene into instances and parts; `labels` replace those of the source."""
    if scan.earlier is not None:
        if labels is not None:
            raise InputError(f"--labels {labels.source}: the scene was written by a placement, with its names; omit it")
        return SegmentedScene(known_scene(scan, scan.earlier))
    table = FaceTable.of(scan.mesh)

    def taken_apart(inside: Mask) -> list[Group]:  # the client is asked only if there is a room to divide
        return labelled_room(scan.mesh, table, inside, client)

    given = None if labels is None else given_groups(scan, table, labels, taken_apart)
    if given is not None:
        groups = given.groups
    elif scan.boxes:
        groups = boxed_groups(table, scan.boxes)
    else:
        groups = named_groups(table, scan, taken_apart, names_thing)
    groups = [g for g in groups if len(g.faces) >= min(LEAST_FACES, len(scan.mesh.faces))]
    face_instance = np.full(len(scan.mesh.faces), -1, dtype=np.int32)
    face_part = np.full(len(scan.mesh.faces), -1, dtype=np.int32)
    instances = []
    for index, group in enumerate(groups):
        instance, part = make_instance(
            group.id, group.label, table, group.faces, group.axes,
            node_words(scan.node_names, scan.face_node, group.faces) if scan.node_names else [],
            given.parts.get(group.id) if given is not None else annotated_parts(scan, group.faces),
        )  # fmt: skip
        box = instance.box if group.stands_at is None else instance.box.down_to(group.stands_at)
        instances.append(replace(instance, box=box, confidence=group.confidence, guesses=group.guesses))
        face_instance[group.faces] = index
        face_part[group.faces] = part
    notes = given.notes if given is not None else ()
    walls = [one for one in instances if one.structure and one.label == "wall"]
    fronted = (
        one if one.front is not None else replace(one, front=facing_away_from_wall(one, walls)) for one in instances
    )
    found = Segmentation(scan.mesh, tuple(fronted), face_instance, face_part, notes)
    return SegmentedScene(with_part_names(found, client))


segment_task = stage(segment)


def segment_object(scan: Scan, config: SegmentConfig, client: Client) -> SegmentedObject:
    """The object as one instance with the id 'object'."""
    table = FaceTable.of(scan.mesh)
    faces = np.arange(len(scan.mesh.faces))
    label = readable(scan.label) or THING
    words = object_node_words(scan.node_names, scan.face_node, faces) if scan.node_names else []
    part, parts, box, front = find_parts(table, faces, label, None, words, as_object=True)
    instance = Instance("object", label, box, parts, front)
    found = Segmentation(
        scan.mesh, (instance,), np.zeros(len(faces), dtype=np.int32), part, unit_source=scan.unit_source
    )
    return SegmentedObject(with_part_names(found, client))


segment_object_task = stage(segment_object)

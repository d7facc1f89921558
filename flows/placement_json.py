"""Content of placement.json, from the results of a placement's stages."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.evaluation.metrics.right_place import part_missed, region_missed
from dcap.scene.errors import InputError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.materials import PartMaterial, PartMaterials
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.outcome import Cause, Caution, Infeasible, about, cautions, explanations
from dcap.scene.types.particles import Particles
from dcap.scene.types.pictures import Renders, Visibility
from dcap.scene.types.scan import BodyGeometry, Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import LastState, PlacementChecks, Settled, SettledBody
from dcap.scene.written_files import JsonObject, object_to_json, sorted_keys, to_json
from flows.sample_run import FinishedSample
from solver.certificate import Certificate, Verdict
from tasks.render.particle_table import settled_materials

AT_REST, AS_POSED = "at_rest", "as_posed"
SCHEMA_VERSION = 1
"""Version of the keys of placement.json: keys are only added within a version."""


@dataclass(frozen=True, slots=True)
class FinalState:
    """Values behind an object that came to rest, or was posed."""

    scene: Segmentation
    item: Segmentation
    anchor: Anchor
    settled: Settled

    @property
    def body(self) -> SettledBody:
        """The placed object."""
        return self.settled.bodies[0]


@dataclass(frozen=True, slots=True)
class Values:
    """Results of the stages, as far as they got."""

    scan: Scan | None
    object_scan: Scan | None
    scene: Segmentation | None
    item: Segmentation | None
    intent: Intent | None
    anchor: Anchor | None
    materials: PartMaterials | None
    particles: Particles | None
    settled: Settled | None
    renders: Renders | None
    infeasible: Infeasible | None
    scene_surface: SourceSurface = field(default_factory=SourceSurface.untextured)
    object_surface: SourceSurface = field(default_factory=SourceSurface.untextured)

    @property
    def final(self) -> FinalState | None:
        """The final state; None without one."""
        scene, item, anchor, settled = self.scene, self.item, self.anchor, self.settled
        if scene is None or item is None or anchor is None or settled is None or not settled.bodies:
            return None
        return FinalState(scene, item, anchor, settled)

    @property
    def reason(self) -> str:
        """Why there is no result."""
        return self.infeasible.reason.value if self.infeasible else "nothing settled"

    def need_final(self, lacks: str) -> FinalState:
        """The final state. Without one, InputError of `lacks` and the reason."""
        if (found := self.final) is None:
            raise InputError(f"{lacks}: {self.reason}")
        return found


def visibility_of(found: Visibility) -> JsonObject:
    """Visibility of the object from the views around it and from the room."""
    views = found.views
    return object_to_json(
        {
            "canonical_best": float(views[:, 2].max()),
            "canonical_mean": float(views[:, 2].mean()),
            "recognisability": float(views[:, 3].max()),
            "from_the_room": found.from_the_room,
            "views": [
                {"azimuth_deg": a, "elevation_deg": e, "visible_fraction": v, "outline_fraction": o}
                for a, e, v, o in views.tolist()
            ],
        }
    )


def placement_json(finished: FinishedSample, values: Values, artifacts: Mapping[str, str]) -> JsonObject:
    """The content of placement.json."""
    intent, anchor, settled = values.intent, values.anchor, values.settled
    body = object_body(settled)
    last, (verdict, reason) = last_state(values), verdict_of(values)
    missed, messages = None, messages_of(values)
    if anchor and settled and body:
        missed = region_missed(support_point(settled, body), anchor.region_polygon) or off_its_part(values)
        if missed:
            messages.append(Caution(Cause.NOT_MET, f"it rests outside of {region_words(anchor, values.intent)}"))
    tree = {
        "schema": SCHEMA_VERSION,
        "verdict": verdict,
        "reason": reason,
        "message": values.infeasible.message if values.infeasible else None,
        "prompt": finished.sample.prompt,
        "base": base_of(values),
        "candidates": list(intent.candidates) if intent else [],
        "part": anchor.part if anchor else None,
        "region": anchor.region if anchor else None,
        "region_missed": missed,
        "scale": intent.scale if intent else None,
        "mass": mass_of(values),
        "world_from_file": values.scan.world_from_file if values.scan else None,
        "object_from_file": values.object_scan.world_from_file if values.object_scan else None,
        "pre_drop": pose_of(anchor.world_from_object) if anchor else None,
        "pose": pose_of(body.world_from_start @ anchor.world_from_object) if anchor and body else None,
        "object_aabb": body.surface.bounds if body else None,
        "contacts": [sorted_keys(object_to_json(row)) for row in last.contacts] if last else [],
        "materials": [material_row(row) for row in values.materials.rows] if values.materials else [],
        "geometry": [geometry_row(one) for one in values.particles.geometry] if values.particles else [],
        "soft_bodies": [object_to_json(row) for row in settled_materials(settled)] if settled else [],
        "certificate": certificate_of(values),
        "visible_fraction": values.renders.visible_fraction if values.renders else None,
        "visibility": visibility_of(values.renders.visibility) if values.renders else None,
        "warnings": cautions(messages),
        "notes": explanations(messages),
        "timings": timings_of(finished),
        "artifacts": artifacts,
    }
    return object_to_json(tree)


def region_words(anchor: Anchor, intent: Intent | None) -> str:
    """The intended place of the object, in the words of the sentence where it names one."""
    words = intent.region.words if intent else ""
    return repr(words) if words else f"the {anchor.region} of the {anchor.part}"


def off_its_part(values: Values) -> bool:
    """Whether the sentence names a part, and the object was set down on it but came to rest on another one."""
    scene, intent, anchor, settled = values.scene, values.intent, values.anchor, values.settled
    body = object_body(settled)
    if not (scene and intent and anchor and settled and body) or intent.region.part != anchor.part or anchor.lean:
        return False
    return part_missed(scene, anchor.base_id, anchor.part, settled.contact_points, float(body.surface.bounds[1, 2]))


def base_of(values: Values) -> dict[str, str] | None:
    """Support of the object: the anchor's instance (perhaps a rug on the requested floor), else the requested one."""
    intent, anchor = values.intent, values.anchor
    if anchor and values.scene:
        return {"id": anchor.base_id, "label": values.scene.instances[values.scene.index_of(anchor.base_id)].label}
    return {"id": intent.base_id, "label": intent.base_label} if intent else None


def mass_of(values: Values) -> float | None:
    """Simulated mass [kg], or the prior if nothing was simulated."""
    if values.particles:
        return values.particles.bodies[0].inertial.mass
    return values.intent.mass if values.intent else None


def verdict_of(values: Values) -> tuple[str, str | None]:
    """Contract verdict and reason code."""
    if values.infeasible is not None:
        return "infeasible", values.infeasible.reason.value
    assert values.settled is not None
    if values.settled.verdict is Verdict.AT_REST:
        return AT_REST, None
    if values.settled.verdict is Verdict.AS_POSED:
        return AS_POSED, None
    return "infeasible", values.settled.verdict.value


def last_state(values: Values) -> Settled | LastState | None:
    """Last state of the drop, if there was one."""
    evidence = values.infeasible.evidence if values.infeasible else None
    return values.settled or (evidence if isinstance(evidence, LastState) else None)


def certificate_of(values: Values) -> JsonObject | None:
    """The drop's certificate, with the object's pose if the drop is infeasible; or the evidence of another stage."""
    if values.settled is not None:
        if values.settled.certificate is None:
            return None
        return certificate_with(values.settled.certificate, values.settled.checks)
    if values.infeasible is None:
        return None
    evidence = values.infeasible.evidence
    if not isinstance(evidence, LastState):
        return sorted_keys(object_to_json(evidence)) if evidence else {}
    return {
        **certificate_with(evidence.certificate, evidence.checks),
        "position": to_json(evidence.position),
        "quaternion": to_json(evidence.quaternion),
        "simulated_s": evidence.simulated_s,
        "steps": evidence.steps,
    }


def certificate_with(certificate: Certificate, checks: PlacementChecks | None) -> JsonObject:
    """A drop's certificate plus the requirements on the rest state as `placement`, and the column under the contact."""
    asked = {} if checks is None else object_to_json(checks)
    if not asked.get("poses"):
        asked.pop("poses", None)
    column = {"column": asked.pop("column")} if "column" in asked else {}
    return sorted_keys({**object_to_json(certificate), **({"placement": asked} if asked else {}), **column})


def messages_of(values: Values) -> list[str]:
    """Messages of the stages, in their order."""
    found: list[str] = list(values.scan.notes) if values.scan else []
    found += [about("object", note) for note in values.object_scan.notes] if values.object_scan else []
    found += values.scene.notes if values.scene else ()
    if values.intent:
        found += values.intent.notes
        if values.intent.not_understood:
            words = ", ".join(values.intent.not_understood)
            found.append(Caution(Cause.NOT_UNDERSTOOD, f"not understood: {words}"))
    found += values.anchor.notes if values.anchor else ()
    found += values.particles.notes if values.particles else ()
    last = last_state(values)
    found += last.warnings if last else ()
    return found


def timings_of(finished: FinishedSample) -> dict[str, float]:
    """Seconds that each stage took when it was computed; repeated stages are summed."""
    seconds: dict[str, float] = {}
    for one in finished.results:
        seconds[one.stage] = round(seconds.get(one.stage, 0.0) + one.record.seconds, 3)
    return seconds


def material_row(row: PartMaterial) -> JsonObject:
    """One row of `materials`."""
    return {
        "body": row.body,
        "part": row.part,
        "material": row.material.id,
        "model": str(row.model),
        "reason": row.reason,
        "density": row.material.density,
        "youngs_modulus": row.material.youngs_modulus,
        "poisson_ratio": row.material.poisson_ratio,
        "static_friction": row.material.static_friction,
        "dynamic_friction": row.material.dynamic_friction,
        "source": row.material.source,
    }


def geometry_row(one: BodyGeometry) -> JsonObject:
    """One row of `geometry`."""
    report = one.report
    return {
        "body": one.body,
        "part": one.part,
        "method": str(report.method),
        "closed": report.closed,
        "sides_agree": report.agreement,
        "hausdorff_m": report.hausdorff,
        "mean_m": report.mean,
        "tolerance_m": report.tolerance,
        "region_m": [report.region[:3], report.region[3:]] if report.region else None,
        "volume_m3": report.volume,
        "repairs": report.repairs,
        "problem": report.problem or None,
    }


def object_body(settled: Settled | None) -> SettledBody | None:
    """The placed object among the settled bodies."""
    return next((one for one in settled.bodies if one.name == "object"), None) if settled else None


def pose_of(world_from_object: NDArray[np.float64]) -> JsonObject:
    """Position of the object's origin [m] and its quaternion (w, x, y, z with w >= 0); the scale is left out."""
    linear = world_from_object[:3, :3]
    turn = Turn.from_matrix(linear / np.cbrt(np.linalg.det(linear)))
    return {
        "position": to_json(world_from_object[:3, 3]),
        "quaternion": to_json(turn.as_quat(canonical=True, scalar_first=True)),
    }


def support_point(settled: Settled, body: SettledBody) -> NDArray[np.float64]:
    """Middle of the contact patch seen from above [m], of the object's box if nothing touches, shape (2,)."""
    points = settled.contact_points if len(settled.contact_points) else body.surface.bounds
    middle: NDArray[np.float64] = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle[:2]

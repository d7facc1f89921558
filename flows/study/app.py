"""The web application of a study: pages, pictures and votes by a rater's link; pictures of its attention checks.

Everything but the style, the scripts and the refusals is below `/s/TOKEN/`. A comparison, a side and a number name a
file, never a path, so that nothing outside of the study can be reached and no address reveals a method.

Pictures of a check have the names, sizes, cameras and renderer of the placement's own, so that they look the same. The
overview is from the same camera; the close-up from the same direction and distance, centred on the contact that is
shown, as for other methods. Walls in front of a camera are cut away if the placement says which things are walls
(scene.json).
"""

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from fastapi import Depends, FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException as WebError

from dcap.evaluation.judging.cameras import CLOSEUPS, SAMPLES, Direction, PlacedThing, camera_of
from dcap.evaluation.pages import rendered
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.attention import PlacedSurface
from dcap.evaluation.study.design import ShownPlacement, Side, StudyItem
from dcap.evaluation.study.session import StudySession
from dcap.evaluation.view3d import ORBIT, three_script
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.errors import DcapError
from dcap.scene.readers.scenes.placed_scene import FACTS, instance_of, read_facts
from dcap.scene.types.mesh import PaintedMesh
from dcap.scene.types.pictures import PLACED
from dcap.scene.types.segmentation import Instance, Segmentation
from flows.judge_views import taken_from
from flows.own_requests import OwnRequests, OwnRequestsOnly
from tasks.render.settled_meshes import structure_faces
from tasks.render.views import SceneViews

HERE = Path(__file__).parent
STATIC, TEMPLATES = HERE / "static", HERE / "templates"
QUESTIONS = {
    JudgedAxis.RIGHT_PLACE: ("Right place", "Where is the object more in the place that the sentence asks for?"),
    JudgedAxis.PHYSICS_NATURALNESS: ("Physics and naturalness", "Where does it lie more as a real object would?"),
    JudgedAxis.OVERALL: ("Overall", "Which of the two is the better result?"),
}
"""Heading and question of each axis."""
VIEWS = {"overview": "Overview", "closeup": "Close-up of the contact"}
"""Captions of the views of a placement."""
MOST_BYTES = 4096
"""Largest body [bytes]: an answer has about 150."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",  # the link is the secret
    "X-Content-Type-Options": "nosniff",
    "X-Robots-Tag": "noindex, nofollow",
    "Cross-Origin-Resource-Policy": "same-origin",
}
NEVER, PRIVATE = {"Cache-Control": "no-store"}, {"Cache-Control": "private, max-age=3600"}
DAY_SECONDS = 86_400.0


class StudyAnswer(BaseModel, extra="forbid"):
    """A rater's answer to one comparison."""

    item: str = Field(max_length=16)
    right_place: Side
    physics_naturalness: Side
    overall: Side | None = None
    """Overall choice, if the study asks for it."""
    seconds: float = Field(ge=0.0, allow_inf_nan=False)
    """Time since the placements were shown, stored as at most a day [s]."""

    @property
    def by_axis(self) -> dict[JudgedAxis, Side]:
        """The answers by question."""
        given = {axis: getattr(self, axis.value) for axis in JudgedAxis}
        return {axis: Side(one) for axis, one in given.items() if one is not None}


def study_app(session: StudySession, own: OwnRequests) -> FastAPI:
    """The application of one study; it answers requests from its own pages only."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(OwnRequestsOnly, own, "--url")

    def rater_of(token: str) -> str:
        rater = session.rater_of(token)
        if rater is None:
            raise HTTPException(404, "This link belongs to no study here.")
        return rater

    def item_of(rater: Annotated[str, Depends(rater_of)], item: str) -> StudyItem:
        found = session.item(rater, item)
        if found is None:
            raise HTTPException(404, "There is no such comparison.")
        return found

    @app.middleware("http")
    async def guard(request: Request, proceed: Callable[[Request], Awaitable[Response]]) -> Response:
        length = request.headers.get("content-length", "")
        if request.method == "POST" and not (length.isdigit() and int(length) <= MOST_BYTES):
            answer: Response = PlainTextResponse(f"the answer must state its length, at most {MOST_BYTES} bytes", 413)
        else:
            answer = await proceed(request)
        answer.headers.update(HEADERS)
        if "cache-control" not in answer.headers:
            answer.headers.update(NEVER)
        return answer

    @app.exception_handler(WebError)
    def explain(_: Request, error: WebError) -> Response:
        return HTMLResponse(page("refusal.html.j2", message=str(error.detail)), error.status_code)

    @app.exception_handler(RequestValidationError)
    def wrong(_: Request, error: RequestValidationError) -> Response:
        places = sorted({".".join(str(part) for part in one["loc"][1:]) or "body" for one in error.errors()})
        return PlainTextResponse(f"not an answer: {', '.join(places)}", 422)

    @app.get("/s/{token}")
    def introduce(token: str, rater: Annotated[str, Depends(rater_of)]) -> HTMLResponse:
        return HTMLResponse(introduction(session, token, rater))

    @app.get("/s/{token}/compare")
    def compare(token: str, rater: Annotated[str, Depends(rater_of)]) -> HTMLResponse:
        return HTMLResponse(comparison(session, token, rater))

    @app.post("/s/{token}/votes")
    def vote(token: str, rater: Annotated[str, Depends(rater_of)], answer: StudyAnswer) -> JSONResponse:
        asked = session.item(rater, answer.item)
        if asked is None:
            raise HTTPException(404, "There is no such comparison.")
        if session.comes_later(rater, asked):
            raise HTTPException(409, "Another comparison comes first.")
        if set(answer.by_axis) != set(session.design.questions):
            raise HTTPException(422, f"The questions are {', '.join(session.design.questions)}.")
        try:
            fresh = session.answer(rater, asked, answer.by_axis, min(answer.seconds, DAY_SECONDS))
        except OSError as error:
            raise HTTPException(507, f"The answer could not be saved ({error.strerror or error}).") from None
        return JSONResponse({"saved": fresh, "next": f"/s/{token}"})

    def sent(path: Path | None, kind: str) -> FileResponse:
        if path is None or not path.is_file() or not session.owns(path):
            raise HTTPException(404, "There is no such file.")
        return FileResponse(path, media_type=kind, headers=PRIVATE)

    @app.get("/s/{token}/pictures/{item}/{side}/{number}")
    def picture(item: Annotated[StudyItem, Depends(item_of)], side: Side, number: int) -> FileResponse:
        views = session.pictures(item, side)
        return sent(views[number] if 0 <= number < len(views) else None, "image/png")

    @app.get("/s/{token}/before/{item}/{what}")
    def before(item: Annotated[StudyItem, Depends(item_of)], what: str) -> FileResponse:
        find = {"scene": session.run.clean_picture, "asset": session.run.asset_picture}.get(what)
        return sent(find(item.sample) if find else None, "image/png")

    @app.get("/s/{token}/models/{item}/asset")
    def asset(item: Annotated[StudyItem, Depends(item_of)]) -> FileResponse:
        return sent(session.run.asset_model(item.sample), "model/gltf-binary")

    @app.get("/s/{token}/models/{item}/{side}")
    def model(item: Annotated[StudyItem, Depends(item_of)], side: Side) -> FileResponse:
        try:
            return sent(session.model(item, side), "model/gltf-binary")
        except (DcapError, OSError):
            raise HTTPException(404, "This placement cannot be shown in 3D.") from None

    @app.get("/study.css")
    def style() -> FileResponse:
        return FileResponse(STATIC / "study.css", media_type="text/css")

    @app.get("/{name}.js")
    def script(name: str) -> Response:
        if name == "three" and three_script():
            return Response(three_script(), media_type="text/javascript", headers=PRIVATE)
        if name not in ("vote", "orbit"):
            raise HTTPException(404, "There is no such page.")
        return FileResponse(ORBIT if name == "orbit" else STATIC / f"{name}.js", media_type="text/javascript")

    return app


def introduction(session: StudySession, token: str, rater: str) -> str:
    """The scene, the asset and the sentence of the rater's next comparison; thanks where there is none."""
    item, (done, total) = session.current(rater), session.progress(rater)
    if item is None:
        return page("done.html.j2", done=done, total=total)
    run = session.run
    return page(
        "introduction.html.j2", base=f"/s/{token}", item=item.item, prompt=run.prompts[item.sample], done=done,
        total=total, first=done == 0, scene=run.clean_picture(item.sample) is not None,
        asset=run.asset_picture(item.sample) is not None,
        asset_model=run.asset_model(item.sample) is not None and bool(three_script()),
    )  # fmt: skip


def comparison(session: StudySession, token: str, rater: str) -> str:
    """The two placements of the rater's next comparison, and the questions."""
    item, (done, total) = session.current(rater), session.progress(rater)
    if item is None:
        return page("done.html.j2", done=done, total=total)
    views = [VIEWS[path.stem] for path in session.pictures(item, Side.LEFT)]
    return page(
        "comparison.html.j2", base=f"/s/{token}", item=item.item, prompt=session.run.prompts[item.sample],
        done=done, total=total, views=views, sides=[side.value for side in Side],
        questions=[(axis.value, *QUESTIONS[axis]) for axis in session.design.questions],
        models=session.has_models(item) and bool(three_script()),
    )  # fmt: skip


def page(template: str, **values: object) -> str:
    """A page of the study."""
    return rendered(template, values, TEMPLATES)


def check_pictures(
    placement: ShownPlacement, settled: PlacedSurface, shown: PlacedSurface
) -> Mapping[str, NDArray[np.uint8]]:
    """The pictures of one side of a check by name, sRGB; FormatError for an invalid scene.json, InputError if the
    cameras of the placement's own pictures are not known."""
    views, taken = surface_views(shown, things_of(placement.folder)), taken_from(placement.folder)
    contact = np.array(taken.contact)
    if not np.array_equal(shown.thing_bounds, settled.thing_bounds):
        contact = contact_of(shown, things_of(placement.folder), CLOSEUPS[taken.direction])
    found = {}
    for name, view in zip(PLACED, (taken.overview, taken.closeup_at(contact)), strict=True):
        camera = camera_of(view)
        meshes = views.seen_by(camera) if isinstance(views, SceneViews) else views
        found[name] = picture(meshes, camera, samples=SAMPLES).rgb
    return found


def things_of(folder: Path) -> tuple[Instance, ...]:
    """Things of a placement's scene from its scene.json; empty without one."""
    return tuple(map(instance_of, read_facts(folder).instances)) if (folder / FACTS).is_file() else ()


def contact_of(surface: PlacedSurface, things: tuple[Instance, ...], toward: Direction) -> NDArray[np.float64]:
    """Point where the object touches the scene below, or is nearest to it, seen from a direction [m], shape (3,)."""
    scene, thing = parts_of(surface)
    structure = structure_faces(segmented(scene, things)) if things else np.zeros(len(scene.mesh.faces), dtype=bool)
    return PlacedThing.of(scene.mesh, structure, thing.mesh).contact_seen(toward, Raycaster(thing.mesh))[1]


def surface_views(surface: PlacedSurface, things: tuple[Instance, ...]) -> SceneViews | PreparedMeshes:
    """Meshes that cameras see of a placement; if the walls are known, those in front of each camera are cut away."""
    scene, thing = parts_of(surface)
    look, own = (PaintedMesh(one.mesh, one.paint) for one in (scene, thing))
    return SceneViews(segmented(scene, things), look, [own]) if things else PreparedMeshes([look, own])


def parts_of(surface: PlacedSurface) -> tuple[PlacedSurface, PlacedSurface]:
    """The scene and the object."""
    return surface.of(np.flatnonzero(~surface.is_thing)), surface.of(np.flatnonzero(surface.is_thing))


def segmented(scene: PlacedSurface, things: tuple[Instance, ...]) -> Segmentation:
    """The scene with the instance of each face."""
    index = {one.id: number for number, one in enumerate(things)}
    number_of = np.array([*(index.get(name, -1) for name in scene.ids), -1], dtype=np.int32)
    owner = number_of[scene.face_id]
    return Segmentation(scene.mesh, things, owner, np.full_like(owner, -1))

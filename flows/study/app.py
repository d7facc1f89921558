"""The web application of a study: pages, pictures and votes by a rater's link; pictures of checks.

Everything but the style, the scripts and the refusals is below `/s/TOKEN/`. A comparison, a side and a number name a
file, never a path, so that nothing outside of the study can be reached and no address reveals a method.

Pictures of attention checks, by the cameras and the renderer of the run's own, so that they look the same.

In: the placement that a check is made from, and its surface at rest and as shown. Out: a picture for each of the
placement's own, with the same name and size. The overview is from the same camera; the close-up from the same direction
and distance, centred on the contact that is shown, as for other methods. Walls in front of a camera are cut away if
the placement says which things are walls (scene.json).
"""

from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import Depends, FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from jinja2 import FileSystemLoader, StrictUndefined
from jinja2.sandbox import SandboxedEnvironment
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException as WebError
from starlette.types import ASGIApp, Receive, Scope, Send

from dcap.evaluation.judging.cameras import CLOSEUPS, SAMPLES, Direction, PlacedThing, camera_of
from dcap.evaluation.page3d.viewer import ORBIT, three_script
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.attention import PlacedSurface
from dcap.evaluation.study.design import Side, StudyItem
from dcap.evaluation.study.placements import ShownPlacement
from dcap.evaluation.study.session import StudySession
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
REQUEST = "http.request"
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
    pages = StudyPages(session)
    app.add_middleware(BodyLimit)
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
        answer = await proceed(request)
        answer.headers.update(HEADERS)
        if "cache-control" not in answer.headers:
            answer.headers.update(NEVER)
        return answer

    @app.exception_handler(WebError)
    def explain(_: Request, error: WebError) -> Response:
        return HTMLResponse(pages.refusal(str(error.detail)), error.status_code)

    @app.exception_handler(RequestValidationError)
    def wrong(_: Request, error: RequestValidationError) -> Response:
        places = sorted({".".join(str(part) for part in one["loc"][1:]) or "body" for one in error.errors()})
        return PlainTextResponse(f"not an answer: {', '.join(places)}", 422)

    @app.get("/s/{token}")
    def introduce(token: str, rater: Annotated[str, Depends(rater_of)]) -> HTMLResponse:
        return HTMLResponse(pages.introduction(token, rater))

    @app.get("/s/{token}/compare")
    def compare(token: str, rater: Annotated[str, Depends(rater_of)]) -> HTMLResponse:
        return HTMLResponse(pages.comparison(token, rater))

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


class BodyLimit:
    """Reads a request's body and passes it on, or answers 413 if it is larger than MOST_BYTES, whatever its header
    says."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on as long as it is small."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        told = dict(scope["headers"]).get(b"content-length", b"0")
        body = await body_of(receive) if told.isdigit() and int(told) <= MOST_BYTES else None
        if body is None:
            await PlainTextResponse(f"more than {MOST_BYTES} bytes", status_code=413)(scope, receive, send)
            return
        waiting: list[MutableMapping[str, Any]] = [{"type": REQUEST, "body": body, "more_body": False}]

        async def again() -> MutableMapping[str, Any]:
            return waiting.pop() if waiting else await receive()

        await self._app(scope, again, send)


async def body_of(receive: Receive) -> bytes | None:
    """The body of a request; None where it is too large."""
    body, more = b"", True
    while more and len(body) <= MOST_BYTES:
        message = await receive()
        body += message.get("body", b"")
        more = message["type"] == REQUEST and message.get("more_body", False)
    return body if len(body) <= MOST_BYTES else None


class StudyPages:
    """Writes the pages of one study."""

    def __init__(self, session: StudySession) -> None:
        self._session = session
        self._templates = SandboxedEnvironment(
            loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
            lstrip_blocks=True,
        )  # fmt: skip

    def introduction(self, token: str, rater: str) -> str:
        """The scene, the asset and the sentence of the rater's next comparison; thanks where there is none."""
        item, (done, total) = self._session.current(rater), self._session.progress(rater)
        if item is None:
            return self._page("done.html.j2", done=done, total=total)
        run = self._session.run
        return self._page(
            "introduction.html.j2", base=f"/s/{token}", item=item.item, prompt=run.prompts[item.sample], done=done,
            total=total, first=done == 0, scene=run.clean_picture(item.sample) is not None,
            asset=run.asset_picture(item.sample) is not None,
            asset_model=run.asset_model(item.sample) is not None and bool(three_script()),
        )  # fmt: skip

    def comparison(self, token: str, rater: str) -> str:
        """The two placements of the rater's next comparison, and the questions."""
        item, (done, total) = self._session.current(rater), self._session.progress(rater)
        if item is None:
            return self._page("done.html.j2", done=done, total=total)
        views = [VIEWS[path.stem] for path in self._session.pictures(item, Side.LEFT)]
        return self._page(
            "comparison.html.j2", base=f"/s/{token}", item=item.item, prompt=self._session.run.prompts[item.sample],
            done=done, total=total, views=views, sides=[side.value for side in Side],
            questions=[(axis.value, *QUESTIONS[axis]) for axis in self._session.design.questions],
            models=self._session.has_models(item) and bool(three_script()),
        )  # fmt: skip

    def refusal(self, message: str) -> str:
        """A page with an error message."""
        return self._page("refusal.html.j2", message=message)

    def _page(self, template: str, **values: object) -> str:
        return self._templates.get_template(template).render(**values)


def check_pictures(
    placement: ShownPlacement, settled: PlacedSurface, shown: PlacedSurface
) -> Mapping[str, NDArray[np.uint8]]:
    """The pictures of one side of a check by name, sRGB; FormatError for an invalid scene.json, InputError if the
    cameras of the placement's own pictures are not known."""
    views, taken = surface_views(shown, things_of(placement.folder)), taken_from(placement.folder)
    contact = np.array(taken.contact)
    if not np.array_equal(shown.thing_bounds, settled.thing_bounds):
        contact = contact_of(shown, things_of(placement.folder), CLOSEUPS[taken.cameras.direction])
    found = {}
    for name, view in zip(PLACED, (taken.cameras.overview, taken.cameras.closeup_at(contact)), strict=True):
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

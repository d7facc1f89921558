"""The pages of a study as HTML; every text in them is escaped."""

from pathlib import Path

from jinja2 import FileSystemLoader, StrictUndefined
from jinja2.sandbox import SandboxedEnvironment

from dcap.evaluation.page3d.three import three_script
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.design import Side
from dcap.evaluation.study.session import StudySession

HERE = Path(__file__).parent
STATIC, TEMPLATES = HERE / "static", HERE / "templates"
QUESTIONS = {
    JudgedAxis.RIGHT_PLACE: ("Right place", "Where is the object more in the place that the sentence asks for?"),
    JudgedAxis.PHYSICS_NATURALNESS: ("Physics and naturalness", "Where does it lie more as a real object would?"),
    JudgedAxis.OVERALL: ("Overall", "Which of the two is the better result?"),
}
"""Heading and question of each axis."""
VIEWS = {"overview": "Overview", "closeup": "Close-up of the contact"}
"""What the views of a placement are called."""


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
        """A page that says what is wrong."""
        return self._page("refusal.html.j2", message=message)

    def _page(self, template: str, **values: object) -> str:
        return self._templates.get_template(template).render(**values)

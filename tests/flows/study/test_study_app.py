"""The pages of a study, asked for as a browser does: what is shown, what is taken, and what is refused."""

import html
import os
import re
import stat
from dataclasses import replace
from pathlib import Path

import pytest
from many_methods_run import COLORS, METHODS, SAMPLES, method_folder
from study_server import CHECK, ServedStudy

from dcap.evaluation.statistics.comparisons import AXES
from dcap.evaluation.study.attention import LIFTED, SETTLED
from dcap.evaluation.study.design import Side, StudyItem
from dcap.evaluation.study.study_folder import TOKENS, read_design, read_votes
from dcap.evaluation.view3d import three_script
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.types.pictures import PLACED
from flows.study.app import MOST_BYTES


def answer(item: StudyItem, side: Side = Side.LEFT) -> dict[str, object]:
    """The same side for every question."""
    return {"item": item.item, "seconds": 2.0, **{axis.value: side.value for axis in AXES}}


def current(study: ServedStudy, rater: str = "r01") -> StudyItem:
    """What the rater is asked now."""
    found = study.session.current(rater)
    assert found is not None
    return found


def true_comparison(study: ServedStudy) -> StudyItem:
    return next(one for one in study.session.design.raters["r01"] if one.lifted is None)


def check_of(study: ServedStudy) -> StudyItem:
    return next(one for one in study.session.design.raters["r01"] if one.lifted is not None)


def test_the_scene_comes_first_then_the_placements(study: ServedStudy) -> None:
    """The introduction has room, asset and sentence and no placement; the comparison has both, and every question."""
    item, base = current(study), study.page("r01")
    first = study.browser.get(base).text
    assert f"{base}/before/{item.item}/scene" in first
    assert f"{base}/before/{item.item}/asset" in first
    assert "/pictures/" not in first
    assert html.escape(SAMPLES[item.sample]) in first
    assert "<strong>1</strong> of 14" in first
    second = study.browser.get(f"{base}/compare").text
    for side in Side:
        assert all(f"{base}/pictures/{item.item}/{side}/{view}" in second for view in range(len(PLACED)))
    assert all(f'name="{axis}"' in second for axis in AXES)
    assert "<kbd>1</kbd> or <kbd>←</kbd>" in second


def test_text_of_people_is_escaped(study: ServedStudy) -> None:
    """A sentence with markup in it is shown as it was typed."""
    while current(study).sample != "bed-2":
        study.browser.post(f"{study.page('r01')}/votes", json=answer(current(study)))
    for page in ("", "/compare"):
        text = study.browser.get(study.page("r01") + page).text
        assert "put the ball &lt;b&gt;near&lt;/b&gt; the pillow &amp; leave it" in text
        assert "<b>near" not in text


def test_nothing_tells_a_rater_which_method_it_is(study: ServedStudy) -> None:
    """Neither pages nor addresses nor headers name a method, a sample or an attention check."""
    base = study.page("r01")
    for _ in range(14):
        item = current(study)
        for page in ("", "/compare"):
            reply = study.browser.get(base + page)
            words = (*METHODS, item.sample, "lifted", "attention")
            assert not [word for word in words if word in reply.text.replace(SAMPLES[item.sample], "")]
        picture = study.browser.get(f"{base}/pictures/{item.item}/left/0")
        assert not [word for word in METHODS if word in str(picture.headers)]
        study.browser.post(f"{base}/votes", json=answer(item))


def test_each_side_shows_its_own_method(study: ServedStudy) -> None:
    item, base = true_comparison(study), study.page("r01")
    for side, method in ((Side.LEFT, item.left), (Side.RIGHT, item.right)):
        for number, name in enumerate(PLACED):
            reply = study.browser.get(f"{base}/pictures/{item.item}/{side}/{number}")
            views = method_folder(study.run, method, item.sample) / "views"
            assert reply.content == (views / f"{name}.png").read_bytes()
            assert reply.headers["content-type"] == "image/png"
    assert len({COLORS[item.left], COLORS[item.right]}) == 2


def test_a_check_shows_its_copy_on_one_side(study: ServedStudy) -> None:
    item, base = check_of(study), study.page("r01")
    assert item.lifted is not None
    for number, view in enumerate(PLACED):
        got = {side: study.browser.get(f"{base}/pictures/{item.item}/{side}/{number}").content for side in Side}
        names = {item.lifted: LIFTED, item.lifted.other: SETTLED}
        assert got == {side: CHECK + f"{name} {view}".encode() for side, name in names.items()}
    assert study.browser.get(f"{base}/models/{item.item}/{item.lifted}").content == b"glTF lifted"


def test_a_check_looks_like_a_comparison(study: ServedStudy) -> None:
    """The pages differ in the sentence and the name of the comparison alone."""
    pages = []
    for _ in range(14):
        item, base = current(study), study.page("r01")
        text = study.browser.get(f"{base}/compare").text
        pages.append(re.sub(rf"<header.*?</header>|<q>.*?</q>|\b{item.item}\b", "", text, flags=re.DOTALL))
        study.browser.post(f"{base}/votes", json=answer(item))
    assert len(set(pages)) == 1


def test_models_are_cut_out_once(study: ServedStudy, tmp_path: Path) -> None:
    """A side's model is a readable GLB with the object and where to look from; it follows the run's."""
    item, base = true_comparison(study), study.page("r01")
    reply = study.browser.get(f"{base}/models/{item.item}/left")
    assert reply.headers["content-type"] == "model/gltf-binary"
    (tmp_path / "model.glb").write_bytes(reply.content)
    assert set(read_gltf(tmp_path / "model.glb").node_names) == {"scene", "object"}
    assert b'"toward":[' in reply.content
    made = next((study.folder / "models").rglob("*.glb"))
    before = made.stat().st_mtime_ns
    study.browser.get(f"{base}/models/{item.item}/left")
    assert made.stat().st_mtime_ns == before
    source = method_folder(study.run, item.left, item.sample) / "scene.glb"
    os.utime(source, ns=(before + 10**9, before + 10**9))
    study.browser.get(f"{base}/models/{item.item}/left")
    assert made.stat().st_mtime_ns != before


def test_a_model_that_cannot_be_read_is_no_model(study: ServedStudy) -> None:
    item, base = true_comparison(study), study.page("r01")
    (method_folder(study.run, item.left, item.sample) / "scene.glb").write_bytes(b"no glTF")
    assert study.browser.get(f"{base}/models/{item.item}/left").status_code == 404


def test_answers_lead_on_until_all_are_given(study: ServedStudy) -> None:
    """Every comparison once, the progress counts, and at the end there are thanks and no further question."""
    base, seen = study.page("r01"), []
    for number in range(14):
        item = current(study)
        assert f'value="{number}"' in study.browser.get(base).text
        reply = study.browser.post(f"{base}/votes", json=answer(item))
        assert reply.json() == {"saved": True, "next": base}
        seen.append(item)
    assert seen == list(study.session.design.raters["r01"])
    for page in ("", "/compare"):
        text = study.browser.get(base + page).text
        assert "Thank you" in text
        assert "<form" not in text
    assert len(read_votes(study.folder)) == 14 * len(AXES)


def test_an_answer_counts_once(study: ServedStudy) -> None:
    """Sent twice (a second click, a page that was open twice) the first one stays."""
    item, address = current(study), f"{study.page('r01')}/votes"
    assert study.browser.post(address, json=answer(item, Side.RIGHT)).json()["saved"]
    assert not study.browser.post(address, json=answer(item, Side.LEFT)).json()["saved"]
    assert {vote.winner for vote in read_votes(study.folder)} == {Side.RIGHT}
    assert len(read_votes(study.folder)) == len(AXES)


def test_raters_do_not_mix(study: ServedStudy) -> None:
    """Two raters at once have their own order, progress and votes."""
    for number in range(6):
        rater, side = (("r01", Side.LEFT), ("r02", Side.RIGHT))[number % 2]
        study.browser.post(f"{study.page(rater)}/votes", json=answer(current(study, rater), side))
    votes = read_votes(study.folder)
    for rater, side in (("r01", Side.LEFT), ("r02", Side.RIGHT)):
        mine = [vote for vote in votes if vote.rater == rater]
        assert {vote.winner for vote in mine} == {side}
        assert [vote.item for vote in mine][:: len(AXES)] == ["001", "002", "003"]
        assert study.session.progress(rater) == (3, 14)


@pytest.mark.parametrize(
    "wrong",
    [
        {"overall": "both"}, {"right_place": None}, {"extra": 1}, {"seconds": -1.0}, {"seconds": "NaN"}, {"item": 7},
        {"item": "0" * 99},
    ],
)  # fmt: skip
def test_what_is_no_answer_is_refused(study: ServedStudy, wrong: dict[str, object]) -> None:
    reply = study.browser.post(f"{study.page('r01')}/votes", json={**answer(current(study)), **wrong})
    assert reply.status_code == 422
    assert reply.text == f"not an answer: {next(iter(wrong))}"
    assert read_votes(study.folder) == ()


def test_a_question_without_answer_is_refused(study: ServedStudy) -> None:
    """All questions or none: a comparison is never half answered."""
    body = answer(current(study))
    del body["physics_naturalness"]
    assert study.browser.post(f"{study.page('r01')}/votes", json=body).status_code == 422
    assert study.browser.post(f"{study.page('r01')}/votes", content=b"{").status_code == 422
    assert read_votes(study.folder) == ()


def test_comparisons_are_answered_in_their_order(study: ServedStudy) -> None:
    later = study.session.design.raters["r01"][3]
    assert study.browser.post(f"{study.page('r01')}/votes", json=answer(later)).status_code == 409
    unknown = {**answer(later), "item": "999"}
    assert study.browser.post(f"{study.page('r01')}/votes", json=unknown).status_code == 404


def test_the_thousandth_comparison_comes_after_the_one_before(study: ServedStudy) -> None:
    """Names have three digits up to 999 and four from there: the order is that of the comparisons, not of text."""
    design = study.session.design
    items = [replace(one, item=f"{number:03d}") for number, one in enumerate(design.raters["r01"], 998)]
    study.session.design = replace(design, raters={**design.raters, "r01": tuple(items)})
    address, order = f"{study.page('r01')}/votes", [items[0], items[2], items[1], items[3], items[2]]
    got = [study.browser.post(address, json=answer(item)).status_code for item in order]
    assert [one.item for one in order] == ["998", "1000", "999", "1001", "1000"]
    assert got == [200, 409, 200, 409, 200]


def test_a_vote_that_cannot_be_kept_is_told(study: ServedStudy, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rater sees that it is not saved, and may send it again."""

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    item, address = current(study), f"{study.page('r01')}/votes"
    monkeypatch.setattr(os, "pwrite", full)
    assert study.browser.post(address, json=answer(item)).status_code == 507
    monkeypatch.undo()
    assert study.browser.post(address, json=answer(item)).json()["saved"]


def test_without_a_link_nothing_is_shown(study: ServedStudy) -> None:
    """A wrong token is a page that is not there, for everything below it."""
    item, token = current(study), study.tokens["r01"]
    for wrong in ("x", token[:-1], token.swapcase(), f"{token}x", "ü"):
        for rest in ("", "/compare", f"/pictures/{item.item}/left/0", f"/models/{item.item}/left"):
            assert study.browser.get(f"/s/{wrong}{rest}").status_code == 404
        assert study.browser.post(f"/s/{wrong}/votes", json=answer(item)).status_code == 404
    for page in ("/", "/s", "/s/", "/docs", "/openapi.json", "/study"):
        assert study.browser.get(page).status_code == 404
    assert read_votes(study.folder) == ()


@pytest.mark.parametrize(
    "path",
    [
        "pictures/001/left/99", "pictures/001/left/-1", "pictures/001/up/0", "pictures/999/left/0",
        "pictures/001/left/..%2F..%2Frun.json", "pictures/..%2F..%2F..%2Frun.json/left/0",
        "models/001/..%2Ftokens.json",
        "before/001/..%2Frun.json", "before/001/tokens.json", "../../study/tokens.json",
        "models/..%2f..%2ftokens/asset",
    ],
)  # fmt: skip
def test_no_path_leads_to_another_file(study: ServedStudy, path: str) -> None:
    """Files are named by comparison, side and number, and by nothing else."""
    reply = study.browser.get(f"{study.page('r01')}/{path}")
    assert reply.status_code in (404, 422)
    assert study.tokens["r02"] not in reply.text


@pytest.mark.parametrize("link", ["file", "folder"])
def test_a_link_out_of_the_run_is_not_shown(study: ServedStudy, tmp_path: Path, link: str) -> None:
    """A run that others made shows raters no other file of this machine; links within it are its own."""
    item = true_comparison(study)
    picture, address = study.session.pictures(item, Side.LEFT)[0], f"{study.page('r01')}/pictures/{item.item}/left/0"
    moved = picture if link == "file" else picture.parent
    private, kept = tmp_path / "private", study.run / "kept"
    for place, status in ((private, 404), (kept, 200)):
        moved.rename(place)
        moved.symlink_to(place)
        assert study.browser.get(address).status_code == status
        moved.unlink()
        place.rename(moved)


def test_scripts_are_ours_or_three(study: ServedStudy) -> None:
    """three.js comes from the installed package and does not start that package's own page."""
    for name in ("vote", "orbit"):
        assert study.browser.get(f"/{name}.js").text.startswith("//")
    three = study.browser.get("/three.js").text
    assert three == three_script()
    assert "THREE.GLTFLoader=GLTFLoader" in three
    assert not three.rstrip().endswith("init();")
    assert study.browser.get("/%2e%2e%2fpages.js").status_code == 404
    assert "http" not in study.browser.get("/study.css").text


def test_a_large_body_is_refused(study: ServedStudy) -> None:
    """By its header, and by what comes where the header says nothing."""
    address = f"{study.page('r01')}/votes"
    assert study.browser.post(address, content=b" " * (MOST_BYTES + 1)).status_code == 413

    def pieces() -> list[bytes]:
        return [b" " * 1000] * (1 + MOST_BYTES // 1000)

    assert study.browser.post(address, content=iter(pieces())).status_code == 413
    assert study.browser.get(study.page("r01")).status_code == 200


def test_every_answer_says_what_may_be_loaded(study: ServedStudy) -> None:
    """Nothing from elsewhere, no address passed on, nothing of a page kept."""
    for path in (study.page("r01"), "/study.css", "/s/wrong"):
        headers = study.browser.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
    for page in ("", "/compare"):
        assert "http:" not in study.browser.get(study.page("r01") + page).text


def test_what_is_stored_tells_nothing_of_a_person(study: ServedStudy) -> None:
    """Votes name raters by number; only the owner reads the links; no address is kept anywhere."""
    study.browser.post(f"{study.page('r01')}/votes", json=answer(current(study)))
    kept = b"".join(path.read_bytes() for path in study.folder.glob("*.json*") if path.name != TOKENS)
    assert study.tokens["r01"].encode() not in kept
    assert b"testclient" not in kept
    assert stat.S_IMODE((study.folder / TOKENS).stat().st_mode) == 0o600


def test_the_design_is_read_as_it_was_written(study: ServedStudy) -> None:
    design = read_design(study.folder)
    assert design == study.session.design
    assert design is not None
    more = design.with_raters(3)
    assert {name: more.raters[name] for name in design.raters} == design.raters
    assert list(more.raters) == ["r01", "r02", "r03"]


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example:8090"}, {"Origin": "https://evil.example"}, {"Origin": "null"}],
)
def test_pages_of_others_are_refused(study: ServedStudy, headers: dict[str, str]) -> None:
    """Also with a rater's link: nothing is shown, and no answer is taken; the refusal names the option."""
    item, base = current(study), study.page("r01")
    for reply in (
        study.browser.get(base, headers=headers),
        study.browser.post(f"{base}/votes", json=answer(item), headers=headers),
    ):
        assert reply.status_code == 403
        assert "see --url" in reply.text
        assert reply.headers["cache-control"] == "no-store"
    assert current(study) == item
    reply = study.browser.post(f"{base}/votes", json=answer(item), headers={"Origin": "http://127.0.0.1:8090"})
    assert reply.status_code == 200
    assert current(study) != item

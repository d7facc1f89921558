"""The stages that ask, one after the other, with whichever client: tests say what is placed and look at what comes out.

A replay is recorded first, from the model's stand-in, and then answers alone: what it would ask for is an error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pytest
from box_rooms import ROOM
from fake_api import FakeApi

from dcap.language.connect import Client, connect
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.questions import Question
from dcap.language.protocol.session import Session
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.materials.stage import MaterialsConfig, materials
from tasks.rotation.stage import RotationConfig, rotation

MODEL = "claude-sonnet-5-5"
MARKS = {ClientName.REPLAY: pytest.mark.slow}
"""A replay asks first, so it costs twice what the model costs; `make check` is content with the other two."""
PICTURE_SIZE = 64
"""Width and height of the rotation's pictures [pixels]."""

T = TypeVar("T")


class Asked(OfflineClient):
    """The offline client, with what it was asked."""

    def __init__(self) -> None:
        self.requests: list[Any] = []

    def ask(self, question: Question[Any, Any], request: Any) -> Any:
        self.requests.append(request)
        return super().ask(question, request)


@dataclass(frozen=True, slots=True)
class Stages:
    """The stages with one client; all but `offline` need the stand-in and a folder."""

    client: ClientName = ClientName.OFFLINE
    api: FakeApi | None = None
    folder: Path = Path()

    def answered(self, run: Callable[[Client], T]) -> T:
        """What `run` gives when this client answers."""
        if self.client is ClientName.OFFLINE:
            return run(connect(LanguageConfig(), Session()))
        assert self.api is not None
        recording, kept = str(self.folder / "recording"), str(self.folder / "kept")
        model = LanguageConfig(client=ClientName.ANTHROPIC, model=MODEL)
        found = run(connect(model, Session(record=recording, kept=kept)))
        if self.client is ClientName.ANTHROPIC:
            return found
        asked = len(self.api.asked)
        replay = LanguageConfig(client=ClientName.REPLAY, model=MODEL)
        found = run(connect(replay, Session(replay=recording, kept=str(self.folder / "nothing"))))
        assert len(self.api.asked) == asked
        return found

    def meant(
        self,
        prompt: str,
        item: Segmentation,
        room: Segmentation = ROOM,
        *,
        mass: float | None = None,
        config: IntentConfig | None = None,
    ) -> Intent | Infeasible:
        """Intent only."""
        return self.answered(
            lambda client: intent(
                SegmentedScene(room), SegmentedObject(item), prompt, mass, config or IntentConfig(), client
            )
        )

    def oriented(self, prompt: str, item: Segmentation, room: Segmentation = ROOM) -> Rotation:
        """Intent and rotation."""
        return self.answered(lambda client: turned(prompt, item, room, client)[1])

    def tried(self, prompt: str, item: Segmentation, room: Segmentation = ROOM) -> Anchor | Infeasible:
        """Intent, rotation and anchor, whatever the anchor says."""
        return self.answered(lambda client: set_over(prompt, item, room, client)[2])

    def placed(self, prompt: str, item: Segmentation, room: Segmentation = ROOM) -> tuple[Intent, Rotation, Anchor]:
        """Intent, rotation and anchor where there is a place."""
        meant, pose, found = self.answered(lambda client: set_over(prompt, item, room, client))
        assert isinstance(found, Anchor), found
        return meant, pose, found

    def made_of(self, prompt: str, item: Segmentation, room: Segmentation = ROOM) -> PartMaterials:
        """All four stages."""

        def run(client: Client) -> PartMaterials | Infeasible:
            meant, _, found = set_over(prompt, item, room, client)
            assert isinstance(found, Anchor), found
            return materials(
                SegmentedScene(room), SegmentedObject(item), meant, found, prompt, MaterialsConfig(), client
            )

        rows = self.answered(run)
        assert isinstance(rows, PartMaterials), rows
        return rows


def turned(prompt: str, item: Segmentation, room: Segmentation, client: Client) -> tuple[Intent, Rotation]:
    """Intent and rotation."""
    meant = intent(SegmentedScene(room), SegmentedObject(item), prompt, None, IntentConfig(), client)
    assert isinstance(meant, Intent), meant
    pose = rotation(
        SegmentedScene(room), SegmentedObject(item), meant, prompt, RotationConfig(picture_size=PICTURE_SIZE), client
    )
    assert isinstance(pose, Rotation), pose
    return meant, pose


def set_over(
    prompt: str, item: Segmentation, room: Segmentation, client: Client
) -> tuple[Intent, Rotation, Anchor | Infeasible]:
    """Intent, rotation and anchor."""
    meant, pose = turned(prompt, item, room, client)
    return meant, pose, anchor(SegmentedScene(room), SegmentedObject(item), meant, pose, prompt, AnchorConfig(), client)


def with_each(cases: Sequence[tuple[object, ...]], *told: object) -> list[object]:
    """Cases with a client before each: offline for all, every client for those whose first value is told."""
    return [
        pytest.param(one, *case, marks=MARKS.get(one, ()))
        for case in cases
        for one in (ClientName if case[0] in told else (ClientName.OFFLINE,))
    ]

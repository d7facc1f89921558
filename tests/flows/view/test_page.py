"""What is sent to the page: nodes of the scene, widgets of the panel, and what they do to each other."""

import json
import socket
import struct
from dataclasses import replace

import numpy as np
import pytest
import viser
from dented_bed import RADIUS, TOP, anchor, scene_of, settled
from placed_ball import FRAMES, SLIDE, pushed, shown, values

from dcap.scene.types.choices import POSE_OF_THE_FILE, Rotation
from flows.own_requests import LOOPBACK
from flows.place import PlaceConfig
from flows.view import serving
from flows.view.model import middle_of, placement_view, scene_view
from flows.view.nodes import place_cameras
from flows.view.panel import moment, said
from flows.view.picking import PickedPoint, PickPanel, SurfacePicker


def test_the_slider_moves_the_object_and_the_dent(server: viser.ViserServer) -> None:
    """What the slider says is where the object's node is, and which shape of the dent is visible."""
    nodes, panel = shown(server)
    assert nodes.thing is not None
    fall = settled().bodies[0].position
    rows = [server.scene.get_handle_by_name(f"/room/bed/body_0/dent/{frame}") for frame in range(FRAMES)]
    for frame in (0, 2, FRAMES - 1):
        panel.go_to(frame)
        assert nodes.thing.position == pytest.approx(frame / (FRAMES - 1) * fall)
        assert [one.visible for one in rows if one is not None] == [one == frame for one in range(FRAMES)]
    panel.close()


def test_the_slider_moves_what_was_placed_before(server: viser.ViserServer) -> None:
    """The crate's node goes as far as it was pushed."""
    scene, rest = pushed()
    _, panel = shown(server, replace(values(rest), scene=scene))
    crate = server.scene.get_handle_by_name("/room/crate/body_0")
    assert crate is not None
    for frame in (0, 1, FRAMES - 1):
        panel.go_to(frame)
        assert crate.position == pytest.approx(frame / (FRAMES - 1) * SLIDE)
    panel.close()


def test_every_thing_has_a_node(server: viser.ViserServer) -> None:
    """The room by instance and part, the object, the contact, the anchor and the ray."""
    _, panel = shown(server)
    for name in ("/room/bed/body_0", "/room/floor/body_0", "/room/wall_back/body_0", "/object/0",
                 "/contact", "/anchor/point", "/anchor/normal", "/ray"):  # fmt: skip
        assert server.scene.get_handle_by_name(name) is not None, name
    panel.close()


def test_the_object_lies_in_its_dent(server: viser.ViserServer) -> None:
    """The object's vertices under its node's pose are those of the settled surface."""
    nodes, panel = shown(server)
    node = server.scene.get_handle_by_name("/object/0")
    assert isinstance(node, viser.GlbHandle)
    assert nodes.thing is not None
    points = positions(node.glb_data) + nodes.thing.position
    assert points[:, 2].min() == pytest.approx(settled().bodies[0].surface.vertices[:, 2].min(), abs=1e-6)
    assert points[:, 2].max() == pytest.approx(settled().bodies[0].surface.vertices[:, 2].max(), abs=1e-6)
    panel.close()


def test_the_camera_stands_where_the_overview_does(server: viser.ViserServer) -> None:
    """A new page looks at the anchor, from above it."""
    view = placement_view(values(), PlaceConfig())
    place_cameras(server, view.view)
    assert server.initial_camera.look_at == pytest.approx(anchor().surface_point)
    assert server.initial_camera.position[2] > TOP


def test_what_a_person_wrote_stays_text(server: viser.ViserServer) -> None:
    """A prompt with signs of HTML is shown, not run."""
    _, panel = shown(server)
    assert "put &lt;it&gt; there" in panel.verdict.content
    panel.close()


def test_a_moment_is_told_in_seconds() -> None:
    """The first frame is before the drop, the last its end."""
    view = placement_view(values(), PlaceConfig())
    assert moment(view, 0, FRAMES - 1) == "0.000 s of 0.300 s, before the drop"
    assert moment(view, 1, FRAMES - 1) == "0.100 s of 0.300 s"


def test_the_server_listens_on_this_machine_alone(server: viser.ViserServer) -> None:
    """Its socket is that of the loopback, and it hands out no public address."""
    assert server.get_host() == "127.0.0.1"
    assert server.request_share_url() is None


@pytest.mark.parametrize("upgrade", [False, True])
@pytest.mark.parametrize(
    ("host", "origin", "fine"),
    [
        ("127.0.0.1:{port}", "", True),
        ("localhost:{port}", "http://localhost:{port}", True),
        ("localhost:{port}", "http://localhost:1", False),
        ("127.0.0.1:{port}", "https://evil.example", False),
        ("127.0.0.1:{port}", "null", False),
        ("evil.example:{port}", "http://evil.example:{port}", False),
        ("evil.example", "", False),
    ],
)
def test_pages_of_others_are_refused(
    server: viser.ViserServer, host: str, origin: str, fine: bool, upgrade: bool
) -> None:
    """By the handshake, so that nothing is said to them and nothing is taken from them; a name that leads to this
    machine makes no page the viewer's own."""
    port = server.get_port()
    status = status_of(port, host.format(port=port), origin.format(port=port), upgrade=upgrade)
    assert status == ((101 if upgrade else 200) if fine else 403)
    assert server.get_clients() == {}


def status_of(port: int, host: str, origin: str, *, upgrade: bool) -> int:
    """What the server answers to a page's request, for its text or for a WebSocket."""
    lines = ["GET / HTTP/1.1", f"Host: {host}", *([f"Origin: {origin}"] if origin else [])]
    if upgrade:
        lines += ["Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
                  "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
                  f"Sec-WebSocket-Protocol: viser-v{viser.__version__}"]  # fmt: skip
    with socket.create_connection(("127.0.0.1", port), timeout=30) as one, one.makefile("rb") as answer:
        one.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(answer.readline().split()[1])


def test_a_taken_port_is_passed_over() -> None:
    """The next free one is used."""
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        other = serving.open_server(port)
        assert other.get_port() > port
        other.stop()


def test_a_click_gives_the_point_in_the_files_own_frame(server: viser.ViserServer) -> None:
    """A file in centimetres with y up: a click from above on the bed is its top, and the button places there."""
    world_from_file = 0.01 * np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 100.0]])
    picker = SurfacePicker(scene_of(), world_from_file, middle_of(scene_of()))
    asked: list[PickedPoint] = []
    panel = PickPanel(server, scene_view(scene_of(), PlaceConfig()), picker, ("scene", "", ""), asked.append)
    at_first = panel.button.disabled
    panel.point_at((0.25, 0.4, 3.0), (0.0, 0.0, -1.0))
    assert panel.picked is not None
    assert panel.picked.position == pytest.approx((0.25, 0.4, TOP), abs=1e-6)
    assert panel.picked.at == (25.0, 50.0, -40.0)
    assert panel.picked.option == "--at 25.0,50.0,-40.0"
    assert panel.picked.instance == "bed"
    assert "--at 25.0,50.0,-40.0" in panel.told.content
    assert (at_first, panel.button.disabled) == (True, False)
    panel.press()
    assert asked == [panel.picked]
    panel.press()
    assert len(asked) == 1
    panel.close()


def test_walls_are_looked_through_from_outside_and_hidden_things_too() -> None:
    """A ray that comes through the front wall meets the bed; with the bed hidden the floor or the wall behind."""
    picker = SurfacePicker(scene_of(), np.eye(4), middle_of(scene_of()))
    origin, way = np.array([0.0, -4.0, 0.3]), np.array([0.0, 1.0, 0.0])
    seen = picker.pick(origin, way, frozenset())
    behind = picker.pick(origin, way, frozenset({("bed", 0)}))
    assert seen is not None
    assert behind is not None
    assert (seen.instance, behind.instance) == ("bed", "wall_back")
    assert picker.pick(origin, -way, frozenset()) is None


def test_an_option_that_begins_with_a_minus_is_written_with_an_equals_sign() -> None:
    """As the command line needs it."""
    picker = SurfacePicker(scene_of(), np.eye(4), middle_of(scene_of()))
    found = picker.pick(np.array([-0.25, 0.0, 3.0]), np.array([0.0, 0.0, -1.0]), frozenset())
    assert found is not None
    assert found.option == "--at=-0.250,0.000,0.500"


def positions(data: bytes) -> np.ndarray:
    """Vertices of a GLB of one mesh, shape (n, 3)."""
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    view = document["bufferViews"][document["accessors"][0]["bufferView"]]
    start = 28 + length + view["byteOffset"]
    return np.frombuffer(data[start : start + view["byteLength"]], dtype="<f4").reshape(-1, 3)


def test_the_bytes_of_a_surface_are_a_glb_of_its_vertices(server: viser.ViserServer) -> None:
    """The header names the length; the ball's vertices are RADIUS from its middle."""
    nodes, panel = shown(server)
    node = server.scene.get_handle_by_name("/object/0")
    assert isinstance(node, viser.GlbHandle)
    assert struct.unpack_from("<4sII", node.glb_data) == (b"glTF", 2, len(node.glb_data))
    middle = np.array([0.0, 0.0, TOP + RADIUS + 0.01])
    assert np.linalg.norm(positions(node.glb_data) - middle, axis=1) == pytest.approx(RADIUS, abs=1e-6)
    assert nodes.frame == FRAMES - 1
    panel.close()


@pytest.mark.parametrize(
    ("pictures", "reason", "words"),
    [
        (3, "it is asked", "A model saw the object"),
        (0, "it is asked", "Offline no pictures are used"),
        (0, POSE_OF_THE_FILE, "No rotation was chosen"),
    ],
)
def test_the_rotation_says_who_looked(pictures: int, reason: str, words: str) -> None:
    """A model, nobody, or there was nothing to choose: never a heading of pictures that are not there."""
    shots = tuple(np.zeros((4, 4, 3), dtype=np.uint8) for _ in range(pictures))
    text = said("rotation", Rotation(np.eye(3), shots, "ball", "upright", reason), POSE_OF_THE_FILE)
    assert words in text
    assert ("turned half" in text) == (pictures > 0)


@pytest.mark.parametrize(
    ("verdict", "reason", "words"),
    [
        ("at_rest", None, ">at rest<"),
        ("as_posed", None, ">as posed<"),
        ("infeasible", "toppled", "infeasible: toppled"),
    ],
)
def test_the_verdict_is_that_of_the_placement(verdict: str, reason: str | None, words: str) -> None:
    """A pose that is not simulated is no refusal."""
    assert words in said("verdict", {"verdict": verdict, "reason": reason, "message": "", "prompt": "put it there"})

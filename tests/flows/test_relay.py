"""A relay hands on every byte of a connection, in both directions."""

import socket
import threading
from collections.abc import Iterator

import pytest

from dcap.scene.errors import InputError
from flows.own_requests import LOOPBACK
from flows.relay import PIECE, relay
from flows.server import check_port, free_port


@pytest.fixture
def upstream() -> Iterator[int]:
    """A server that sends back what it gets, twice, until the other side has said all."""
    with socket.create_server((LOOPBACK, 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    one, _ = listener.accept()
                except OSError:
                    return
                with one:
                    while data := one.recv(PIECE):
                        one.sendall(data + data)

        threading.Thread(target=serve, daemon=True).start()
        yield listener.getsockname()[1]


def relayed(to_port: int) -> int:
    """A port whose connections are handed on to another."""
    port, listening = free_port(), threading.Event()
    threading.Thread(target=relay, args=(port, to_port, listening.set), daemon=True).start()
    assert listening.wait(10)
    return port


def test_all_bytes_arrive(upstream: int) -> None:
    """More than a piece is echoed whole and in order, on one connection and on the next."""
    port = relayed(upstream)
    for data in (b"GET / HTTP/1.1\r\n\r\n", bytes(range(256)) * (3 * PIECE // 256)):
        with socket.create_connection((LOOPBACK, port), timeout=10) as one:
            sender = threading.Thread(target=one.sendall, args=(data,))
            sender.start()
            got = b""
            while len(got) < 2 * len(data):
                got += one.recv(PIECE)
            sender.join()
        assert sorted(got) == sorted(data + data)
        assert got.startswith(data[:16])


def test_a_connection_ends_where_no_server_answers() -> None:
    """Nothing hangs, and the relay itself goes on."""
    port = relayed(free_port())
    for _ in range(2):
        with socket.create_connection((LOOPBACK, port), timeout=10) as one:
            assert one.recv(1) == b""


def test_a_port_that_is_taken_is_named_with_its_option() -> None:
    """One line says which port and which option."""
    with socket.create_server((LOOPBACK, 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} .*--port"):
            check_port(port)
    check_port(free_port())

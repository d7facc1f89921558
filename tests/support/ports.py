"""A port of this machine that nobody listens on."""

import socket


def free_port() -> int:
    """Return one that was free a moment ago."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])

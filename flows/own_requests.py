"""Limits a server of ours to requests that use one of its own names and come from its own pages.

A page of another site can send requests to any address of this machine. The browser names the page's origin in
`Origin`, and for resources without that header, such as pictures and frames, in `Sec-Fetch-Site`. A link that a person
follows is a navigation and no part of the other page. A name of another site may also resolve to this machine (DNS
rebinding), so that its pages share the server's origin: the header `Host` then holds that name.
"""

import ipaddress
import re
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

LOOPBACK = "127.0.0.1"
LOOPBACK_NAMES = frozenset({"localhost", LOOPBACK, "::1"})
EVERYWHERE = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 -- requests to it are told from others
"""Addresses to listen on that stand for all of this machine."""
USUAL_PORTS = {"http": 80, "https": 443}
ROOT = re.compile(r"https?://[^/?#@\s]+/?", re.IGNORECASE)
"""Address of a web server, with nothing behind its name and port."""
HEADERS = b"host", b"origin"
FETCH = b"sec-fetch-site", b"sec-fetch-dest"
ELSEWHERE = frozenset({"cross-site", "same-site"})
"""`Sec-Fetch-Site` of resources loaded by a page of another origin; another port of this machine is `same-site`."""
A_PAGE = "document"
"""`Sec-Fetch-Dest` of a page that is opened by itself."""
REFUSED = 403
"""HTTP status of refused requests."""
POLICY = 1008
"""Code with which a WebSocket is closed."""


@dataclass(frozen=True, slots=True)
class OwnRequests:
    """The names of a server, and the other origins of its pages."""

    hosts: frozenset[str] | None
    """Names and addresses; None where it listens everywhere, so that its names are unknown."""
    origins: frozenset[str] = frozenset()
    """Origins of reverse proxies in front of it, `https://name`."""

    @classmethod
    def to(cls, address: str, before: Iterable[str] = ()) -> "OwnRequests":
        """Own requests of a server that listens on an address; `before` are addresses of reverse proxies in front of
        it."""
        fronts = [origin_of(one) for one in before]
        origins = frozenset(fronts)
        if address in EVERYWHERE:
            return cls(None, origins)
        hosts = LOOPBACK_NAMES | {address.lower()} | {host_name(origin_host(one)) for one in fronts}
        return cls(hosts if is_loopback(address) else hosts | {socket.gethostname().lower()}, origins)

    def refusal(self, hosts: Sequence[str], origins: Sequence[str], site: str = "", destination: str = "") -> str:
        """Why a request is refused, by its headers `Host` and `Origin` and what `Sec-Fetch-Site` and `Sec-Fetch-Dest`
        say; empty if it is not."""
        if len(hosts) != 1 or len(origins) > 1:
            return f"{len(hosts)} headers `Host` and {len(origins)} `Origin`, where there is one, and at most one"
        name = host_name(hosts[0])
        if self.hosts is not None and name not in self.hosts:
            return f"Host {hosts[0]!r} is none of {', '.join(sorted(self.hosts))}"
        if origins and origins[0].lower() not in self.origins and origin_host(origins[0]) != hosts[0].lower():
            return f"Origin {origins[0]!r} is not {hosts[0]!r}"
        if not origins and site.lower() in ELSEWHERE and destination.lower() != A_PAGE:
            return f"it would be {destination or 'something'} within a page of another site"
        return ""


class OwnRequestsOnly:
    """Refuses requests to an application from other pages; the refusal names the `knob` that allows them."""

    def __init__(self, app: "ASGIApp", own: OwnRequests, knob: str) -> None:
        self._app, self._own, self._knob = app, own, knob

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Pass a request on, or refuse it; a WebSocket before it is open."""
        why = ""
        if scope["type"] in ("http", "websocket"):
            hosts, origins = ([v.decode("latin-1") for k, v in scope["headers"] if k == name] for name in HEADERS)
            headers = dict(scope["headers"])
            why = self._own.refusal(hosts, origins, *(headers.get(name, b"").decode("latin-1") for name in FETCH))
        if not why:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY})
        else:
            text = f"refused: {why}; see {self._knob}\n".encode()
            kind = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(text)).encode())]
            await send({"type": "http.response.start", "status": REFUSED, "headers": kind})
            await send({"type": "http.response.body", "body": text})


def origin_of(address: str) -> str:
    """The `Origin` that a browser sends from pages at a web address; it leaves out the scheme's default port.
    ValueError for an invalid address."""
    parts = urlsplit(address)
    name, port = parts.hostname, parts.port
    if not ROOT.fullmatch(address) or not name:
        raise ValueError(address)
    shown = f"[{name}]" if ":" in name else name
    return f"{parts.scheme}://{shown}" + ("" if port in (None, USUAL_PORTS[parts.scheme]) else f":{port}")


def url_host(address: str) -> str:
    """Host of a URL by which this machine reaches a server that listens on an address."""
    if address in EVERYWHERE:
        return LOOPBACK
    return f"[{address}]" if ":" in address else address


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() in LOOPBACK_NAMES


def host_name(host: str) -> str:
    """The name in a header `Host`; empty without one, or with an invalid port."""
    try:
        parts = urlsplit(f"//{host}")
        name, _ = parts.hostname, parts.port  # raises if it is no number
        return name or ""
    except ValueError:
        return ""


def origin_host(origin: str) -> str:
    """Name and port in a header `Origin`; empty where it has none, as for a page from a file."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""

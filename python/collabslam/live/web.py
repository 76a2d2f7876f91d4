"""Two pages over HTTPS: a phone as the worn camera, and a live view, through a device of the link."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import hmac
import http
import json
import logging
import secrets
import ssl
import struct
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.live.clock import Exchange
from collabslam.live.gateway import Gateway
from collabslam.live.messages import FARTHEST

if TYPE_CHECKING:
    from collabslam.live.doorway import Doorway

TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
PAGES = {"/": "phone.html", "/view": "view.html"} | {
    f"/{name}": name for name in ("page.css", "phone.js", "tracked.js", "motion.js", "view.js", "link.js")
}
LARGEST, CONNECTIONS = 300_000, 16
"""Bytes of a message, and connections at once that have shown a token."""
MOST_RATES = 25
"""Rates of a phone's gyroscope that come with an image."""
HELLO, STRANGERS = 5.0, 64
"""Seconds of each step: encryption, request, token; how many may be there who have shown none."""
REFUSED = 1008
"""The socket's code for who may not come in."""
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' blob:; connect-src 'self' wss:; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True)
class Tokens:
    """What opens the two pages; they stand in the addresses after the ``#``, which browsers do not send."""

    phone: str
    view: str

    @classmethod
    def new(cls) -> Tokens:
        """Tokens that nobody guesses."""
        return cls(secrets.token_urlsafe(16), secrets.token_urlsafe(16))


class WebServer:
    """Serves the pages.

    Parameters
    ----------
    gateway : Gateway
    tokens : Tokens
    """

    def __init__(self, gateway: Gateway, tokens: Tokens) -> None:
        self._gateway, self._tokens = gateway, tokens
        self._open = 0
        self._clock = gateway.clock

    @contextlib.asynccontextmanager
    async def serving(self, host: str, port: int, keys: Path) -> AsyncIterator[int]:
        """Serves until the block is left; gives the port.

        Parameters
        ----------
        host, port
            Where to listen; any free port if it is 0.
        keys : Path
            Folder with ``certificate.pem`` and ``key.pem``.

        Raises
        ------
        DataError
            If the address is in use, the certificate cannot be read, or the extra ``live`` is missing.
        """
        with needs("live"):
            from websockets.asyncio.server import serve

            from collabslam.live.doorway import Doorway
        asyncio.get_running_loop().set_exception_handler(_unless_strangers)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            context.load_cert_chain(keys / "certificate.pem", keys / "key.pem")
            doorway = Doorway(context, STRANGERS, HELLO)
            server = await serve(
                functools.partial(self._connection, doorway),
                host,
                port,
                create_connection=doorway.connection,  # type: ignore[arg-type]  # any callable will do
                open_timeout=HELLO,
                process_request=self._page,
                max_size=LARGEST,
                max_queue=4,
                compression=None,
                logger=_silent(),
            )
        except OSError as error:
            raise DataError(
                f"The pages cannot be served on {host}:{port} ({error}); check address, port and keys."
            ) from error
        async with server:
            try:
                yield int(next(iter(server.sockets)).getsockname()[1])
            finally:
                doorway.close()

    def _page(self, connection: Any, request: Any) -> Any:
        """A page, or None for a socket that may be opened."""
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        path = request.path.partition("?")[0]
        upgrades = " ".join(request.headers.get_all("Upgrade")).lower()
        if path in ("/phone", "/view") and "websocket" in upgrades:
            origins, hosts = request.headers.get_all("Origin"), request.headers.get_all("Host")
            if len(hosts) != 1 or origins != [f"https://{hosts[0]}"]:
                return connection.respond(http.HTTPStatus.FORBIDDEN, "open the page first\n")
            return None
        name = PAGES.get(path)
        if name is None:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "the pages are / and /view\n")
        body = files("collabslam.live").joinpath("pages").joinpath(name).read_bytes()
        kind = f"{TYPES[Path(name).suffix]}; charset=utf-8"
        return Response(
            200, "OK", Headers({**_HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}), body
        )

    async def _connection(self, doorway: Doorway, socket: Any) -> None:
        """One page's socket, from its token to its end."""
        from websockets.exceptions import ConnectionClosed

        role = socket.request.path.partition("?")[0].removeprefix("/")
        with contextlib.suppress(ConnectionClosed):
            hello = await self._hello(socket, getattr(self._tokens, role))
            if hello is None:
                await socket.close(REFUSED, "The token is wrong; open the address that was printed.")
                return
            doorway.leaves(socket)
            if self._open >= CONNECTIONS:
                await socket.close(REFUSED, "Too many pages are open; close one of them.")
            else:
                self._open += 1
                try:
                    await self._serve(socket, role, hello)
                finally:
                    self._open -= 1

    async def _serve(self, socket: Any, role: str, hello: Mapping[str, Any]) -> None:
        """A page that has shown its token."""
        if role == "view":
            await self._show(socket)
        elif hello.get("watch") is True:
            await self._look(socket)
        else:
            await self._phone(socket, hello)

    async def _hello(self, socket: Any, token: str) -> Mapping[str, Any] | None:
        """The first message if it shows the token, and comes in time."""
        try:
            hello = _object(await asyncio.wait_for(socket.recv(), HELLO))
        except TimeoutError:
            return None
        shown = hello.get("token")
        good = isinstance(shown, str) and hmac.compare_digest(_bytes(shown), _bytes(token))
        return hello if good else None

    async def _show(self, socket: Any) -> None:
        """The live view: what changed, twice a second and more."""
        with self._gateway.watching() as watch:
            while True:
                facts, picture = await asyncio.to_thread(watch.next)
                if picture is not None:
                    await socket.send(picture)
                await socket.send(json.dumps(facts))

    async def _look(self, socket: Any) -> None:
        """A phone before its start: what the robot sees."""
        with self._gateway.watching() as watch:
            while True:
                facts, picture = await asyncio.to_thread(watch.next)
                if picture is not None:
                    await socket.send(picture)
                await asyncio.to_thread(self._gateway.announce)
                await socket.send(json.dumps(self._of_phone(facts)))

    async def _phone(self, socket: Any, hello: Mapping[str, Any]) -> None:
        """A phone's images, and what it is told."""
        width, height = hello.get("width"), hello.get("height")
        with self._gateway.phone(width, height, hello.get("intrinsics")) as phone:
            if phone.refused:
                await socket.send(json.dumps({"refused": phone.refused}))
                await socket.close(REFUSED, phone.refused[:120])
                return
            await socket.send(json.dumps({"ready": True}))
            told = asyncio.create_task(self._tell(socket, phone))
            try:
                async for message in socket:
                    if isinstance(message, bytes):
                        _image(phone, message)
                    else:
                        await self._answer(socket, phone, _object(message))
            finally:
                told.cancel()

    async def _tell(self, socket: Any, phone: Any) -> None:
        """What the robot sees, how images come, and how many of which size are wanted."""
        with self._gateway.watching() as watch:
            while True:
                facts, picture = await asyncio.to_thread(watch.next)
                if picture is not None:
                    await socket.send(picture)
                await socket.send(json.dumps({"level": phone.level(), **self._of_phone(facts)}))

    def _of_phone(self, facts: Mapping[str, Any]) -> dict[str, Any]:
        """What a phone's page is told of it, with "this phone" for the device's name."""
        told = {name: facts[name] for name in ("facts", "own", "status", "ages") if name in facts}
        if "facts" in told:
            own, ours = f"{self._gateway.name}: ", "this phone: "
            values = told["facts"].items()
            told["facts"] = {ours + k.removeprefix(own) if k.startswith(own) else k: v for k, v in values}
        return told

    async def _answer(self, socket: Any, phone: Any, message: Mapping[str, Any]) -> None:
        received = self._clock.now()
        asked, exchange, own, rates = (message.get(name) for name in ("ask", "exchange", "own", "rates"))
        if _is_time(asked):
            answer = {"asked": asked, "received": received, "answered": self._clock.now()}
            await socket.send(json.dumps(answer))
        elif isinstance(exchange, list) and len(exchange) == 4 and all(map(_is_time, exchange)):
            # The robot is asked as well, which may take a while.
            await asyncio.to_thread(phone.exchange, Exchange(*(float(t) for t in exchange)))
        elif isinstance(own, list) and len(own) == 8 and all(map(_is_time, own)):
            t, *numbers = map(float, own)
            phone.own(t, np.array(numbers[:3]), np.array(numbers[3:]))
        elif isinstance(rates, list) and len(rates) <= MOST_RATES:
            for row in rates:
                if isinstance(row, list) and len(row) == 4 and all(map(_is_time, row)):
                    phone.rate(float(row[0]), np.array(row[1:], np.float64))


def _bytes(text: str) -> bytes:
    """Of any text that JSON can hold."""
    return text.encode("utf-8", "surrogatepass")


def _unless_strangers(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """The system's own errors are of connections: broken off, or more of them than files may be open."""
    if not isinstance(context.get("exception"), OSError):
        loop.default_exception_handler(context)


def _silent() -> logging.Logger:
    """Strangers who speak no HTTP, or break off, are not news."""
    logger = logging.getLogger("collabslam.live.web")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger


def _image(phone: Any, message: bytes) -> None:
    if len(message) > 8:
        (t,) = struct.unpack(">d", message[:8])
        if _is_time(t):
            phone.image(t, message[8:])


def _object(message: Any) -> dict[str, Any]:
    """A message's JSON object; empty for anything else."""
    try:
        found = json.loads(message) if isinstance(message, str) else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _is_time(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and -FARTHEST < value < FARTHEST

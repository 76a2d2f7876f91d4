"""Who is at the pages' door and has not shown a token: so many, and the oldest gives way.

Needs the extra ``live``, so it is imported where the pages are served.
"""

from __future__ import annotations

import asyncio
import ssl
from typing import Any

from websockets.asyncio.server import ServerConnection


class Doorway:
    """Counts a connection from the moment it is accepted, before any encryption.

    Who has not agreed on an encryption takes no place of those who have: it costs so much less to come
    that far.

    Parameters
    ----------
    context : ssl.SSLContext
        The pages' certificate.
    places : int
        How many may be there before an encryption, and how many behind it without a token.
    patience : float
        Seconds for the encryption to be agreed.
    """

    def __init__(self, context: ssl.SSLContext, places: int, patience: float) -> None:
        self._context, self._places, self._patience = context, places, patience
        self._bare: dict[Any, Any] = {}
        self._encrypted: dict[Any, Any] = {}

    def connection(self, *arguments: Any, **settings: Any) -> ServerConnection:
        """What ``websockets`` makes of an accepted connection; its server is asked for no encryption."""
        return _AtTheDoor(self, *arguments, **settings)

    def leaves(self, stranger: Any) -> None:
        """The token was right, or the connection is over."""
        self._bare.pop(stranger, None)
        self._encrypted.pop(stranger, None)

    def close(self) -> None:
        """Sends everybody away who is at the door."""
        for transport in (*self._bare.values(), *self._encrypted.values()):
            transport.abort()

    def _admit(self, among: dict[Any, Any], stranger: Any, transport: Any) -> None:
        """Gives a place, that of the oldest if all are taken."""
        if len(among) >= self._places:
            among.pop(next(iter(among))).abort()
        among[stranger] = transport

    async def secured(self, stranger: Any, transport: Any) -> Any:
        """The encrypted transport, or None if they did not agree in time."""
        self._admit(self._bare, stranger, transport)
        secured = None
        try:
            secured = await asyncio.get_running_loop().start_tls(
                transport, stranger, self._context, server_side=True, ssl_handshake_timeout=self._patience
            )
        except OSError:  # ssl.SSLError and a broken connection are
            transport.abort()
        self.leaves(stranger)
        if secured is not None:
            self._admit(self._encrypted, stranger, secured)
        return secured


class _AtTheDoor(ServerConnection):
    """A connection of ``websockets`` that begins once it is encrypted."""

    def __init__(self, doorway: Doorway, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._doorway, self._over = doorway, False
        self._early: list[bytes] | None = []
        """What came between the encryption's last message and `connection_made` of what it protects."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._begun = asyncio.get_running_loop().create_task(self._begin(transport))

    async def _begin(self, transport: asyncio.BaseTransport) -> None:
        secured = await self._doorway.secured(self, transport)
        if secured is None or self._over:
            self._doorway.leaves(self)
            return
        early, self._early = self._early or [], None
        super().connection_made(secured)
        for data in early:
            super().data_received(data)

    def data_received(self, data: bytes) -> None:
        if self._early is None:
            super().data_received(data)
        else:
            self._early.append(data)

    def eof_received(self) -> None:
        if self._early is None:
            super().eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        self._over = True
        self._doorway.leaves(self)
        if self._early is None:
            super().connection_lost(exc)

"""``collabslam live web``."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
from pathlib import Path
from typing import Any

from collabslam.cli import OK
from collabslam.cli.live_options import add_link

PORT = 8443


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--robot", metavar="HOST:PORT", default="127.0.0.1", help="where the robot is (default %(default)s)"
    )
    parser.add_argument(
        "--listen",
        metavar="HOST:PORT",
        default=f"127.0.0.1:{PORT}",
        help="where browsers connect (default %(default)s); 0.0.0.0 for phones",
    )
    parser.add_argument("--camera", metavar="FILE", type=Path, help="calibration of the phone's camera")
    parser.add_argument("--certificate", metavar="DIR", type=Path, help="of the pages, if not that of --keys")
    add_link(parser)


def main(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    from collabslam.datasets.calibration import load_unmasked
    from collabslam.errors import SettingsError
    from collabslam.live import link
    from collabslam.live.gateway import Gateway
    from collabslam.live.keys import WEB

    keys = link.keys_of(arguments.keys, insecure=arguments.insecure)
    certificate = arguments.certificate or (keys.folder if keys is not None else None)
    if certificate is None:
        raise SettingsError("The pages need a certificate; make one with 'live keys DIR --web HOST'.")
    camera = None if arguments.camera is None else load_unmasked(arguments.camera)
    name = WEB if keys is None else keys.name
    robot = link.Address.parse(arguments.robot)
    with link.open_device(robot, keys) as session, contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(Gateway(session, name, camera), arguments.listen, certificate))
    return OK


async def _serve(gateway: Any, listen: str, certificate: Path) -> None:
    from collabslam.live.link import Address
    from collabslam.live.web import Tokens, WebServer

    address, tokens = Address.parse(listen), Tokens.new()
    async with WebServer(gateway, tokens).serving(address.host, address.port, certificate) as port:
        print(f"live view: https://{address.host}:{port}/view#t={tokens.view}")
        print(f"phone:     https://{address.host}:{port}/#t={tokens.phone}", flush=True)
        await asyncio.Event().wait()

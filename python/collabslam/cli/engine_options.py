"""Options that say where work is done."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collabslam.batch.engines import Engine


def add_engine(parser: argparse.ArgumentParser) -> None:
    """``--engine``, ``--scheduler`` and ``--limit``."""
    group = parser.add_argument_group("where it runs")
    group.add_argument(
        "--engine",
        metavar="NAME",
        default="local",
        help="local (the default), or dask: on its workers (extra cluster)",
    )
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of Dask, as tcp://host:8786 (default: workers of this machine)",
    )
    group.add_argument(
        "--limit",
        metavar="S",
        type=float,
        help="seconds a piece of work may take (default: an hour)",
    )


def engine_of(arguments: argparse.Namespace) -> Engine:
    """The engine that was asked for; raises SettingsError if there is none such."""
    from collabslam.batch.engines import SECONDS, Engine

    limit = SECONDS if arguments.limit is None else arguments.limit
    return Engine(arguments.engine, arguments.scheduler, limit)

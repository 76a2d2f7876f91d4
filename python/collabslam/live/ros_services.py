"""Services of a node of ROS 2: save the map, start in a map, begin anew; `std_srvs/Trigger` each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from collabslam.errors import CollabslamError


def offer_services(node: Any, out: str, services: Mapping[str, Callable[[], str]]) -> list[Any]:
    """Offer each as ``OUT/NAME``; what it returns, or the error that it raises, is the answer's message.

    A ROS without ``std_srvs`` has none of them, and says so.
    """
    try:
        kind = import_module("std_srvs.srv").Trigger
    except ImportError as error:
        node.get_logger().warning(f"no services {', '.join(services)}: {error}")
        return []

    def answering(work: Callable[[], str]) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                response.message, response.success = work(), True
            except CollabslamError as error:
                response.message, response.success = str(error), False
            return response

        return answer

    return [node.create_service(kind, f"{out}/{name}", answering(work)) for name, work in services.items()]

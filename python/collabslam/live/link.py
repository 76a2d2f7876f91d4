"""A Zenoh session between robot and devices: who connects, how it is secured, what may pass."""

from __future__ import annotations

import contextlib
import ipaddress
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.errors import DataError, SettingsError
from collabslam.extras import needs
from collabslam.live import names
from collabslam.live.keys import Keys

LARGEST = 1 << 20
"""Bytes of a message that the link takes at all."""
LARGEST_PUT = 300_000
"""Bytes of what a device may write."""
FLOOD = 2000.0
"""Messages per second of each kind that the link lets pass from a device; `uplink` counts more strictly."""
SESSIONS = 16
"""Devices that may be connected at once."""
LEASE_MS, RETRY_MS = 1000, 250
"""After so many milliseconds of silence a link counts as lost; so soon it is tried again."""

_LOCAL = ("localhost", "localhost.localdomain")
_TOLD = ["put", "reply", "declare_queryable"]


@dataclass(frozen=True)
class Address:
    """Where the robot listens: host and port."""

    host: str
    port: int = names.PORT

    @classmethod
    def parse(cls, text: str) -> Address:
        """``HOST``, ``HOST:PORT``, ``[IPV6]:PORT``; raises SettingsError."""
        host, _, port = (
            text.rpartition(":") if ":" in text.rpartition("]")[2] else (text, "", str(names.PORT))
        )
        host = host.strip("[]")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise SettingsError(f"The address '{text}' is not understood; give HOST or HOST:PORT.")
        return cls(host, int(port))

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine reaches it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host in _LOCAL

    def endpoints(self, *, secured: bool) -> list[str]:
        """As Zenoh writes them: with TLS, which loses nothing, datagrams of QUIC, which wait for nothing."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        place = f"{host}:{self.port}"
        return [f"tls/{place}?rel=1", f"quic/{place}?rel=0"] if secured else [f"tcp/{place}"]


@contextlib.contextmanager
def open_robot(address: Address, keys: Keys | None) -> Iterator[Any]:
    """The robot's session: it listens.

    Parameters
    ----------
    address : Address
    keys : Keys or None
        None, for a link that anybody can read and write, is for loopback only.

    Raises
    ------
    DataError
        If the address cannot be listened on, or the extra ``live`` is not installed.
    SettingsError
        If the link would be open to a network, or the keys name no device.
    """
    config = _config(address, keys, listens=True)
    if keys is not None and not keys.devices:
        raise SettingsError(
            f"The keys in {keys.folder} name no device that may connect; make keys for one with 'collabslam "
            "live keys DIR --device NAME' (of pages --web HOST) and copy the robot's folder again."
        )
    config |= {"listen/endpoints": address.endpoints(secured=keys is not None)}
    config |= {"transport/unicast/max_sessions": SESSIONS}
    config |= {"low_pass_filter": [_sizes()]}
    config |= {"downsampling": [_rates(["*"] if keys is None else keys.devices)]}
    if keys is not None:
        config |= {"access_control": access(keys.devices)}
    with _opened(config, f"The robot cannot listen on {address.host}:{address.port}") as session:
        yield session


@contextlib.contextmanager
def open_device(address: Address, keys: Keys | None) -> Iterator[Any]:
    """A device's session: it connects to the robot, now or as soon as the robot is there.

    Raises as `open_robot` does.
    """
    config = _config(address, keys, listens=False)
    config |= {
        "listen/endpoints": [],
        "connect/endpoints": address.endpoints(secured=keys is not None),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {
            "period_init_ms": RETRY_MS,
            "period_max_ms": RETRY_MS,
            "period_increase_factor": 1.0,
        },
    }
    with _opened(config, f"There is no way to {address.host}:{address.port}") as session:
        yield session


def has_datagrams(session: Any) -> bool:
    """Whether what may be lost has a link of its own."""
    import zenoh

    return any(of.reliability == zenoh.Reliability.BEST_EFFORT for of in session.info.links())


def publisher(session: Any, key: str, *, urgent: bool = False, datagrams: bool = False) -> Any:
    """A publisher that never waits: what cannot be sent is dropped, what is urgent goes first.

    Where the link has datagrams and they are asked for, what is lost costs itself only, and what overtakes
    is lost; else everything comes in order, late where something was lost before it.
    """
    import zenoh

    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA,
        express=True,
        reliability=zenoh.Reliability.BEST_EFFORT if datagrams else zenoh.Reliability.RELIABLE,
    )


def subscriber(session: Any, key: str, take: Callable[[str, bytes], None]) -> Any:
    """Calls ``take(key, payload)``, from a thread of Zenoh's, for each message below a key."""
    return session.declare_subscriber(
        key, lambda sample: take(str(sample.key_expr), bytes(sample.payload.to_bytes()))
    )


def access(devices: Sequence[str]) -> dict[str, Any]:
    """Who may do what: a device writes its own keys, each by its name, and reads what the robot writes."""
    rules, policies, subjects = [], [], []
    for device in devices:
        own = [names.key(device, part) for part in names.PARTS]
        rules.append(_rule(f"{device}_writes", ["put"], "ingress", own))
        subjects.append({"id": device, "cert_common_names": [device]})
        policies.append({"rules": [f"{device}_writes", "reads", "tells", "listens"], "subjects": [device]})
    rules.append(_rule("reads", ["declare_subscriber", "query"], "ingress", [f"{names.ROBOT}/**"]))
    rules.append(_rule("tells", _TOLD, "egress", [f"{names.ROBOT}/**"]))
    rules.append(_rule("listens", ["declare_subscriber"], "egress", [f"{names.WORN}/**"]))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flow: str, keys: list[str]) -> dict[str, Any]:
    return {"id": name, "messages": messages, "flows": [flow], "permission": "allow", "key_exprs": keys}


def _sizes() -> dict[str, Any]:
    return {
        "id": "sizes",
        "flows": ["ingress"],
        "messages": ["put", "query", "reply", "delete"],
        "key_exprs": ["**"],
        "size_limit": LARGEST_PUT,
    }


def _rates(devices: Sequence[str]) -> dict[str, Any]:
    rules = [
        {"key_expr": names.key(device, part), "freq": FLOOD} for device in devices for part in names.PARTS
    ]
    return {"id": "rates", "flows": ["ingress"], "messages": ["put"], "rules": rules}


def _config(address: Address, keys: Keys | None, *, listens: bool) -> dict[str, Any]:
    if keys is None and not address.is_loopback:
        raise SettingsError(
            f"Without keys anybody in the network of {address.host} could send images and read the pose; "
            "make keys with 'collabslam live keys' and give them with --keys, or stay on 127.0.0.1."
        )
    config: dict[str, Any] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,  # it would pass by the network, and its security
        "transport/link/tx/lease": LEASE_MS,
        "transport/unicast/open_timeout": 2 * LEASE_MS,
        "transport/unicast/accept_timeout": 2 * LEASE_MS,
        "transport/link/rx/max_message_size": LARGEST,
    }
    if keys is not None:
        config["transport/link/tls"] = keys.tls(listens=listens)  # of both links
        config["transport/unicast/max_links"] = 2
    return config


@contextlib.contextmanager
def _opened(config: dict[str, Any], fault: str) -> Iterator[Any]:
    with needs("live"):
        import zenoh
    made = zenoh.Config()
    for name, value in config.items():
        made.insert_json5(name, json.dumps(value))
    try:
        session: Any = zenoh.open(made)
    except zenoh.ZError as error:
        raise DataError(
            f"{fault} ({str(error).splitlines()[0][:200]}); check address, port and keys."
        ) from error
    try:
        yield session
    finally:
        with contextlib.suppress(zenoh.ZError):  # it is over, whatever the network says
            session.close()


def keys_of(folder: Path | None, *, insecure: bool) -> Keys | None:
    """The keys to use; raises SettingsError if neither keys nor ``--insecure`` are given."""
    if insecure and folder is not None:
        raise SettingsError("Both --keys and --insecure were given; leave one out.")
    if folder is None and not insecure:
        raise SettingsError(
            "No keys were given; make them with 'collabslam live keys DIR --robot HOST --device NAME' and "
            "give --keys, or --insecure for a trial on this machine alone."
        )
    return None if folder is None else Keys.read(folder)

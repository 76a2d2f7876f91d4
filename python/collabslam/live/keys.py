"""An authority of one's own, and certificates for the robot and each device: both ends know each other."""

from __future__ import annotations

import datetime
import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collabslam.errors import DataError, SettingsError
from collabslam.extras import needs
from collabslam.formats.files import read_bytes, read_text, write_bytes, write_text
from collabslam.live.names import device_name

if TYPE_CHECKING:
    from cryptography.x509 import Certificate, GeneralName

ROBOT, WEB = "robot", "web"
AUTHORITY, AUTHORITY_KEY, CERTIFICATE, KEY, DEVICES = (
    "authority.pem",
    "authority.key",
    "certificate.pem",
    "key.pem",
    "devices.txt",
)
"""Files: the authority's certificate is in every folder, its key only where the keys are made."""
YEARS = 10
MOST_BYTES = 1 << 20
"""Of a file of keys."""
LOCAL = ("localhost", "127.0.0.1", "::1")
_LABEL = "[A-Za-z0-9]([A-Za-z0-9_-]{0,61}[A-Za-z0-9])?"
_HOST = re.compile(rf"(?=.{{1,253}}\Z){_LABEL}(\.{_LABEL})*")


@dataclass(frozen=True)
class Keys:
    """The folder of the robot or of a device.

    Attributes
    ----------
    folder : Path
    name : str
        The certificate's name.
    devices : tuple of str
        Of the robot: who may connect.
    """

    folder: Path
    name: str
    devices: tuple[str, ...] = ()

    @classmethod
    def read(cls, folder: Path) -> Keys:
        """The keys in a folder that `make_keys` made.

        Raises
        ------
        DataError
            If files are missing, broken or do not belong together, or it is not the certificate's time: the
            other end would refuse them without a word.
        """
        with needs("live"):
            from cryptography import x509
            from cryptography.exceptions import InvalidSignature
        missing = [n for n in (AUTHORITY, CERTIFICATE, KEY) if not (folder / n).is_file()]
        if missing:
            raise DataError(
                f"The folder {folder} lacks {', '.join(missing)}; give the robot's or a device's folder, "
                "which 'collabslam live keys' makes below its own."
            )
        try:
            certificate, authority = (_certificate(folder / name) for name in (CERTIFICATE, AUTHORITY))
            key = _private(folder / KEY)
            common = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
            name = str(common[0].value)
            names = read_text(folder / DEVICES).split() if (folder / DEVICES).is_file() else []
            devices = list(map(device_name, names))
            if name != ROBOT:
                device_name(name)
        except (OSError, ValueError, TypeError, IndexError) as error:
            raise DataError(f"The keys in {folder} cannot be read ({error}); make them again.") from error
        if key.public_key() != certificate.public_key():
            raise DataError(f"The key in {folder} is of another certificate; copy the whole folder again.")
        try:
            certificate.verify_directly_issued_by(authority)
        except (InvalidSignature, ValueError, TypeError) as error:
            raise DataError(
                f"The certificate in {folder} is of another authority; copy the whole folder again."
            ) from error
        begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        now = datetime.datetime.now(datetime.timezone.utc)
        if end < now:
            raise DataError(f"The certificate in {folder} ended on {end:%Y-%m-%d}; make new keys.")
        if begin > now:
            raise DataError(
                f"The certificate in {folder} begins on {begin:%Y-%m-%d}, and this machine's clock says "
                f"{now:%Y-%m-%d}; set the clock."
            )
        return cls(folder, name, tuple(devices))

    def tls(self, *, listens: bool) -> dict[str, Any]:
        """Zenoh's settings for TLS: both ends show a certificate of the authority."""
        side = "listen" if listens else "connect"
        return {
            "root_ca_certificate": str(self.folder / AUTHORITY),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            f"{side}_private_key": str(self.folder / KEY),
            f"{side}_certificate": str(self.folder / CERTIFICATE),
        }


def make_keys(
    folder: Path, *, hosts: Sequence[str], devices: Sequence[str], web_hosts: Sequence[str] = ()
) -> list[Path]:
    """Makes what is missing: the authority, the robot's folder and one for each device.

    Parameters
    ----------
    folder : Path
        Stays with whoever gives out keys; ``robot`` and ``NAME`` below it go to the robot and the devices.
    hosts : sequence of str
        Names or addresses by which devices reach the robot.  A robot that has a certificate gets a new one.
    devices : sequence of str
        Names of devices; those that have keys keep them.
    web_hosts : sequence of str
        Names or addresses by which browsers reach the pages, which get the device `WEB`.

    Returns
    -------
    list of Path
        The folders that were made.

    Raises
    ------
    SettingsError
        If a device cannot be called so, or a host is neither a name nor an address.
    DataError
        If a file cannot be read or written.
    """
    with needs("live"):
        from cryptography import x509
    for device in devices:
        device_name(device)
    alternatives = {
        name: [_general(host) for host in (*some, *LOCAL)]
        for name, some in ((ROBOT, hosts), (WEB, web_hosts))
    }
    authority = _Authority.of(folder)
    made = []
    if hosts or not (folder / ROBOT / CERTIFICATE).is_file():
        authority.issue(folder / ROBOT, ROBOT, alternatives[ROBOT], serves=True)
        made.append(folder / ROBOT)
    for device in devices:
        if not (folder / device / CERTIFICATE).is_file():
            authority.issue(folder / device, device, [x509.DNSName(device)], connects=True)
            made.append(folder / device)
    if web_hosts:
        authority.issue(folder / WEB, WEB, alternatives[WEB], serves=True, connects=True)
        made.append(folder / WEB)
    known = sorted(
        device_name(p.parent.name) for p in folder.glob(f"*/{CERTIFICATE}") if p.parent.name != ROBOT
    )
    write_text(folder / ROBOT / DEVICES, "".join(f"{name}\n" for name in known))
    return made


class _Authority:
    """Signs certificates."""

    def __init__(self, certificate: Certificate, key: Any) -> None:
        self._certificate, self._key = certificate, key

    @classmethod
    def of(cls, folder: Path) -> _Authority:
        """The authority of a folder, a new one if it has none."""
        from cryptography import x509
        from cryptography.hazmat.primitives import serialization

        if (folder / AUTHORITY_KEY).is_file():
            try:
                certificate, key = _certificate(folder / AUTHORITY), _private(folder / AUTHORITY_KEY)
            except (OSError, ValueError, TypeError) as error:
                raise DataError(
                    f"The authority in {folder} cannot be read ({error}); take a new folder."
                ) from error
            return cls(certificate, key)
        key = _new_key()
        constraints = x509.BasicConstraints(ca=True, path_length=0)
        certificate = _signed("collabslam authority", key.public_key(), None, key, [(constraints, True)])
        _write_private(folder / AUTHORITY_KEY, key)
        write_bytes(folder / AUTHORITY, certificate.public_bytes(serialization.Encoding.PEM))
        return cls(certificate, key)

    def issue(
        self,
        folder: Path,
        name: str,
        alternatives: list[GeneralName],
        *,
        serves: bool = False,
        connects: bool = False,
    ) -> None:
        """Writes key, certificate and the authority's certificate into a folder.

        Who ``connects`` only cannot play the robot, at whatever address.
        """
        from cryptography import x509
        from cryptography.hazmat.primitives import serialization
        from cryptography.x509.oid import ExtendedKeyUsageOID

        key = _new_key()
        uses = {ExtendedKeyUsageOID.SERVER_AUTH: serves, ExtendedKeyUsageOID.CLIENT_AUTH: connects}
        usage = x509.ExtendedKeyUsage([use for use, is_used in uses.items() if is_used])
        extensions: list[tuple[Any, bool]] = [
            (x509.BasicConstraints(ca=False, path_length=None), True),
            (x509.SubjectAlternativeName(alternatives), False),
            (usage, False),
        ]
        certificate = _signed(name, key.public_key(), self._certificate, self._key, extensions)
        pem = serialization.Encoding.PEM
        _write_private(folder / KEY, key)
        write_bytes(folder / CERTIFICATE, certificate.public_bytes(pem))
        write_bytes(folder / AUTHORITY, self._certificate.public_bytes(pem))


def _certificate(path: Path) -> Certificate:
    from cryptography import x509

    return x509.load_pem_x509_certificate(read_bytes(path, MOST_BYTES))


def _private(path: Path) -> Any:
    from cryptography.hazmat.primitives import serialization

    return serialization.load_pem_private_key(read_bytes(path, MOST_BYTES), None)


def _new_key() -> Any:
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _signed(
    name: str, public: Any, issuer: Certificate | None, key: Any, extensions: list[tuple[Any, bool]]
) -> Certificate:
    """A certificate; one that signs itself has no issuer."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes

    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.timezone.utc)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if issuer is None else issuer.subject)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # the device's clock may be behind
        .not_valid_after(now + datetime.timedelta(days=365 * YEARS))
    )
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    return builder.sign(key, hashes.SHA256())


def _write_private(path: Path, key: Any) -> None:
    """A private key that only its owner may read."""
    from cryptography.hazmat.primitives import serialization

    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    write_bytes(path, data, private=True)


def _general(host: str) -> GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        if not _HOST.fullmatch(host):
            raise SettingsError(
                f"The host {host[:80]!r} is neither a name nor an address; give what stands in the address, "
                "as robot.local or 192.168.1.20, without a port."
            ) from None
        return x509.DNSName(host)

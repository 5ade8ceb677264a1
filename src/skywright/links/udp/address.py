"""The address of the gateway, and the key that authenticates packets."""

from __future__ import annotations

import ipaddress
import os
import socket
import stat
from pathlib import Path
from typing import NamedTuple

from skywright.core.bounded import read_bytes
from skywright.errors import InputError

KEY_VARIABLE = "SKYWRIGHT_GATEWAY_KEY"
KEY_MIN, KEY_MAX = 16, 4096  # bytes


class Address(NamedTuple):
    """A numeric host address and a port."""

    host: str
    port: int


def parse_address(text: str, option: str) -> Address:
    """Return the address of `udp:PORT` or `udp:HOST:PORT`; the default HOST is 127.0.0.1.

    Raises InputError that names `option` for anything else, or for a host without an address.
    """
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udp" or not (port.isascii() and port.isdigit() and int(port) <= 65535):
        raise InputError(f"{option} {text[:80]!r}; valid: udp:PORT, udp:HOST:PORT, PORT 0 to 65535")
    try:
        return Address(socket.gethostbyname(host or "127.0.0.1"), int(port))
    except (OSError, UnicodeError):
        raise InputError(f"{option} {text[:80]!r}: the host has no address") from None


def load_key(file: str | os.PathLike[str] | None) -> bytes:
    """Return the key of `file`, else of the environment, else b"".

    A line end after the key is removed. Raises InputError for a file that other users may read, and
    for keys shorter than 16 or longer than 4096 bytes.
    """
    if file is None:
        key, where = os.environ.get(KEY_VARIABLE, "").encode(), f"environment {KEY_VARIABLE}"
        if not key:
            return b""
    else:
        path = Path(file)
        key, where = read_bytes(path, 1_000_000).rstrip(b"\r\n"), str(path)
        if os.name == "posix" and path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise InputError(f"{where}: others may read the key; run: chmod 600 {where}")
    if not KEY_MIN <= len(key) <= KEY_MAX:
        raise InputError(
            f"{where}: a key has {KEY_MIN} to {KEY_MAX} bytes, this one has {len(key)}; "
            "`openssl rand -hex 32` makes one"
        )
    return key


def open_socket(address: Address, key: bytes, option: str) -> socket.socket:
    """Return a socket that listens; raises InputError if that fails, or if a key is required."""
    if not key and not ipaddress.ip_address(address.host).is_loopback:
        raise InputError(
            f"{option}: listening on {address.host} requires a key (--gateway-key FILE or "
            f"{KEY_VARIABLE}); without one only this computer may connect (127.0.0.1)"
        )
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.bind(address)
    except OSError as error:
        opened.close()
        raise InputError(
            f"{option} udp:{address.host}:{address.port}: cannot listen on this address: "
            f"{error.strerror or error}"
        ) from None
    opened.setblocking(False)
    return opened

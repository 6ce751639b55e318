"""The machine file: which server, with which security, and which node of it is which quantity in which unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import yaml

from fsw_control import units

#: cycle counter, permissive bit, what is measured, what acts, and the set-points in force
READ = (
    *("cycle", "permissive", "depth", "torque", "temperature"),
    *("force_acting", "speed_acting", "force_in_force", "speed_in_force"),
)
WRITTEN = ("force_setpoint", "speed_setpoint", "heartbeat")
#: quantities that are numbers with a unit: the kind of the unit
_KIND = {
    "depth": "length",
    "torque": "torque",
    "temperature": "temperature",
    **dict.fromkeys(("force_acting", "force_in_force", "force_setpoint"), "force"),
    **dict.fromkeys(("speed_acting", "speed_in_force", "speed_setpoint"), "speed"),
}
#: by kind and name: factor and offset to the unit inside (mm, N m, degC, kN, rpm)
_UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "length": {"mm": (1.0, 0.0), "m": (units.mm_from_m(1.0), 0.0), "um": (1e-3, 0.0)},
    "torque": {"N m": (1.0, 0.0), "kN m": (1e3, 0.0)},
    "temperature": {"degC": (1.0, 0.0), "K": (1.0, -273.15)},
    "force": {"kN": (1.0, 0.0), "N": (units.kn_from_n(1.0), 0.0)},
    "speed": {"rpm": (1.0, 0.0), "rad/s": (units.rpm_from_rad_s(1.0), 0.0), "1/s": (60.0, 0.0)},
}
_NODE_ID = re.compile(r"(ns=\d+;)?(i=\d+|s=.+|g=[0-9A-Fa-f]{8}(-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}|b=[A-Za-z0-9+/]+=*)")
_SECURITY_FILES = ("certificate", "private_key", "server_certificate")
_POLICIES = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss")
#: by default a value may be so much older than the cycle counter [s]
_STALE_AFTER_S = 0.25


class MachineFileError(ValueError):
    """The machine file is wrong; the message says where, what and what to do."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node of the server.

    Attributes
    ----------
    name : str
        Of ``READ`` or ``WRITTEN``.
    node : str
        Node id; without ``ns=`` it is in the file's namespace.
    stale_after_s : float
        How much older than the cycle counter its value may be.
    factor, offset : float
        From the node's number to the unit inside (mm, N m, degC, kN, rpm): ``factor * number + offset``.
    """

    name: str
    node: str
    stale_after_s: float = _STALE_AFTER_S
    factor: float = 1.0
    offset: float = 0.0

    def inside(self, number: float) -> float:
        """The quantity in the unit inside."""
        return self.factor * number + self.offset

    def number(self, inside: float) -> float:
        """The node's number, from the quantity in the unit inside."""
        return (inside - self.offset) / self.factor


@dataclass(frozen=True, slots=True)
class Security:
    """Sign-and-encrypt, the own certificate and key, and the one server certificate that is trusted."""

    policy: str
    certificate: Path
    private_key: Path
    server_certificate: Path


@dataclass(frozen=True, slots=True)
class User:
    """Who logs in, and the file (or, without one, the environment variable) that holds the password."""

    name: str
    password_file: Path | None = None
    password_env: str = ""


@dataclass(frozen=True, slots=True)
class MachineFile:
    """Content of a machine file.

    Attributes
    ----------
    where : str
        The file's name, for messages.
    endpoint : str
    namespace : str
        URI of the namespace of all node ids without ``ns=``; empty: namespace 0.
    security : Security or None
        None: plain, as ``security: none`` asks for by name.
    user : User or None
    nodes : dict of str to NodeSpec
        By the names of ``READ`` and ``WRITTEN``.
    """

    where: str
    endpoint: str
    namespace: str
    security: Security | None
    user: User | None
    nodes: dict[str, NodeSpec]

    @classmethod
    def load(cls, path: Path) -> MachineFile:
        """Read a machine file; paths in it are relative to its folder.

        Raises
        ------
        MachineFileError
            When it cannot be read or is wrong.
        """
        try:
            return cls.parse(path.read_text(encoding="utf-8"), path.name, path.parent)
        except OSError as error:
            raise MachineFileError(f"machine_file: cannot read {path}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise MachineFileError(f"machine_file: {path} is no text in UTF-8") from None

    @classmethod
    def parse(cls, text: str, where: str = "machine.yaml", folder: Path = Path()) -> MachineFile:
        """Read the text of a machine file; errors as :meth:`load`."""
        try:
            content = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError) as error:
            raise MachineFileError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
        top = _Section(where, "", content)
        top.keys("endpoint", "nodes", "security", optional=("namespace", "user"))
        endpoint = top.text("endpoint")
        try:
            parts = urlsplit(endpoint)
            sound = parts.scheme == "opc.tcp" and parts.hostname and parts.port and not parts.username
        except ValueError:
            sound = False
        top.require(sound, "endpoint", f"{endpoint!r} is none; write opc.tcp://host:port/path, user and password apart")
        security = None
        if content["security"] != "none":
            security = _security(top.section("security", "or write 'security: none' for plain"), folder)
        user = _user(top.section("user"), folder) if "user" in content else None
        if user is not None and security is None:
            top.fail("user", "a password would travel unencrypted; give security, or remove user")
        namespace = top.text("namespace") if "namespace" in content else ""
        return cls(where, endpoint, namespace, security, user, _nodes(top.section("nodes")))


class _Section:
    """A mapping of the file, and errors that say where it is."""

    def __init__(self, where: str, path: str, content: Any, hint: str = "") -> None:
        self.where, self.path, self.content = where, path, content
        if not isinstance(content, Mapping):
            what = f"{path} must be a mapping" if path else "must be a mapping with endpoint, security and nodes"
            raise MachineFileError(f"{where}: {what}{f' ({hint})' if hint else ''}")

    def fail(self, key: str, text: str) -> None:
        raise MachineFileError(f"{self.where}: {f'{self.path}.' if self.path else ''}{key}: {text}")

    def require(self, met: object, key: str, text: str) -> None:
        if not met:
            self.fail(key, text)

    def keys(self, *needed: str, optional: tuple[str, ...] = ()) -> None:
        known = (*needed, *optional)
        for key in self.content:
            if key not in known:
                near = get_close_matches(str(key), known, 1)
                self.fail(str(key), f"unknown; {f'did you mean {near[0]}?' if near else 'known: ' + ', '.join(known)}")
        for key in needed:
            if key not in self.content:
                hint = "; for a plain connection write 'security: none'" if key == "security" else ""
                self.fail(key, f"missing{hint}")

    def text(self, key: str) -> str:
        value = self.content[key]
        self.require(isinstance(value, str) and value.strip(), key, f"{value!r} is not a text")
        return str(value).strip()

    def number(self, key: str, default: float) -> float:
        value = self.content.get(key, default)
        sound = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        self.require(sound, key, f"{value!r} is not a finite number")
        return float(value)

    def section(self, key: str, hint: str = "") -> _Section:
        return _Section(self.where, f"{self.path}.{key}" if self.path else key, self.content[key], hint)


def _security(section: _Section, folder: Path) -> Security:
    section.keys("policy", *_SECURITY_FILES)
    policy = section.text("policy")
    section.require(policy in _POLICIES, "policy", f"{policy!r} is none of {', '.join(_POLICIES)}")
    return Security(policy, *(folder / Path(section.text(name)).expanduser() for name in _SECURITY_FILES))


def _user(section: _Section, folder: Path) -> User:
    if "password" in section.content:
        section.fail("password", "must not be in this file; write password_file or password_env")
    section.keys("name", optional=("password_file", "password_env"))
    ways = [key for key in ("password_file", "password_env") if key in section.content]
    section.require(len(ways) == 1, "name", "give either password_file or password_env with it")
    if ways == ["password_env"]:
        return User(section.text("name"), password_env=section.text("password_env"))
    return User(section.text("name"), folder / Path(section.text("password_file")).expanduser())


def _nodes(section: _Section) -> dict[str, NodeSpec]:
    section.keys(*READ, *WRITTEN)
    return {name: _node(section.section(name), name) for name in (*READ, *WRITTEN)}


def _node(section: _Section, name: str) -> NodeSpec:
    kind = _KIND.get(name)
    optional = () if name in (*WRITTEN, "cycle") else ("stale_after_s",)
    if kind is not None and "unit" not in section.content:
        section.fail("unit", f"missing; give one of {', '.join(_UNITS[kind])}")
    section.keys("node", *(("unit",) if kind else ()), optional=(*optional, *(("scale", "offset") if kind else ())))
    node = section.text("node")
    section.require(
        _NODE_ID.fullmatch(node), "node", f"{node!r} is not a node id; write e.g. ns=2;s=Weld.Depth or ns=2;i=1001"
    )
    stale_after_s = section.number("stale_after_s", _STALE_AFTER_S)
    section.require(stale_after_s > 0.0, "stale_after_s", f"{stale_after_s:g} must be above 0")
    if kind is None:
        return NodeSpec(name, node, stale_after_s)
    unit = section.text("unit")
    section.require(
        unit in _UNITS[kind], "unit", f"{unit!r} is no unit of {kind}; give one of {', '.join(_UNITS[kind])}"
    )
    factor, offset = _UNITS[kind][unit]
    scale = section.number("scale", 1.0)
    section.require(scale, "scale", "must not be 0")
    return NodeSpec(name, node, stale_after_s, factor * scale, factor * section.number("offset", 0.0) + offset)

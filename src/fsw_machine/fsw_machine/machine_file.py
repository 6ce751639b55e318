"""The machine file: the server, its security, and the node and unit of each quantity."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar
from urllib.parse import urlsplit

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PositiveFloat,
    create_model,
    model_validator,
)

from fsw_control import units, weld
from fsw_control.schema.models import Model, content_of, problem, read_text, validate
from fsw_control.schema.ranges import Range
from fsw_control.sensors import DEPTH_CHANNELS, SENSORS

_NODE_ID = re.compile(
    r"(ns=\d+;)?(i=\d+|s=.+|g=[0-9A-Fa-f]{8}(-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}"
    r"|b=[A-Za-z0-9+/]+=*)"
)
#: factor and offset from each unit to the internal one (mm, N m, degC, kN, rpm)
_UNITS = {
    **{"mm": (1.0, 0.0), "m": (units.mm_from_m(1.0), 0.0), "um": (1e-3, 0.0)},
    **{"N m": (1.0, 0.0), "kN m": (1e3, 0.0)},
    **{"degC": (1.0, 0.0), "K": (1.0, -273.15)},
    **{"kN": (1.0, 0.0), "N": (units.kn_from_n(1.0), 0.0)},
    "deg": (1.0, 0.0),
    **{"rpm": (1.0, 0.0), "rad/s": (units.rpm_from_rad_s(1.0), 0.0), "1/s": (60.0, 0.0)},
}
_Length = Literal["mm", "m", "um"]
_Torque = Literal["N m", "kN m"]
_Temperature = Literal["degC", "K"]
_Force = Literal["kN", "N"]
_Speed = Literal["rpm", "rad/s", "1/s"]
U = TypeVar("U", bound=str)


def _file(value: Any) -> Path:
    if not isinstance(value, str) or not value:
        raise ValueError(f"is {value!r}, not the name of a file")
    return Path(value).expanduser()


def _endpoint(value: str) -> str:
    try:
        parts = urlsplit(value)
        sound = parts.scheme == "opc.tcp" and parts.hostname and parts.port and not parts.username
    except ValueError:
        sound = False
    if not sound:
        text = "write opc.tcp://host:port/path, without user and password"
        raise ValueError(f"is not an endpoint; {text}")
    return value


def _node_id(value: str) -> str:
    if not _NODE_ID.fullmatch(value):
        text = f"is {value!r}, not a node id"
        raise ValueError(f"{text}; write e.g. ns=2;s=Weld.Depth or ns=2;i=1001")
    return value


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("must not be 0")
    return value


def _security(value: Any) -> Any:
    if value is None:
        raise ValueError("lacks security; for a plain connection write 'security: none'")
    return None if value == "none" else value


def _or_none(schema: dict[str, Any]) -> None:
    schema["anyOf"] = [{"const": "none"}, {"$ref": schema.pop("$ref")}]


_File = Annotated[Path, BeforeValidator(_file)]
_Word = Annotated[str, Field(min_length=1)]


class NodeSpec(Model):
    """A node of the server."""

    node: Annotated[str, AfterValidator(_node_id)]
    """node id, e.g. ns=2;s=Weld.Depth; without ``ns=`` in the file's namespace"""


class ReadNode(NodeSpec):
    """A node that is read in every cycle."""

    stale_after_s: PositiveFloat = 0.25
    """largest age relative to the cycle counter"""


class Quantity(NodeSpec, Generic[U]):
    """A node with a quantity: ``factor * number + offset`` in the internal unit (mm, N m, ...)."""

    unit: U
    scale: Annotated[float, AfterValidator(_not_zero)] = 1.0
    """multiplies the node's number"""
    offset: float = 0.0
    """added after the factor, in ``unit``"""

    def inside(self, number: float) -> float:
        """The quantity in the internal unit."""
        factor, offset = _UNITS[self.unit]
        return factor * (self.scale * number + self.offset) + offset

    def number(self, inside: float) -> float:
        """The node's number for a quantity in the internal unit."""
        factor, offset = _UNITS[self.unit]
        return ((inside - offset) / factor - self.offset) / self.scale


class Measured(Quantity[U], ReadNode):
    """A quantity that is read in every cycle."""


class _Machine(Model):
    """Nodes of the machine itself."""

    cycle: NodeSpec
    """cycle counter"""
    permissive: ReadNode
    """whether commands are permitted"""


_MEASURED: dict[str, Any] = {
    "depth": Measured[_Length],
    "torque": Measured[_Torque],
    "temperature": Measured[_Temperature],
}
if TYPE_CHECKING:
    _Sensors = _Machine
else:  # a node for each sensor; optional unless control requires it: the depth may be fused
    _KINDS = {
        row.stem: (_MEASURED[row.quantity.name], row.required and row.stem != "depth")
        for row in SENSORS.values()
    }
    _Sensors = create_model(
        "_Sensors",
        __base__=_Machine,
        **{
            stem: (kind, ...) if required else (kind | None, None)
            for stem, (kind, required) in _KINDS.items()
        },
    )


class Nodes(_Sensors):
    """The nodes by name."""

    force_acting: Measured[_Force]
    speed_acting: Measured[_Speed]
    force_in_force: Measured[_Force]
    speed_in_force: Measured[_Speed]
    force_setpoint: Quantity[_Force]
    speed_setpoint: Quantity[_Speed]
    heartbeat: NodeSpec
    """counter value that the set-points answer"""
    touch_off: ReadNode | None = None
    """number of touch-offs of the depth sensors, for ``depth_fusion``"""
    travel: Measured[_Length] | None = None
    """distance that the tool has travelled; without it an edge of the surface is a slip"""
    angle: Measured[Literal["deg"]] | None = None
    """angle of the tool, for a footprint"""

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)

    @property
    def given(self) -> dict[str, NodeSpec]:
        """The nodes present at the machine."""
        return {name: spec for name, spec in self if spec is not None}

    @property
    def read(self) -> tuple[str, ...]:
        """Names of the nodes that are read in every cycle, the cycle counter first."""
        return tuple(name for name in self.given if name not in WRITTEN)


WRITTEN = ("force_setpoint", "speed_setpoint", "heartbeat")


class DepthFusionPart(Model):
    """Makes the depth of the nodes ``depth_laser`` etc. instead of a node ``depth``."""

    touch_off_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_KN
    """Axial force at the touch-off."""
    footprint_file: _File | None = None
    """JSON file of fsw.py footprint, of an earlier weld on the machine"""


class Security(Model):
    """Sign-and-encrypt, our certificate and key, and the one trusted server certificate."""

    policy: Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]
    certificate: _File
    private_key: _File
    server_certificate: _File


class User(Model):
    """The user, and the file or environment variable with the password."""

    name: _Word
    password_file: _File | None = None
    password_env: str = ""

    @model_validator(mode="after")
    def _check_password(self) -> User:
        if (self.password_file is None) == (not self.password_env):
            raise ValueError("needs either password_file or password_env")
        return self


class MachineFile(Model):
    """Content of a machine file; with ``security: none`` the connection is plain."""

    endpoint: Annotated[str, AfterValidator(_endpoint)]
    namespace: str = ""
    """URI of the namespace of all node ids without ``ns=``; empty: namespace 0"""
    security: Annotated[Security | None, BeforeValidator(_security)] = Field(
        default=None, validate_default=True, json_schema_extra=_or_none
    )
    user: User | None = None
    nodes: Nodes
    depth_fusion: DepthFusionPart | None = None

    @property
    def depth_sensors(self) -> tuple[str, ...]:
        """The sensors (of ``DEPTH_CHANNELS``) of which the machine has a node."""
        return tuple(name for name in DEPTH_CHANNELS if SENSORS[name].stem in self.nodes.given)

    @model_validator(mode="after")
    def _check_depth(self) -> MachineFile:
        named = self.nodes.given
        if self.depth_fusion is None:
            if "depth" not in named:
                raise problem("lacks depth; give it, or depth_fusion", "nodes")
            return self
        if "depth" in named:
            raise problem("contradicts depth_fusion, which makes the depth", "nodes", "depth")
        if not self.depth_sensors:
            raise problem(f"needs one of the nodes {', '.join(DEPTH_CHANNELS)}", "depth_fusion")
        if "touch_off" not in named:
            raise problem("lacks touch_off, with which depth_fusion begins afresh", "nodes")
        return self

    @model_validator(mode="after")
    def _check_user(self) -> MachineFile:
        if self.user is not None and self.security is None:
            text = "would send its password unencrypted; give security, or remove user"
            raise problem(text, "user")
        return self

    @classmethod
    def load(cls, path: Path) -> MachineFile:
        """Read a machine file; paths in it are relative to its folder.

        Raises
        ------
        fsw_control.schema.models.InputError
            If it cannot be read or is invalid.
        """
        return cls.parse(read_text(path, "machine_file"), path.name, path.parent)

    @classmethod
    def parse(cls, text: str, where: str = "machine.yaml", folder: Path = Path()) -> MachineFile:
        """Read the text of a machine file; errors as in :meth:`load`."""
        machine = validate(cls, content_of(text, where), where)
        parts = {name: getattr(machine, name) for name in ("security", "user", "depth_fusion")}
        placed = {name: _beside(folder, part) for name, part in parts.items()}
        return machine.model_copy(update=placed)


def _beside(folder: Path, part: Model | None) -> Model | None:
    """Return a part of the file with paths relative to the folder."""
    paths = {name: folder / value for name, value in part or () if isinstance(value, Path)}
    return part and part.model_copy(update=paths)

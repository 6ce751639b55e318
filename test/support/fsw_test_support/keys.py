"""Key pairs as ``ssh-keygen -t ed25519`` makes them, also where it is not installed."""

from __future__ import annotations

from pathlib import Path


def make_key(path: Path) -> None:
    """Write ``path``, readable by its owner only, and ``path.pub``."""
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.OpenSSH, form.NoEncryption())
    public = key.public_key().public_bytes(form.Encoding.OpenSSH, form.PublicFormat.OpenSSH)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    path.write_bytes(text)
    path.with_name(f"{path.name}.pub").write_bytes(public + b" test\n")

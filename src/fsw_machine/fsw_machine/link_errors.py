"""Errors of the connection as one-line texts with a remedy."""

from __future__ import annotations

from asyncua import ua

from fsw_machine.certificates import SecurityError
from fsw_machine.machine_file import MachineFile

_USER = {
    "BadUserAccessDenied",
    "BadIdentityTokenRejected",
    "BadIdentityTokenInvalid",
    "BadUserSignatureInvalid",
}
_OWN_CERTIFICATE = {
    "BadCertificateUntrusted",
    "BadCertificateInvalid",
    "BadCertificateTimeInvalid",
    "BadCertificateUriInvalid",
    "BadCertificateUseNotAllowed",
    "BadCertificateChainIncomplete",
    "BadCertificateRevoked",
    "BadSecurityChecksFailed",
    "BadCertificateHostNameInvalid",
    "BadSecurityModeRejected",
}


class LinkError(RuntimeError):
    """The server does not match the machine file; the message names the entry and the remedy."""


def words(error: BaseException, machine: MachineFile) -> str:
    """Text of an error of the connection, in one line."""
    url = f"endpoint {machine.endpoint}"
    if isinstance(error, LinkError | SecurityError):
        return str(error)
    if isinstance(error, ua.UaStatusCodeError):
        is_known = type(error) is not ua.UaStatusCodeError
        name = type(error).__name__ if is_known else f"status {error.code:#010x}"
        if name in _USER:
            if machine.user is None:
                return f"user: {url} requires a user ({name}); give user.name and its password"
            source = machine.user.password_file or f"the variable {machine.user.password_env}"
            user = repr(machine.user.name)
            return f"user: {url} rejects {user} with the password in {source} ({name})"
        if name in _OWN_CERTIFICATE and machine.security is not None:
            text = f"{url} does not accept our security.certificate {machine.security.certificate}"
            return f"{text} ({name}); put it into the server's trust list"
        if name in ("BadSecurityPolicyRejected", "BadSecurityModeInsufficient"):
            return f"security: {url} rejects it ({name}); check the server's configuration"
        return f"{url}: {name}"
    if machine.security is None and "No matching endpoints" in str(error):
        return f"security: {url} requires security; give policy, certificate, ..."
    if isinstance(error, TimeoutError):
        return f"{url}: no answer in time"
    if isinstance(error, OSError):
        return f"{url}: no connection ({error.strerror or error or type(error).__name__})"
    return f"{url}: {type(error).__name__}: {' '.join(str(error).split())[:200]}"

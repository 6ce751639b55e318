"""The encrypted page, and certificates and keys that cannot be used."""

import socket
import ssl

import pytest

from fsw_hmi import main
from fsw_hmi.web_server import tls_context
from fsw_test_support.certificates import make
from fsw_test_support.page_client import PATIENCE_S, Page

TOKEN = "a token of some length"


def pair(folder, name="page"):
    """Certificate and key in PEM."""
    der, key = make(folder, name, "urn:page", ["localhost", "127.0.0.1"])
    certificate = der.with_suffix(".pem")
    certificate.write_text(ssl.DER_cert_to_PEM_cert(der.read_bytes()))
    return str(certificate), str(key)


@pytest.fixture
def files(tmp_path):
    return pair(tmp_path)


@pytest.mark.slow
def test_page_is_encrypted_and_commands_go_through(make_server, files):
    server = make_server(encrypted=tls_context(*files))
    assert server.url.startswith("https://127.0.0.1:")
    with Page(server.url, ssl=ssl.create_default_context(cafile=files[0])) as page:
        assert page.log_in(TOKEN)["outcome"] == "done"
        page.send("safe_stop")
        assert server.next_order().asked == "safe stop"


@pytest.mark.slow
@pytest.mark.requirement("S30")
def test_handshakes_that_never_end_shut_no_new_page_out_and_are_closed(make_server, files):
    server = make_server(encrypted=tls_context(*files))
    strangers = [
        socket.create_connection(("127.0.0.1", server.port), PATIENCE_S) for _ in range(300)
    ]
    with Page(server.url, ssl=ssl.create_default_context(cafile=files[0])) as page:
        assert page.receive()["t"] == "hello"
        server.gate._request_s = (
            0.0  # from here on, so that it does not matter how long the page has taken
        )
        for stranger in strangers:
            assert (
                stranger.recv(1) == b""
            )  # the oldest at once, the others when their time is over
            stranger.close()
        page.until("beat")


def test_certificate_that_is_good_is_taken_and_none_is_none(files):
    assert tls_context(*files).minimum_version >= ssl.TLSVersion.TLSv1_2
    assert tls_context("", "") is None


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda cert, key: (cert, ""), "tls_cert, tls_key: give both or neither"),
        (lambda cert, key: ("", key), "tls_cert, tls_key: give both or neither"),
        (lambda cert, key: (cert + "x", key), "tls_cert: .*No such file"),
        (lambda cert, key: (cert, key + "x"), "tls_key: cannot read .*: No such file"),
        (lambda cert, key: (key, key), "tls_cert: .*key.pem with"),
        (lambda cert, key: (cert, cert), "tls_key: .*chmod 600"),
        (lambda cert, key: (cert.replace(".pem", ".der"), key), "tls_cert: .*der with"),
    ],
)
def test_files_that_cannot_be_used_are_told_in_a_line(files, change, text):
    with pytest.raises(ValueError, match=text) as error:
        tls_context(*change(*files))
    assert "\n" not in str(error.value)


def test_key_of_another_certificate_is_refused(files, tmp_path):
    other = pair(tmp_path, "other")
    with pytest.raises(ValueError, match=f"{other[1]}: KEY_VALUES_MISMATCH"):
        tls_context(files[0], other[1])


def test_key_that_others_may_read_or_that_is_none_or_has_a_password_is_told(files, tmp_path):
    from cryptography.hazmat.primitives import serialization

    certificate, key = files
    path = tmp_path / "page_key.pem"
    loaded = serialization.load_pem_private_key(path.read_bytes(), None)
    path.chmod(0o640)
    with pytest.raises(ValueError, match=f"others may read {path} .*chmod 600"):
        tls_context(certificate, key)
    path.chmod(0o600)
    way = serialization.BestAvailableEncryption(b"secret")
    path.write_bytes(
        loaded.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, way)
    )
    for _ in range(2):
        with pytest.raises(ValueError, match=f"with tls_key {path}: "):
            tls_context(certificate, key)
        path.write_text("nothing")


@pytest.mark.slow
@pytest.mark.parametrize("bag", [False, True])
def test_key_of_another_certificate_ends_the_server_with_a_line(
    domain_id, capfd, files, tmp_path, bag
):
    key = pair(tmp_path, "other")[1]
    given = ["--bag", str(tmp_path)] if bag else ["--port", "0"]
    assert main.main(["run_hmi.py", *given, "--tls-cert", files[0], "--tls-key", key]) == 2
    assert "KEY_VALUES_MISMATCH" in capfd.readouterr().err.strip().splitlines()[-1]

"""The server's start with named users, and what it refuses to start with."""

import threading

import pytest

from fsw_control.schema.extensions import Extra
from fsw_hmi import hmi_node, main, users
from fsw_hmi.web import PageFiles
from fsw_test_support.page_client import PATIENCE_S, Page

pytestmark = pytest.mark.slow
PASSWORD = "correct horse battery"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "users.yaml"
    users.write(path, [users.new_user("otto", PASSWORD)])
    return path


def broken(file):
    file.write_text(file.read_text().replace("argon2id", "scrypt"))


@pytest.mark.parametrize(
    ("change", "more", "text"),
    [
        (broken, [], "users.yaml: [0].password is no hash of Argon2: delete the file"),
        (lambda file: file.chmod(0o644), [], "others may read"),
        (
            lambda file: file.write_text("[]"),
            [],
            "has no user: add one with 'fsw.py hmi user add'",
        ),
        (lambda file: file.unlink(), [], "No such file"),
        (lambda file: None, ["--token-file", "token"], "users_file, token_file: give one of them"),
        (lambda file: None, ["--tls-cert", "cert.pem"], "tls_cert, tls_key: give both or neither"),
    ],
)
def test_server_does_not_start_with_what_is_wrong_and_says_why_in_a_line(
    domain_id, file, capfd, change, more, text
):
    change(file)
    assert main.main(["run_hmi.py", "--port", "0", "--users-file", str(file), *more]) == 2
    said = capfd.readouterr()
    assert text in said.err.strip().splitlines()[-1]
    assert "token:" not in said.out


def test_named_user_commands_and_no_token_is_printed(domain_id, file, capsys, folder, monkeypatch):
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter

    monkeypatch.setattr(hmi_node, "PageFiles", lambda source: PageFiles(source, folder))
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain_id)
    given = {"port": 0, "users_file": str(file)}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = hmi_node.HmiNode(context=context, parameter_overrides=overrides)
    said = capsys.readouterr().out
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        assert "token" not in said
        with Page(said.split()[-1]) as page:
            assert page.log_in("token", "otto")["code"] == "wrong_password"
            page.command(PASSWORD, "OTTO")
            assert page.seen("control", lambda frame: frame["you"])["holder"]["name"] == "otto"
    finally:
        executor.shutdown()
        thread.join(PATIENCE_S)
        node.destroy_node()
        context.try_shutdown()


def test_without_its_libraries_it_says_what_to_install_in_a_line(monkeypatch, capsys):
    monkeypatch.setattr(main, "EXTRA", Extra("fsw-control", "hmi", ("starlett", "uvicorn")))
    assert main.main(["hmi"]) == 2
    assert "starlett " in capsys.readouterr().err

"""Where files are kept, and how they appear whole."""

import errno
import fcntl
import os
import socket
import stat
import tempfile

import pytest

from fsw_control.schema.files import (
    locked,
    open_regular,
    read_regular,
    replacing,
    user_cache,
    write_whole,
)


@pytest.mark.parametrize(
    ("variable", "folder"), [("/kept", "kept"), ("kept", "anna/.cache"), ("", "anna/.cache")]
)
def test_cache_is_where_the_user_says_if_that_is_absolute(monkeypatch, tmp_path, variable, folder):
    monkeypatch.setenv("HOME", str(tmp_path / "anna"))
    monkeypatch.setenv(
        "XDG_CACHE_HOME", f"{tmp_path}{variable}" if variable[:1] == "/" else variable
    )
    assert user_cache("fsw_x") == tmp_path / folder / "fsw_x"
    assert (tmp_path / folder / "fsw_x").is_dir()


@pytest.fixture
def private(monkeypatch, tmp_path):
    """The folder that is used where HOME cannot be written; there is none yet."""
    monkeypatch.setenv("HOME", "/proc/none")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"fsw-{os.getuid()}"


def test_without_a_home_the_cache_is_private(private):
    assert user_cache("fsw_x") == user_cache("fsw_x") == private / "fsw_x"
    assert stat.S_IMODE(private.stat().st_mode) == 0o700


def test_no_cache_is_taken_that_others_can_write(private, tmp_path):
    private.symlink_to(tmp_path)
    with pytest.raises(PermissionError):
        user_cache("fsw_x")
    private.unlink()
    private.mkdir()
    private.chmod(0o777)
    with pytest.raises(PermissionError):
        user_cache("fsw_x")


def test_file_is_the_old_one_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "weld.csv"
    path.write_text("old")
    with replacing(path) as scratch, replacing(path) as other:
        scratch.write_text("new")
        assert (path.read_text(), scratch.suffix, scratch != other) == ("old", ".csv", True)
        other.write_text("in between")
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_is_replaced_after_an_error_and_nothing_is_left(tmp_path):
    path = tmp_path / "weld.csv"
    path.write_text("old")
    with pytest.raises(KeyError), replacing(path) as scratch:
        scratch.write_text("half")
        raise KeyError
    assert (path.read_text(), list(tmp_path.iterdir())) == ("old", [path])


def test_mode_of_a_secret_file(tmp_path):
    with replacing(tmp_path / "secret", 0o600) as scratch:
        assert stat.S_IMODE(scratch.stat().st_mode) == 0o600


def test_error_names_the_file_that_was_meant(tmp_path):
    with pytest.raises(FileNotFoundError) as raised, replacing(tmp_path / "none" / "weld.csv"):
        pass
    assert raised.value.filename == str(tmp_path / "none" / "weld.csv")


def test_error_of_a_write_names_the_file_that_was_meant(tmp_path):
    with pytest.raises(OSError, match="No space") as raised, replacing(tmp_path / "weld.csv"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert (raised.value.filename, list(tmp_path.iterdir())) == (str(tmp_path / "weld.csv"), [])


def test_replacing_keeps_devices_and_follows_links(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    with replacing(pipe) as scratch:
        assert scratch == pipe
    link.symlink_to(tmp_path / "weld.csv")
    write_whole(link, "new")
    assert (link.is_symlink(), (tmp_path / "weld.csv").read_text(), pipe.is_fifo()) == (
        True,
        "new",
        True,
    )


@pytest.mark.parametrize("content", ["30 °C\n", b"30 \xc2\xb0C\n"])
def test_a_whole_file_has_its_content_and_mode(tmp_path, content):
    write_whole(tmp_path / "secret", content, 0o600, durable=True)
    assert (tmp_path / "secret").read_bytes() == b"30 \xc2\xb0C\n"
    assert stat.S_IMODE((tmp_path / "secret").stat().st_mode) == 0o600
    assert len(list(tmp_path.iterdir())) == 1


def test_only_one_at_a_time_works_in_a_folder(tmp_path):
    folder = tmp_path / "new" / "chain"
    with locked(folder):
        other = os.open(folder, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)


@pytest.mark.timeout(30)
@pytest.mark.parametrize("read", [open_regular, read_regular])
def test_only_regular_files_are_opened_and_nothing_waits(tmp_path, read):
    pipe, socket_path = tmp_path / "pipe", tmp_path / "socket"
    os.mkfifo(pipe)
    places = [(pipe, errno.EINVAL), ("/dev/zero", errno.EINVAL)]
    places += [(tmp_path, errno.EISDIR), (tmp_path / "none", errno.ENOENT)]
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(socket_path))
        for path, problem in [*places, (socket_path, errno.EINVAL)]:
            with pytest.raises(OSError) as raised:
                read(path)
            assert (raised.value.errno, str(raised.value.filename)) == (problem, str(path))


def test_file_is_read_up_to_a_bound(tmp_path):
    path = tmp_path / "weld.yaml"
    path.write_bytes(b"a: 1")
    (tmp_path / "link").symlink_to(path)
    assert read_regular(path, 4) == read_regular(str(tmp_path / "link")) == b"a: 1"
    # files of /proc have no size before they are read
    for too_large in (path, "/proc/self/status"):
        with pytest.raises(OSError, match="3 bytes") as raised:
            read_regular(too_large, 3)
        assert raised.value.filename == str(too_large)

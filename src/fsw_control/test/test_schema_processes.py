"""Compilers and npm do not inherit the libraries of ROS 2's wheels."""

import os
import sys

import pytest

from fsw_control.c_library import tool_environment


def test_wheels_are_left_out_and_the_users_path_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "1")
    monkeypatch.setenv("LD_LIBRARY_PATH", os.pathsep.join([f"{sys.prefix}/lib", "/opt/mine"]))
    environment = tool_environment()
    assert (
        environment["LD_LIBRARY_PATH"] == "/opt/mine"
        and "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in environment
    )
    monkeypatch.setenv("LD_LIBRARY_PATH", f"{sys.prefix}/lib")
    assert "LD_LIBRARY_PATH" not in tool_environment()


def test_path_of_a_sourced_ros_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", raising=False)
    monkeypatch.setenv("LD_LIBRARY_PATH", "/opt/ros/jazzy/lib")
    assert tool_environment()["LD_LIBRARY_PATH"] == "/opt/ros/jazzy/lib"

"""Fixtures of the tests of fsw_experiment."""

from fsw_test_support.bags import genuine, genuine_bag, weld_bag

__all__ = ["genuine", "genuine_bag", "weld_bag"]

"""Fixtures of the tests of fsw_campaign."""

from fsw_test_support.small_campaign import folder, small

__all__ = ["folder", "small"]

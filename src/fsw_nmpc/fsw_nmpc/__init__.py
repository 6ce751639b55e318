"""Nonlinear model predictive control of depth and temperature."""

from fsw_nmpc.controller import NmpcController

__all__ = ["NmpcController"]

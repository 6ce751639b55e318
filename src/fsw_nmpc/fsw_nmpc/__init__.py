"""Nonlinear model predictive control of depth and temperature."""

# To other packages the NMPC is what its parameters make of it, as every controller.
from fsw_nmpc.configured import ConfiguredNmpc as NmpcController

__all__ = ["NmpcController"]

"""Decentralized control of the weld: one loop for temperature, one for depth."""

from fsw_decentral.controller import DecentralController
from fsw_decentral.parameters import Gains, tunings

__all__ = ["DecentralController", "Gains", "tunings"]

"""The controllers on canisters that conduct heat, a plant that the NMPC does not know."""

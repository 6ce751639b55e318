"""Sixty canisters welded in sequence, and what their history shows."""

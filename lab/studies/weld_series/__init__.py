"""Sixty canisters welded one after another, and what their history tells."""

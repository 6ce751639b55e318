"""Commands of the quality distribution."""

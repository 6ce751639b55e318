"""What tests and benchmarks of several packages share."""

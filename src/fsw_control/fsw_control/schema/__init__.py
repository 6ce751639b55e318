"""Schemas, ranges and YAML of files and requests that people write."""

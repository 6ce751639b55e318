"""What people write in files and requests: its schema, ranges and YAML."""

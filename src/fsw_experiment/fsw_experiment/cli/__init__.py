"""The operator's command ``fsw.py``."""

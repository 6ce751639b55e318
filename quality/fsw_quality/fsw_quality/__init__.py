"""The welding procedure as data, and the record of a weld.

What was asked for, what was kept, and the verdict.
"""

"""The welding procedure as data, and the record of a weld: what was asked for, what was kept, and the verdict."""

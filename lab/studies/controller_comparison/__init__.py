"""The controllers compared on the same welds.

Nominal, with noise, on other processes, and against what is possible.
"""

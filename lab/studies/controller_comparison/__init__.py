"""The controllers compared on the same welds: nominal, with noise, on other processes, and against what is possible."""

"""Interfaces of std_srvs, without generated code."""

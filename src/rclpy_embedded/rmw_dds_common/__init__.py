"""Interfaces of rmw_dds_common, without generated code."""

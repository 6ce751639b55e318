"""Conversions between the paper's units (inside) and SI (on the wire)."""

from math import pi

RAD_PER_S_PER_RPM = pi / 30.0
KW_PER_NM_RPM = RAD_PER_S_PER_RPM * 1e-3
#: per second
NANOSECONDS = 1_000_000_000


def mm_from_m(value_m: float) -> float:
    """mm from m."""
    return value_m * 1e3


def m_from_mm(value_mm: float) -> float:
    """m from mm."""
    return value_mm * 1e-3


def kn_from_n(value_n: float) -> float:
    """kN from N."""
    return value_n * 1e-3


def n_from_kn(value_kn: float) -> float:
    """N from kN."""
    return value_kn * 1e3


def rpm_from_rad_s(value_rad_s: float) -> float:
    """rpm from rad/s."""
    return value_rad_s / RAD_PER_S_PER_RPM


def rad_s_from_rpm(value_rpm: float) -> float:
    """rad/s from rpm."""
    return value_rpm * RAD_PER_S_PER_RPM


def w_from_kw(value_kw: float) -> float:
    """W from kW."""
    return value_kw * 1e3


def kw_from_w(value_w: float) -> float:
    """kW from W."""
    return value_w * 1e-3


_TO_SI = {"mm": m_from_mm, "kN": n_from_kn, "rpm": rad_s_from_rpm, "kW": w_from_kw}
_FROM_SI = {"mm": mm_from_m, "kN": kn_from_n, "rpm": rpm_from_rad_s, "kW": kw_from_w}


def to_si(value: float, unit: str) -> float:
    """A value in one of the units inside, as on the wire."""
    return _TO_SI.get(unit, float)(value)


def from_si(value: float, unit: str) -> float:
    """A value from the wire in one of the units inside."""
    return _FROM_SI.get(unit, float)(value)

"""What each quantity may be written in: turns and radians are told apart, everything else is refused."""

import math

import pytest

from modelling.errors import InputError
from modelling.units import factor, to_si

RPM = 2 * math.pi / 60
POUND, GRAVITY, FOOT = 0.45359237, 9.80665, 0.3048  # kg, m/s², m, exact by definition
FACTORS = [
    *((text, "rad/s", RPM) for text in (
        "1/min", "1/ min", "1/minute", "1/minutes", "/min", "min-1", "min^-1", "min**-1", "min⁻¹", "min^(-1)", "rpm",
        "RPM", "U/min", "u/min", "rev/min", "r/min", "turn/min", "turns/minute", "tr/min")),
    ("rev/s", "rad/s", 2 * math.pi), ("deg/s", "rad/s", math.pi / 180), ("°/s", "rad/s", math.pi / 180),
    ("rad/min", "rad/s", 1 / 60), ("mrad/s", "rad/s", 1e-3),
    *((text, "N*m", 1.0) for text in ("N*m", "N·m", "Nm", "N.m", "N-m", "N m", "newton metre", "kg*m^2/s^2")),
    ("kNm", "N*m", 1e3), ("mN*m", "N*m", 1e-3), ("Ncm", "N*m", 1e-2), ("N*mm", "N*m", 1e-3),
    *((text, "N*m", POUND * GRAVITY * FOOT) for text in ("lbf*ft", "lb*ft", "ft-lb", "ft·lb", "ft lbf")),
    *((text, "N*m", POUND * GRAVITY * FOOT / 12) for text in ("in·lb", "lbf*in", "in-lb")), ("cNm", "N*m", 1e-2),
    ("lbm·ft²", "kg*m^2", POUND * FOOT**2), ("lb·in·s²", "kg*m^2", POUND * GRAVITY * FOOT / 12),
    ("oz·in·s²", "kg*m^2", POUND / 16 * GRAVITY * FOOT / 12), ("kgcm²", "kg*m^2", 1e-4),
    ("slug·ft²", "kg*m^2", POUND * GRAVITY / FOOT * FOOT**2), ("mph", "m/s", 1609.344 / 3600), ("kph", "m/s", 1 / 3.6),
    ("GPa", "Pa", 1e9), ("MPa", "Pa", 1e6), ("N/mm²", "Pa", 1e6), ("psi", "Pa", POUND * GRAVITY / (FOOT / 12) ** 2),
    ("in·lb/deg", "N*m/rad", POUND * GRAVITY * FOOT / 12 * 180 / math.pi),
    ("N*m", "N*m/rad", 1.0), ("Nm/rad", "N*m/rad", 1.0), ("kN*m/deg", "N*m/rad", 180e3 / math.pi),
    ("N*m/rev", "N*m/rad", 1 / (2 * math.pi)), ("N*m/rad^3", "N*m/rad^3", 1.0),
    ("N*m*s", "N*m*s/rad", 1.0), ("Nms/rad", "N*m*s/rad", 1.0), ("N*m/(rad/s)", "N*m*s/rad", 1.0),
    ("N*m/rpm", "N*m*s/rad", 1 / RPM), ("N*m/(1/min)", "N*m*s/rad", 1 / RPM), ("N*m*min", "N*m*s/rad", 1 / RPM),
    ("N*m/(1/min)^2", "N*m*s^2/rad^2", 1 / RPM**2),
    ("g*cm^2", "kg*m^2", 1e-7), ("kgm2", "kg*m^2", 1.0), ("kg m²", "kg*m^2", 1.0), ("N*m*s^2", "kg*m^2", 1.0),
    ("N*m*s^2/rad", "kg*m^2", 1.0), ("kg*m^2/rad^2", "kg*m^2", 1.0),
    ("kHz", "Hz", 1e3), ("1/s", "Hz", 1.0), ("1/min", "Hz", 1 / 60), ("rpm", "Hz", 1 / 60),
    ("rad/s", "Hz", 1 / (2 * math.pi)), ("rpm/s", "rad/s^2", RPM), ("1/min/s", "rad/s^2", RPM),
    ("%", "1", 0.01), ("-", "1", 1.0), ("", "N*m", 1.0), ("°", "rad", math.pi / 180), ("rev", "rad", 2 * math.pi),
    ("ms", "s", 1e-3), ("µs", "s", 1e-6), ("min", "s", 60.0), ("kW", "W", 1e3), ("N*m/s", "N*m/s", 1.0),
]  # fmt: skip
REFUSED = [
    *((text, "rad/s") for text in ("1/s", "s-1", "Hz", "kHz", "mHz", "1/h", "1/ms", "Bq", "%", "1", "m/s", "rad")),
    *((text, "N*m") for text in ("W*s", "J", "eV", "N*m/rad", "N*m/%", "N*m*%", "N", "lb", "MPa", "1/min")),
    *((text, "N*m/rad") for text in ("N*m/%", "eV/rad", "J/rad", "N*m/min", "N/m", "N*m/rad^2")),
    ("N*m*h", "N*m*s/rad"), ("W*s^2/rad", "N*m*s/rad"), ("kg*m", "kg*m^2"), ("kg*m^2*s", "kg*m^2"),
    ("kg*m^2*deg", "kg*m^2"), ("1/s^2", "rad/s^2"), ("Bq", "Hz"), ("1/h", "Hz"), ("rad", "1"), ("m", "1"), ("1", "rad"),
    ("1/Hz", "s"), ("N*m/s", "W"), ("VA", "W"), ("$", "N*m"), ("m^9^9", "m"), ("2*N*m", "N*m"), ("N*m" * 40, "N*m"),
    ("(N*m", "N*m"), ("N*m)", "N*m"), ("N**m", "N*m"), ("N*m/", "N*m"), ("foo", "N*m"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "si", "expected"), FACTORS)
def test_written_as(text, si, expected):
    assert factor(text, si) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("text", "si"), REFUSED)
def test_refused(text, si):
    with pytest.raises(InputError, match=r"model.toml: key: .*(no unit|does not fit|radians or turns)"):
        factor(text, si, "model.toml: key")


def test_a_number_and_a_unit():
    assert to_si("3000 1/min", "rad/s", "") == pytest.approx(100 * math.pi)
    assert to_si("3000/min", "rad/s", "") == pytest.approx(100 * math.pi)
    assert to_si("-2.5e-1kNm", "N*m", "") == -250.0
    assert to_si(7, "N*m", "") == 7.0
    for value in (True, None, [1.0], "N*m", "1,5 N*m", "1e999 N*m", 10**400, "nan"):
        with pytest.raises(InputError, match="key"):
            to_si(value, "N*m", "key")

"""Units of inertial sensors, as factors to SI units (uT for the magnetic field)."""

import re
from collections.abc import Mapping
from math import inf, pi

from pbd.io.numbers import DAY_S, HOUR_S

GRAVITY = 9.80665
"""Standard gravity, m/s2: a sensor's unit "g". Tracking estimates the local gravity at rest."""

GRAVITY_SIGMA = 0.02
"""How much gravity varies over the inhabited earth, m/s2: from 9.780 at the equator to 9.819 at 60 degrees (WGS 84)."""

GRAVITY_ON_EARTH = (9.7, 9.9)
"""Lowest and highest gravity on earth, m/s2: 9.780 to 9.832 at sea level (WGS 84), less on mountains."""

MG = 1e-3 * GRAVITY
"""A milli-g, m/s2."""

DEG = pi / 180.0
"""A degree, rad."""

UT_PER_GAUSS = 100.0
"""A gauss, uT."""

UNITS: Mapping[str, Mapping[str, float]] = {
    "acc": {"m/s2": 1.0, "g": GRAVITY, "mg": MG, "mm/s2": 1e-3, "cm/s2": 1e-2},
    "gyr": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": DEG, "dps": DEG, "mdeg/s": 1e-3 * DEG, "mdps": 1e-3 * DEG}
    | {"rpm": 2.0 * pi / 60.0},
    "mag": {"uT": 1.0, "nT": 1e-3, "mT": 1e3, "T": 1e6, "gauss": UT_PER_GAUSS, "mgauss": 1e-3 * UT_PER_GAUSS}
    | {"G": UT_PER_GAUSS, "mG": 1e-3 * UT_PER_GAUSS, "a.u.": 1.0, "local_flux": 1.0},
    "angle": {"rad": 1.0, "deg": DEG},
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": HOUR_S, "day": DAY_S} | {"0.1ms": 1e-4},
}
"""Factor to m/s2, rad/s, uT, rad and s by quantity and unit. The first unit of each quantity has the factor 1."""

_SIGNS = str.maketrans({"µ": "u", "μ": "u", "ʯ": "u", "?": "u"} | dict(zip("¹²⁻−", "12--", strict=True)))
"""Signs in units, among them the micro sign in wrong encodings."""

_SPELLINGS = (
    (r"[\s()]", ""),
    (r"milli-?", "m"),
    (r"micro-?", "u"),
    (r"nano", "n"),
    (r"sec(?:ond)?s?", "s"),
    (r"_?per_?|(?<=^rad|^deg)_?p?(?=s$)|(?<=^m)_?p?(?=s2$)", "/"),
    (r"[.·⋅*]?s\^?-1$", "/s"),
    (r"[.·⋅*]?s\^?-2$|/s(?:\^|\*\*)2$|/s/s$|(?<=^m)ss$", "/s2"),
    (r"(?:[°º]|grad|deg(?:ree)?s?)(?=/s|$)|^d(?=/s$)", "deg"),
    (r"rad(?:ian)?s?(?=/s|$)", "rad"),
    (r"met(?:er|re)s?(?=/)", "m"),
    (r"teslas?$", "t"),
    (r"^(-?[\d.]*m?)g(?:'?s|-?force)$", r"\1g"),
    (r"^min(?:ute)?s?$", "min"),
    (r"^h(?:ou)?rs?$", "h"),
    (r"^days$|^d$", "day"),
)
"""Patterns of units as programs spell them in lower case, and what replaces them, in this order."""


def normalized_unit(unit: str) -> str:
    """Return a unit in lower case as UNITS spells it: `°/sec` -> `deg/s`, `m·s⁻²` -> `m/s2`."""
    unit = unit.lower().translate(_SIGNS)
    for pattern, ours in _SPELLINGS:
        unit = re.sub(pattern, ours, unit)
    return unit


def unit_factor(quantity: str, unit: str) -> float | None:
    """Factor of a unit, which a number before it multiplies (`0.5mg`); None: unknown.

    Case is ignored, because programs write UT and Mg.
    """
    factors = {name.lower(): factor for name, factor in UNITS[quantity].items()}
    if (unit := normalized_unit(unit)) in factors:
        return factors[unit]
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s*([a-z]\S*)", unit)
    factor = float(match[1] + (match[2] or "")) * factors.get(match[3], 0.0) if match else 0.0
    return factor if 0.0 < factor < inf else None

"""Writes OceanServer sentences, from the manual's description of them."""

import math
from collections.abc import Sequence

import numpy as np

from pbd.pose import Array, quat_to_matrix


def sentence(body: str) -> bytes:
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def compass_from_rpy(wxyz: Array) -> tuple[float, float, float]:
    """Heading of the x axis, clockwise from north; how far it points up; how far y does: degrees."""
    x, y, z = quat_to_matrix(wxyz).T  # the sensor's axes; components east, north, up
    return (
        math.degrees(math.atan2(x[0], x[1])) % 360.0,
        math.degrees(math.asin(np.clip(x[2], -1.0, 1.0))),
        math.degrees(math.atan2(y[2], z[2])),
    )


def tagged(
    angles: Sequence[float] | None, acc_g: Sequence[float] | None, mag_mgauss: Sequence[float] | None, extra: str = ""
) -> bytes:
    body = "C" if angles is None else "C{:.1f}P{:.1f}R{:.1f}".format(*angles)
    body += extra
    body += "" if mag_mgauss is None else "Mx{:.2f}My{:.2f}Mz{:.2f}".format(*mag_mgauss)
    body += "" if acc_g is None else "Ax{:.3f}Ay{:.3f}Az{:.3f}".format(*acc_g)
    return sentence(body)


def by_commas(angles: Sequence[float], acc_g: Sequence[float], mag_mgauss: Sequence[float]) -> bytes:
    """All 18 fields of $OHPR."""
    numbers = [f"{angle:.1f}" for angle in angles] + ["28.4", "0.00", f"{math.hypot(*mag_mgauss):.2f}"]
    numbers += [f"{m:.2f}" for m in mag_mgauss] + [f"{math.hypot(*acc_g):.3f}"] + [f"{a:.3f}" for a in acc_g]
    return sentence(",".join(["OHPR", *numbers, "0", "1.5", "-2.5", "0", "0"]))

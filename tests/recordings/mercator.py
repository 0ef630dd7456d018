"""An oracle of the transverse Mercator projection, with no line of PROJ."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats


def transverse_mercator(
    latitude: Floats, longitude: Floats, *, latitude_0: float, longitude_0: float
) -> tuple[Floats, Floats]:
    """Give x east, y north [m] of WGS84 degrees, scale 1 on the meridian of the origin.

    Krueger's series to the 4th order in the third flattening (Karney 2011, Eqs. 7 to 11 and 35); within a
    nanometre of PROJ near the origin.
    """
    flattening = 1.0 / 298.257223563
    n = flattening / (2.0 - flattening)
    radius = 6378137.0 / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    alpha = (
        n / 2.0 - 2.0 * n**2 / 3.0 + 5.0 * n**3 / 16.0 + 41.0 * n**4 / 180.0,
        13.0 * n**2 / 48.0 - 3.0 * n**3 / 5.0 + 557.0 * n**4 / 1440.0,
        61.0 * n**3 / 240.0 - 103.0 * n**4 / 140.0,
        49561.0 * n**4 / 161280.0,
    )
    eccentricity = 2.0 * np.sqrt(n) / (1.0 + n)

    def project(lat: Floats, dlon: Floats) -> tuple[Floats, Floats]:
        sine = np.sin(lat)
        conformal = np.sinh(np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine))
        xi = np.arctan2(conformal, np.cos(dlon))
        eta = np.arcsinh(np.sin(dlon) / np.hypot(conformal, np.cos(dlon)))
        east = eta + sum(a * np.cos(2 * j * xi) * np.sinh(2 * j * eta) for j, a in enumerate(alpha, 1))
        north = xi + sum(a * np.sin(2 * j * xi) * np.cosh(2 * j * eta) for j, a in enumerate(alpha, 1))
        return radius * east, radius * north

    x, y = project(np.radians(latitude), np.radians(np.asarray(longitude) - longitude_0))
    return x, y - project(np.radians(latitude_0), np.zeros(()))[1]

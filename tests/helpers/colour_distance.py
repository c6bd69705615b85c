"""How far apart two colours are for someone who does not tell red from green.

Colours as a deuteranope or a protanope has them: Machado, Oliveira, Fernandes: A
physiologically-based model for simulation of color vision deficiency, IEEE TVCG 15 (2009) 1291,
severity 1. Distance in CAM02-UCS: Luo, Cui, Li: Uniform colour spaces based on CIECAM02, Color Res.
Appl. 31 (2006) 320, with the viewing conditions of sRGB.
"""

import numpy as np
from numpy.typing import NDArray

Colour = NDArray[np.float64]
DEFICIENT = {
    "deuteranope": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanope": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}
_XYZ = np.array([
    [0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505],
])  # fmt: skip
_CAT02 = np.array([
    [0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834],
])  # fmt: skip
_HPE = np.array([
    [0.38971, 0.68898, -0.07868], [-0.22981, 1.18340, 0.04641], [0.0, 0.0, 1.0],
])  # fmt: skip
_WHITE = np.array([95.047, 100.0, 108.883])
_ADAPTING = 64.0 / np.pi / 5.0  # luminance [cd/m²]
_BACKGROUND, _C, _NC, _F = 0.2, 0.69, 1.0, 1.0


def distance(colour_a: str, colour_b: str, kind: str) -> float:
    """The distance of two colours "#rrggbb" in CAM02-UCS for a kind of `DEFICIENT`."""
    points = [_cam02_ucs(np.array(DEFICIENT[kind]) @ _linear(c)) for c in (colour_a, colour_b)]
    return float(np.linalg.norm(points[0] - points[1]))


def _linear(colour: str) -> Colour:
    """Linear red, green and blue."""
    x = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def _cam02_ucs(linear: Colour) -> Colour:
    """J', a', b' of linear sRGB."""
    k = 1.0 / (5.0 * _ADAPTING + 1.0)
    level = 0.2 * k**4 * 5.0 * _ADAPTING + 0.1 * (1.0 - k**4) ** 2 * (5.0 * _ADAPTING) ** (1 / 3)
    induction = 0.725 * (1.0 / _BACKGROUND) ** 0.2
    degree = _F * (1.0 - np.exp((-_ADAPTING - 42.0) / 92.0) / 3.6)
    white = _CAT02 @ _WHITE
    gain = degree * 100.0 / white + 1.0 - degree

    def response(xyz: Colour) -> Colour:
        cone = _HPE @ np.linalg.solve(_CAT02, gain * (_CAT02 @ xyz))
        power = (level * np.abs(cone) / 100.0) ** 0.42
        return np.sign(cone) * 400.0 * power / (power + 27.13) + 0.1

    def achromatic(r: Colour) -> float:
        return float((2.0 * r[0] + r[1] + r[2] / 20.0 - 0.305) * induction)

    r = response(_XYZ @ (100.0 * np.clip(linear, 0.0, 1.0)))
    a, b = r[0] - 12.0 * r[1] / 11.0 + r[2] / 11.0, (r[0] + r[1] - 2.0 * r[2]) / 9.0
    hue = np.arctan2(b, a)
    lightness = 100.0 * (achromatic(r) / achromatic(response(_WHITE))) ** (
        _C * (1.48 + np.sqrt(_BACKGROUND))
    )
    eccentricity = (np.cos(hue + 2.0) + 3.8) / 4.0
    t = 50000.0 / 13.0 * _NC * induction * eccentricity * np.hypot(a, b)
    t /= r[0] + r[1] + 1.05 * r[2]
    chroma = t**0.9 * np.sqrt(lightness / 100.0) * (1.64 - 0.29**_BACKGROUND) ** 0.73
    colourfulness = np.log1p(0.0228 * chroma * level**0.25) / 0.0228
    return np.array([
        1.7 * lightness / (1.0 + 0.007 * lightness),
        colourfulness * np.cos(hue),
        colourfulness * np.sin(hue),
    ])  # fmt: skip

"""Maps of numbers to colors: viridis, cubehelix and gray, and matplotlib's where that is there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError

#: Colors of a map.
STEPS = 256

#: The map that is taken where none is asked for.
DEFAULT = "viridis"

#: Maps that are always there.
OWN = ("viridis", "cubehelix", "gray")

#: The colors of viridis, in 16 bits each: matplotlib's (N. Smith and S. van der Walt, CC0).
VIRIDIS = bytes.fromhex(
    "445a013f545444bd027555de451b03be57644574051b58e645c8068b5a64461808105bdd466309aa5d52"
    "46a90b4e5ec346ea0ce3602e47270e6b6195475f0fe962f74791115e645447bf12cb65ac47e8143366ff"
    "480d1596684c482c16f469944846184f6ad6485c19a66c12486d1afb6d4948781c4d6e7a487f1d9d6fa5"
    "48811eeb70ca487f203771e8487721827301486b22cc7413485a2414751f4844255a7625482926a07724"
    "480a27e5781d47e72928790f47bf2a6b79fb47922bac7ae147612ced7bbf472c2e2c7c9846f22f6b7d69"
    "46b430a87e35467331e57efa462d33217fb845e3345b8070459635958122454536cd81ce44f138048273"
    "4499393a8312443e3a6f83ac43e03ba3843f437f3cd584cd431b3e06855542b53f3685d8424b40648655"
    "41e0419186cc417242bd873f410243e787ac409045108815401c463888793fa6475e88d83f2f48828933"
    "3eb649a589893e3c4ac689dc3dc14be68a2a3d464d058a743cc94e218abb3c4b4f3d8afe3bcd50578b3d"
    "3b4f516f8b7a3ad052868bb33a51539b8be939d254af8c1c395355c28c4d38d456d38c7a385557e38ca6"
    "37d758f18ccf375959fe8cf536dc5b098d1a365f5c148d3c35e35d1d8d5d35685e258d7c34ee5f2b8d99"
    "347460318db433fc61358dcd338462388de6330e633a8dfc3298643b8e123224653b8e2631b0663a8e39"
    "313e67388e4b30cd68358e5b305d69318e6b2fee6a2c8e792f806b278e872f146c218e932ea86d1a8e9f"
    "2e3e6e128ea92dd46f0a8eb32d6b70018ebc2d0470f88ec42c9d71ee8ecb2c3772e48ed12bd273d98ed6"
    "2b6e74cd8eda2b0a75c18ede2aa776b58ee02a4577a98ee229e3789c8ee22982798f8ee229217a818ee0"
    "28c17b738edd28617c668ed928017d588ed427a27e498ece27437f3b8ec626e4802c8ebd2685811e8eb3"
    "2627820f8ea725c983008e9a256c83f28e8b250f84e38e7b24b285d48e69245686c58e5523fa87b68e3f"
    "239f88a78e27234589998e0e22eb8a8a8df222948b7b8dd4223d8c6c8db421e88d5d8d9221948e4f8d6d"
    "21438f408d4620f490328d1d20a891238cf1205f92148cc2201a93068c901fd893f78c5c1f9b94e98c25"
    "1f6395da8beb1f3096cc8bad1f0397bd8b6d1edd98af8b2a1ebe99a08ae31ea79a918a991e989b828a4b"
    "1e929c7389fa1e969d6489a61ea49e55894e1ebe9f4588f21ee2a03688921f13a126882f1f50a21687c8"
    "1f9aa305875c1ff1a3f586ed2057a4e4867a20caa5d28603214ca6c0858821dca7ae8508227ba89c8484"
    "2329a98983fc23e5aa75836f24afab6182de2588ac4c82492670ad3781af2765ae2181112869af0b806e"
    "297aaff37fc62a98b0db7f1a2bc3b1c27e692cfbb2a97db42e3fb38e7cf92f8fb4737c3a30ebb5577b76"
    "3252b63a7aae33c4b71b79e03541b7fc790e36c8b8dc7836385ab9ba775a39f5ba9876793b9abb747593"
    "3d47bc4f74a83efebd2873b740bebe0172c24286bed871c84456bfad70c9462ec0826fc5480fc1546ebb"
    "49f6c2256dad4be6c2f56c994ddcc3c36b814fdac48f6a6351dfc55a694153eac623681955fcc6ea66ec"
    "5815c7af65ba5a34c87364835c59c93463475e84c9f4620660b6cab160c062edcb6d5f75652acc275e25"
    "676cccde5cd069b4cd935b766c02ce465a166e54cef758b270accfa657497309d05255db756bd0fc5469"
    "77d2d1a452f17a3dd24951757cadd2ec4ff47f22d38d4e6e819ad42a4ce48418d4c64b568699d55f49c2"
    "891ed5f5482b8ba7d689468f8e34d71a44ef90c4d7a9434c9358d83541a495eed8be3ff99888d9453e4b"
    "9b25d9c93c999dc5da4a3ae4a067dac9392da30bdb453774a5b2dbbf35b9a85bdc3633fdab05dcab3240"
    "adb1dd1d3083b05edd8d2ec7b30cddfb2d0cb5bbde662b54b86bdece29a0bb1bdf3527f1bdcbdf992649"
    "c07bdffc24aac32ae05c2316c5d9e0bb2190c887e118201acb33e1731eb9cddee1cd1d6ed087e2251c40"
    "d32ee27c1b31d5d3e2d21a47d876e3271986db16e37a18f3ddb2e3cd1890e04ce4201862e2e2e472186a"
    "e574e4c318a9e803e514191fea8ee56519c8ed14e5b71aa4ef96e6081baef214e6591ce3f48ee6ab1e3e"
    "f702e6fe1fbaf972e7512156fbdee7a4230cfe45e7f924d9"
)


def cubehelix(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the cubehelix map: from black to white with rising luminance.

    Parameters
    ----------
    t : (n,) float64
        From 0 to 1.

    Returns
    -------
    (n, 3) float64
        sRGB, 0 to 1: start 0.5, -1.5 rotations, hue 1, gamma 1 (Green 2011, "A colour scheme for
        the display of astronomical intensity images", equations 1 and 2).
    """
    angle = 2.0 * math.pi * (0.5 / 3.0 + 1.0 - 1.5 * t)
    amplitude = t * (1.0 - t) / 2.0
    cosine, sine = np.cos(angle), np.sin(angle)
    shifts = np.stack(
        [
            -0.14861 * cosine + 1.78277 * sine,
            -0.29227 * cosine - 0.90649 * sine,
            1.97294 * cosine,
        ],
        axis=-1,
    )
    return np.clip(t[:, None] + amplitude[:, None] * shifts, 0.0, 1.0)


def colormap(name: str) -> NDArray[np.float64]:
    """Return the `STEPS` colors of a map, (STEPS, 3), sRGB from 0 to 1.

    Raises
    ------
    SettingError
        If it is none of ours, and none of matplotlib's or matplotlib is not there.
    """
    t = np.linspace(0.0, 1.0, STEPS)
    if name == "viridis":
        return np.frombuffer(VIRIDIS, ">u2").reshape(STEPS, 3) / 65535.0
    if name == "gray":
        return np.repeat(t[:, None], 3, axis=1)
    if name == "cubehelix":
        # Neither black, which shows no shape, nor white, which shows no light.
        return cubehelix(0.15 + 0.7 * t)
    try:
        from matplotlib import colormaps
    except ImportError:
        raise SettingError(
            f"colormap: found {name!r}, expected {', '.join(OWN)}, or matplotlib for more maps"
        ) from None
    if name not in colormaps:
        raise SettingError(f"colormap: found {name!r}, expected {', '.join(OWN)} or matplotlib's")
    return np.asarray(colormaps[name](t), np.float64)[:, :3]


def linear(color: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert sRGB to linear light (IEC 61966-2-1), so that a PNG of full light shows the color."""
    low = color / 12.92
    return np.where(color <= 0.04045, low, ((color + 0.055) / 1.055) ** 2.4)

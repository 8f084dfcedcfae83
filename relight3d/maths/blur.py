"""Pictures of which only some pixels are known."""

import numpy as np
from jaxtyping import Bool, Float32, Int32
from scipy.ndimage import gaussian_filter


def blur_known(
    values: Float32[np.ndarray, "point channel"],
    is_known: Bool[np.ndarray, " point"],
    pixel: Int32[np.ndarray, " point"],
    shape: tuple[int, int],
    sigma_px: float,
) -> Float32[np.ndarray, "channel height width"]:
    """Gaussian means over the known pixels of a picture (normalised convolution, Knutsson and Westin 1993).

    `pixel` are the points' flat indices; what is not known, or far from all that is, is 0.
    """

    def blurred(each: np.ndarray) -> np.ndarray:
        picture = np.zeros(shape[0] * shape[1], np.float32)
        picture[pixel] = each
        return gaussian_filter(picture.reshape(shape), sigma_px)

    share = np.maximum(blurred(is_known), np.float32(1e-6))
    return np.stack([blurred(np.where(is_known, each, 0.0)) / share for each in values.T])
